"""Training a class for every point: learnt by heart, resumed bit for bit, bad input named."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from pec import Classifier
from pec.data.augment import Augment
from pec.errors import CheckpointError, CloudError, ConfigError, DatasetError
from pec.segmentation import PointSegmenter
from pec.segmentation.clouds import LabelledClouds, drawn, read_clouds, write_clouds
from pec.segmentation.scores import scores
from pec.segmentation.segmenter import centred, drawn_points
from pec.segmentation.train import train_points

CLASSES = ["plate", "stick", "unknown"]
M = 320


def table(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """M points of a plate, an upright stick and a ball apart from each other, and their classes."""
    places = rng.permutation(3)[:, None] * [0.25, 0.0] + rng.uniform(-0.03, 0.03, (3, 2))
    label = np.arange(M) % 3
    shapes = np.stack(
        [
            rng.uniform([-0.05, -0.05, 0.01], [0.05, 0.05, 0.015], (M, 3)),
            rng.uniform([-0.005, -0.005, 0], [0.005, 0.005, 0.15], (M, 3)),
            rng.normal(size=(M, 3)) * 0.012 + [0, 0, 0.05],
        ]
    )
    points = shapes[label, np.arange(M)]
    points[:, :2] += places[label]
    return centred(points), label.astype(np.uint8)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(0)
    points, label = (torch.from_numpy(np.stack(each)) for each in zip(*(table(rng) for _ in range(14)), strict=True))
    val = torch.tensor([0] * 10 + [1] * 4, dtype=torch.uint8)
    path = tmp_path_factory.mktemp("clouds") / "clouds.safetensors"
    write_clouds(path, LabelledClouds(points, label, torch.full((14,), M), val, CLASSES, "tests"))
    return path


@pytest.fixture
def settings(file: Path, tmp_path: Path) -> dict[str, Any]:
    return {
        "clouds": str(file),
        "test": str(file),
        "output": str(tmp_path / "run"),
        "n_points": 256,
        "protocol": {"epochs": 3, "batch_size": 5, "precision": "float32"},
        "progress": False,
    }


@pytest.mark.parametrize("network", ["pec", "pointnet2"])
def test_shapes_are_told_apart_on_tables_that_were_not_seen(settings, network):
    protocol = {"epochs": 15, "batch_size": 2, "learning_rate": 0.004, "precision": "float32"}
    results = train_points(settings | {"network": network, "protocol": protocol, "also_at": 320})
    at, more = results["at_points"]
    assert at["validation"]["accuracy"] > 0.8
    assert at["validation"]["mean_iou"] > 0.7
    assert (at["n_points"], more["n_points"], results["n_clouds"]) == (
        256,
        320,
        {"train": 10, "validation": 4, "test": 14},
    )
    assert more["validation"]["accuracy"] > 0.5
    assert at["multiply_adds"] < more["multiply_adds"]
    segmenter = PointSegmenter.load(results["checkpoint"])
    points, label = table(np.random.default_rng(99))
    assert segmenter.classes == CLASSES
    assert (segmenter.label(points) == label).mean() > 0.75
    np.testing.assert_array_equal(segmenter.label(points), segmenter.label(points))


def test_pointnets_penalty_belongs_to_its_loss(settings):
    settings = settings | {"network": "pointnet", "protocol": {"epochs": 1, "batch_size": 10, "precision": "float32"}}
    results = train_points(settings)
    assert results["curves"]["loss_train"][0] > 0
    assert 3.5e6 < results["parameters"] < 3.6e6


def test_a_killed_run_ends_in_the_same_weights(settings, tmp_path, stopped_after):
    whole = train_points(settings)
    stopped = settings | {"output": str(tmp_path / "stopped")}
    with stopped_after(1):
        train_points(stopped)
    resumed = train_points(stopped)
    assert resumed["curves"] == whole["curves"]
    for folder in ("last", "best"):
        one, other = (load_file(Path(r["checkpoint"]).parent / folder / "model.safetensors") for r in (whole, resumed))
        assert all(torch.equal(one[name], other[name]) for name in one)
    events = list((tmp_path / "stopped" / "tensorboard").iterdir())
    assert events


def test_a_finished_run_is_not_repeated_and_another_is_refused(settings, file, tmp_path):
    first = train_points(settings)
    assert train_points(settings) == json.loads((Path(settings["output"]) / "results.json").read_text()) == first
    with pytest.raises(ConfigError, match=r"holds a run with seed=0, not 1"):
        train_points(settings | {"seed": 1})
    with pytest.raises(ConfigError, match=r"holds a run with other clouds"):
        train_points(settings | {"test": None})


def test_a_checkpoint_comes_back_and_a_broken_one_is_named(settings, tmp_path):
    best = Path(train_points(settings)["checkpoint"])
    assert {path.name for path in best.iterdir()} == {"config.json", "model.safetensors"}
    config = json.loads((best / "config.json").read_text())
    assert (config["classes"], config["network"], config["n_points"]) == (CLASSES, "pec", 256)
    with pytest.raises(CheckpointError, match="not a checkpoint's"):
        Classifier.load(best)
    broken = tmp_path / "broken"
    shutil.copytree(best, broken)
    (broken / "config.json").write_text(json.dumps(config | {"classes": [*CLASSES, "one more"]}))
    with pytest.raises(CheckpointError, match="its parts disagree"):
        PointSegmenter.load(broken)
    (broken / "config.json").write_text(json.dumps({"format": 1}))
    with pytest.raises(CheckpointError, match=r"no checkpoint of point segmentation .* kind 'classifier'"):
        PointSegmenter.load(broken)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"network": "pce"}, "network must be one of pec, pec_whole, pointnet, pointnet2, got 'pce'"),
        ({"n_points": 300}, "n_points must be a multiple of 64, 256 at least, got 300"),
        ({"network": "pec_whole", "also_at": 320}, "also_at=320: network=pec_whole takes no other"),
        ({"augment": {"remove": 0.1}}, "augment.remove must be 0.0 here"),
        ({"protocol": {"batch_size": 1}}, "batch norm needs two"),
        ({"protocol": {"epochs": 0}}, "protocol.epochs must be positive, got 0"),
        ({"nework": "pec"}, "unknown setting nework"),
    ],
)
def test_senseless_settings_are_named(settings, change, message):
    with pytest.raises(ConfigError, match=message):
        train_points(settings | change)


def test_clouds_that_will_not_do_are_named(settings, file, tmp_path):
    with pytest.raises(DatasetError, match="has 320 points a cloud, 1024 are asked for"):
        train_points(settings | {"n_points": 1024})
    with pytest.raises(DatasetError, match=r"none\.safetensors does not exist"):
        train_points(settings | {"clouds": str(tmp_path / "none.safetensors")})
    (tmp_path / "broken.safetensors").write_bytes(b"nothing")
    with pytest.raises(DatasetError, match="no file of labelled clouds"):
        train_points(settings | {"clouds": str(tmp_path / "broken.safetensors")})
    clouds = read_clouds(file, 256)
    write_clouds(tmp_path / "others.safetensors", clouds.part(val=True))
    with pytest.raises(DatasetError, match="has 0 clouds to train on and 4 to choose the epoch on"):
        train_points(settings | {"clouds": str(tmp_path / "others.safetensors")})


def test_points_that_cannot_be_labelled_are_named(settings):
    segmenter = PointSegmenter.load(train_points(settings)["checkpoint"])
    with pytest.raises(CloudError, match="has only 63"):
        segmenter.label(np.zeros((63, 3)))
    with pytest.raises(CloudError, match="not finite"):
        segmenter.label(np.full((80, 3), np.nan))
    assert segmenter.label(np.random.default_rng(0).uniform(0, 0.1, (70, 3))).shape == (70,)  # fewer than it takes


def test_a_draw_takes_each_point_once_where_there_are_enough_and_moves_labels_along():
    points = torch.arange(8.0)[None, :, None].repeat(2, 1, 3)
    points[:, 6:] = points[:, :2]  # the last two repeat the first
    label = points[..., 0].to(torch.uint8)
    clouds = LabelledClouds(points, label, torch.tensor([6, 6]), torch.zeros(2, dtype=torch.bool), ["a"], "")
    drawn_ones, labels = drawn(clouds, torch.tensor([1, 0]), 6, Augment(), torch.Generator().manual_seed(0))
    assert drawn_ones[..., 0].sort(dim=1).values.tolist() == [[0, 1, 2, 3, 4, 5]] * 2
    assert torch.equal(drawn_ones[..., 0].long(), labels)
    index = drawn_points(np.zeros((5, 3)), 12, np.random.default_rng(0))
    assert sorted(index[:5]) == sorted(index[5:10]) == list(range(5))


def test_scores_of_a_confusion():
    found = scores(torch.tensor([[6, 2, 0], [0, 4, 0], [0, 0, 0]]), ["a", "b", "c"])
    assert found.accuracy == pytest.approx(10 / 12)
    assert found.iou == {"a": pytest.approx(6 / 8), "b": pytest.approx(4 / 6), "c": None}
    assert found.mean_iou == pytest.approx((6 / 8 + 4 / 6) / 2)
