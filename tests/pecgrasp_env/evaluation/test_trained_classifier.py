"""The whole chain, small: clouds of the simulation train a classifier, by which the policy lifts what is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from pec.experiments.code_version import code_version
from pec.training.loop import train
from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, TabletopConfig, generate
from pecgrasp_env.evaluation.run import Protocol, run_episodes

CLASSES = ("can", "stapler", "plug_adapter")
CLOUDS = CaptureConfig(
    scenario="tabletop",
    objects=ObjectsConfig(classes=CLASSES, instances_per_class=10, strangers=24, strangers_samples=6),
    samples_per_instance=18,
    tabletop=TabletopConfig(drops=8),
)
TRAINING = {
    "protocol": {"epochs": 20, "batch_size": 16},
    "preprocess": {"n_points": 64, "n_candidates": 128, "start": "farthest", "pose": "upright", "ordering": "anchors"},
    "threads": 1,
}


@pytest.fixture(scope="module")
def checkpoint(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trained in half a minute; kept in pytest's cache for as long as the code is the same."""
    cache = getattr(request.config, "cache", None)
    if cache is None:
        folder = tmp_path_factory.mktemp("trained")
    else:
        version = code_version(("pecgrasp_env.capture.generate", "pec.training.loop"), ("sapien", "torch"))
        folder = cache.mkdir(f"trained-classifier-{version}")
    if not (folder / "run/best/model.safetensors").exists():
        generate(CLOUDS, folder / "clouds", workers=1)
        train({**TRAINING, "dataset": {"path": str(folder / "clouds")}, "output": str(folder / "run")})
    return folder / "run/best"


@pytest.mark.slow
def test_a_trained_classifier_drives_the_policy_to_the_asked_for_object(checkpoint: Path, tmp_path: Path) -> None:
    """Three objects that training has not seen; whoever lifts one at random is right in a third of the episodes."""
    env = {"n_objects": 3, "classes": list(CLASSES), "objects": {"seed": 1000}}
    protocol = Protocol(env, str(checkpoint), {"_target_": "grasping.CurvaturePlanner"}, {})
    episodes = run_episodes(protocol, range(8), tmp_path)
    outcomes = [episode.outcome for episode in episodes]
    assert outcomes.count("success") >= 6, [(e.seed, e.target, e.outcome, e.reason) for e in episodes]
    assert outcomes.count("wrong_object") <= 1
    assert len({episode.target for episode in episodes}) > 1
