"""A class for every point against one for every cut-out: the commands in a row, and what the comparison counts."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pec import Classifier
from pec.checkpoint import Checkpoint, write_checkpoint
from pec.data.loading import load_dataset
from pec.data.shards import read_manifest, write_manifest
from pec.errors import ConfigError
from pec.networks.baselines import Forest
from pec.preprocessing.preprocess import Preprocess
from pec.segmentation import PointSegmenter
from pecgrasp_env.capture.scenes.generate import generate_frames
from pecgrasp_env.experiments.point_segmentation import METHODS, compare_on_frames
from tests.cli.test_commands import run
from tests.pecgrasp_env.capture.test_table_clouds import CONFIG


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What each command leaves, of a few frames: frames, cuts, classifier, run."""
    folder = tmp_path_factory.mktemp("made")
    generate_frames(CONFIG, folder / "frames", workers=1)
    run("cut-scenes", f"frames={folder}/frames", f"out={folder}/cuts", "progress=false")
    clouds = load_dataset(folder / "cuts", ["mouse", "stapler"])
    preprocess = Preprocess(ordering="none", start="farthest")
    samples = torch.from_numpy(np.stack([preprocess.sample(c, np.random.default_rng(0)) for c in clouds.clouds]))
    forest = Forest(64, 2)
    forest.fit(samples, torch.from_numpy(clouds.labels))
    write_checkpoint(folder / "classifier", Checkpoint(forest, clouds.classes, preprocess, 1.0, 1, "forest"))
    run(
        "train-points", f"frames={folder}/frames", "stored_points=512", "n_points=256", "network=pec",
        "protocol.epochs=2", "protocol.batch_size=3", "progress=false", f"output={folder}/run",
    )  # fmt: skip
    return folder


def test_the_comparison_counts_the_same_objects_for_every_way(made, capsys):
    trained = json.loads((made / "run" / "results.json").read_text())
    assert trained["n_clouds"] == {"train": 3, "validation": 1}
    run(
        "evaluate-points", f"frames={made}/frames", f"checkpoint={made}/run/best", "progress=false",
        f"classifier={made}/classifier", "unknown_below=0", f"output={made}/compared",
    )  # fmt: skip
    assert METHODS[0] in capsys.readouterr().out
    results = json.loads((made / "compared" / "results.json").read_text())
    assert (results["frames"], results["frames_without_table"], results["n_points"]) == (4, 0, 256)
    rows = results["methods"]
    assert list(rows) == list(METHODS)
    (n,) = {row["found"]["n"] for row in rows.values()}
    assert n >= 4
    for row in rows.values():
        assert row["found"]["count"] <= min(n, row["named_rightly"]["n"])
        assert 0 <= row["accuracy"] <= 1
        low, high = row["found"]["interval"]
        assert 0 <= low <= row["found"]["share"] <= high <= 1
    # A classifier that learnt most of these very cut-outs by heart names them.
    assert rows[METHODS[0]]["found"]["share"] > 0.4
    first = rows[METHODS[0]]["found"]["count"]
    for pair in results["comparisons"]:
        assert rows[pair["method"]]["found"]["count"] == first + pair["only_it"] - pair["only_other"]


def test_other_classes_are_refused(made, tmp_path):
    points = PointSegmenter.load(made / "run" / "best")
    classifier = Classifier.load(made / "classifier")
    manifest = read_manifest(made / "frames")
    objects = manifest.config["objects"] | {"classes": ["mouse", "pliers"]}
    write_manifest(tmp_path, replace(manifest, config=manifest.config | {"objects": objects}))
    with pytest.raises(ConfigError, match="checkpoint knows the classes mouse, stapler, the frames mouse, pliers"):
        compare_on_frames(tmp_path, points, classifier)


def test_a_set_that_shares_its_objects_is_no_test(made):
    with pytest.raises(SystemExit, match=r"pecgrasp train-points: .* shares objects with"):
        run(
            "train-points", f"frames={made}/frames", f"test_frames={made}/frames", "progress=false",
            f"output={made}/other",
        )  # fmt: skip
