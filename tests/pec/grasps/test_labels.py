"""Grasp labels on disk: what is written is read, by scene and by instance, and what is none is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pec.data.shards import Manifest, shard_name, write_manifest
from pec.errors import DatasetError
from pec.grasps.labels import GraspLabels, GraspScene, read_grasp_shard, write_grasp_shard

SAMPLERS, OUTCOMES = ["antipodal", "planner"], ["held", "lost in the shake", "not lifted"]


def scene_of(class_name: str, instance: str, n_grasps: int, seed: int) -> GraspScene:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4, dtype=np.float32), (n_grasps, 1, 1))
    poses[:, :3, 3] = rng.normal(size=(n_grasps, 3))
    return GraspScene(
        class_name,
        instance,
        rng.normal(size=(20 + seed, 3)).astype(np.float32),
        np.eye(4),
        np.diag([-1.0, -1.0, 1.0, 1.0]),
        poses,
        rng.uniform(0.01, 0.1, n_grasps).astype(np.float32),
        rng.uniform(0.1, 0.14, n_grasps).astype(np.float32),
        rng.integers(len(SAMPLERS), size=n_grasps).astype(np.uint8),
        rng.integers(len(OUTCOMES), size=n_grasps).astype(np.uint8),
    )


SCENES = [
    scene_of("mug", "a", 3, 0),
    scene_of("mug", "b", 0, 1),  # of which no grasp was found
    scene_of("box", "a", 4, 2),
    scene_of("mug", "b", 2, 3),
    scene_of("box", "c", 5, 4),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two shards of grasp labels, as `generate-grasps` leaves them."""
    records = [
        write_grasp_shard(tmp_path / shard_name(number, ".npz"), part)
        for number, part in enumerate((SCENES[:3], SCENES[3:]))
    ]
    instances = [{"name": name, "class": kind} for kind, name in (("mug", "a"), ("mug", "b"), ("box", "a"))]
    instances.append({"name": "c", "class": "box", "copy_of": "a"})
    config = {"samplers": SAMPLERS, "outcomes": OUTCOMES}
    write_manifest(tmp_path, Manifest(["mug", "box"], instances, [], config, 0, {}, records, complete=True))
    return tmp_path


def assert_same(found: GraspScene, wanted: GraspScene) -> None:
    for name, value in vars(wanted).items():
        got = getattr(found, name)
        assert np.array_equal(got, value), name
        assert not isinstance(value, np.ndarray) or got.dtype == value.dtype


def test_scenes_are_read_as_they_were_written(folder):
    labels = GraspLabels(folder)
    assert len(labels) == 14
    found = list(labels.scenes())
    assert len(found) == len(SCENES)
    for got, wanted in zip(found, SCENES, strict=True):
        assert_same(got, wanted)
        assert np.array_equal(got.held, wanted.outcome == 0)
    assert [scene.thing for scene in labels.scenes({"box/a"})] == ["box/a"]
    assert labels.counts.shape == (2, 2, 3)
    assert labels.counts.sum(axis=(1, 2)).tolist() == [5, 9]


def test_no_instance_is_on_both_sides_and_a_copy_goes_with_its_original(folder):
    train, test = GraspLabels(folder).split(0.5, seed=1)
    assert train | test == set(GraspLabels(folder).instances)
    assert not train & test
    assert sum(name.startswith("mug") for name in test) == 1
    assert {"box/a", "box/c"} <= train  # copies: one thing, so the class has nothing to test on
    assert GraspLabels(folder).split(0.5, seed=1) == (train, test)


def test_what_holds_no_labels_is_refused(folder, tmp_path):
    manifest = GraspLabels(folder).manifest
    write_manifest(folder, replace(manifest, config={"samplers": SAMPLERS}))
    with pytest.raises(DatasetError, match="no list of outcomes"):
        GraspLabels(folder)
    write_manifest(folder, replace(manifest, config={"samplers": SAMPLERS, "outcomes": ["lost", "held"]}))
    with pytest.raises(DatasetError, match="must begin with 'held'"):
        GraspLabels(folder)
    one_each = replace(manifest, instances=manifest.instances[1:3])
    write_manifest(folder, one_each)
    with pytest.raises(DatasetError, match="none is left to test on"):
        GraspLabels(folder).split()
    with pytest.raises(DatasetError, match="train_fraction"):
        GraspLabels(folder).split(1.0)


def test_damaged_and_broken_shards_are_told(folder):
    labels = GraspLabels(folder)
    path = folder / labels.manifest.shards[1].file
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(DatasetError, match="sha256"):
        list(labels.scenes())
    with pytest.raises(DatasetError, match="makes missing and damaged shards anew"):
        read_grasp_shard(path)
    with pytest.raises(DatasetError, match="must be finite"):
        write_grasp_shard(path, [replace(SCENES[0], widths=np.array([0.1, np.nan, 0.1], np.float32))])
