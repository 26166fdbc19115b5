"""Training on grasps that hold across a bar and not along it: what is learnt, resumed, refused and used."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from pec.errors import CheckpointError, ConfigError, DatasetError
from pec.grasps import GraspProposer, GraspScorer
from pec.grasps.training.figures import average_precision, ranking_figures, top_one
from pec.grasps.training.train import train_grasps

EVALUATORS = ("pointnetgpd", "gpd", "graspnet_evaluator")


def with_network(settings: dict, name: str, **more: object) -> dict:
    return settings | {"network": settings["network"] | {"name": name}} | more


def top_of_bar(length: float, width: float) -> np.ndarray:
    """The top of an unseen bar along x, 30 mm high."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 40) * length, np.linspace(-0.5, 0.5, 12) * width)
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.03)])


@pytest.mark.parametrize("name", EVALUATORS)
def test_it_is_learnt_what_holds(settings, downward, name) -> None:
    results = train_grasps(with_network(settings, name))
    assert results["test"]["all"]["auc"] > 0.95
    assert results["test"]["across and along"]["top_one"] > results["test"]["all"]["chance"]
    assert results["data_sizes"]["training"]["instances"] == 6
    assert json.loads((Path(settings["output"]) / "results.json").read_text()) == results

    scorer = GraspScorer.load(results["checkpoint"])
    across, along = (downward(yaw, np.array([0.0, 0.0, 0.035])) for yaw in (np.pi / 2, 0.0))
    scores = scorer(top_of_bar(0.12, 0.03), np.array([across, along]), np.full(2, 0.03))
    assert scores.shape == (2,)
    assert scores[0] > scores[1]
    assert scorer(top_of_bar(0.12, 0.03), np.zeros((0, 4, 4)), np.zeros(0)).shape == (0,)


def test_a_run_that_was_stopped_ends_in_the_same_weights(settings, tmp_path, stopped_after) -> None:
    whole = train_grasps(settings)
    stopped = settings | {"output": str(tmp_path / "stopped")}
    with stopped_after(2):
        train_grasps(stopped)
    resumed = train_grasps(stopped)
    assert resumed["curves"] == whole["curves"]
    files = [Path(each["checkpoint"]) / "model.safetensors" for each in (whole, resumed)]
    assert files[0].read_bytes() == files[1].read_bytes()
    with pytest.raises(ConfigError, match="holds a run with seed=0, not 1"):
        train_grasps(stopped | {"seed": 1})


def test_a_sampler_proposes_grasps_near_those_that_held(settings, tmp_path) -> None:
    protocol = {"epochs": 20, "batch_size": 16, "learning_rate": 0.01}
    sampler = train_grasps(with_network(settings, "graspnet_sampler", protocol=protocol))
    assert sampler["test"]["distance_mm"] < 25
    judge = train_grasps(with_network(settings, "graspnet_evaluator", output=str(tmp_path / "judge")))
    cloud = top_of_bar(0.12, 0.03)
    raw = GraspProposer.load(sampler["checkpoint"], n_grasps=20)(cloud)
    refined = GraspProposer.load(sampler["checkpoint"], judge["checkpoint"], n_grasps=20, steps=5)(cloud)
    for poses in (raw, refined):
        assert poses.shape == (20, 4, 4)
        rotations = poses[:, :3, :3]
        np.testing.assert_allclose(rotations @ rotations.transpose(0, 2, 1) - np.eye(3), 0.0, atol=1e-5)
    scorer, width = GraspScorer.load(judge["checkpoint"]), np.full(20, 0.03)
    assert (scorer(cloud, refined, width) >= scorer(cloud, raw, width) - 1e-6).all()
    with pytest.raises(CheckpointError, match="proposes grasps and judges none"):
        GraspScorer.load(sampler["checkpoint"])
    with pytest.raises(CheckpointError, match="judges grasps and proposes none"):
        GraspProposer.load(judge["checkpoint"])


def test_what_makes_no_sense_is_refused(settings, labels) -> None:
    for wrong, error, what in (
        ({"network": {"name": "vgn"}}, ConfigError, "network.name"),
        ({"network": {"name": "gpd", "image_size": 8}}, ConfigError, "network.image_size"),
        ({"network": {"n_points": 600}}, ConfigError, "network.cloud_points"),
        ({"protocol": {"batch_size": 1}}, ConfigError, "protocol.batch_size"),
        ({"dataset": {"path": str(labels), "train_fraction": 1.0}}, ConfigError, "dataset.train_fraction"),
        ({"dataset": {"path": str(labels), "passed_over": ["fell"]}}, DatasetError, "dataset.passed_over"),
        ({"dataset": {"path": str(labels / "nothing")}}, DatasetError, "nothing"),
    ):
        with pytest.raises(error, match=what):
            train_grasps(settings | wrong)
    with pytest.raises(CheckpointError, match="does not exist"):
        GraspScorer.load(settings["output"])


def test_figures_are_those_of_small_cases() -> None:
    scores, held = np.array([0.9, 0.8, 0.7, 0.6]), np.array([True, False, True, False])
    assert average_precision(scores, held) == pytest.approx((1 + 2 / 3) / 2)
    assert average_precision(np.zeros(4), held) == 0.5
    assert np.isnan(average_precision(scores, np.zeros(4, bool)))
    assert top_one(scores, held, np.array([0, 0, 1, 1])) == (1.0, 0.5, 2)
    assert top_one(np.zeros(4), held, np.zeros(4, int)) == (0.5, 0.5, 1)
    assert ranking_figures(scores, held, np.zeros(4, int))["auc"] == 0.75


def test_drawn_views_keep_the_cloud_where_the_hand_is(labels) -> None:
    """Turned together, points and pose give the same cloud in the grasp's frame, but for the half turn of the hand."""
    from pec.grasps.network import NetworkConfig
    from pec.grasps.training.config import GraspAugment, GraspDataConfig
    from pec.grasps.training.data import load_splits
    from pec.grasps.views import in_grasp_frame

    data = load_splits(GraspDataConfig(str(labels)), NetworkConfig(cloud_points=64, n_points=16), True, 0).training
    index = torch.arange(24)
    given, drawn = data.views(index), data.drawn_views(index, GraspAugment(jitter=0.0))
    before = in_grasp_frame(given.points, given.T_cloud_grasp)
    after = in_grasp_frame(drawn.points, drawn.T_cloud_grasp)
    torch.testing.assert_close(after.abs(), before.abs(), atol=1e-5, rtol=0)
    turned = (after[:, 0, 0] * before[:, 0, 0]) < 0
    assert 0 < int(turned.sum()) < 24
    assert not torch.allclose(given.points, drawn.points)
    determinants = torch.linalg.det(drawn.T_cloud_grasp[:, :3, :3])
    torch.testing.assert_close(determinants, torch.ones(24), atol=1e-4, rtol=0)
