"""Data sets with strangers: the last class, how many, a folder's own, and that the others are as they were without."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pec.data.loading import load_dataset
from pec.data.shards import read_manifest, read_shard
from pec.errors import DatasetError
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, TabletopConfig, generate
from pecgrasp_env.capture.shard_plan import allot, open_source
from pecgrasp_env.capture.with_strangers import WithStrangers
from pecgrasp_env.objects import UNKNOWN

OBJECTS = ObjectsConfig(classes=("stapler", "mug"), instances_per_class=2, strangers=3, strangers_samples=2)
SMALL = CaptureConfig(objects=OBJECTS, samples_per_instance=4, shard_size=4, scenario="free", max_depth=1.0)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return generate(SMALL, tmp_path_factory.mktemp("small") / "data", workers=1).directory


def test_strangers_are_the_last_class_with_few_clouds_of_many_things(small):
    manifest = read_manifest(small)
    assert manifest.classes == ["stapler", "mug", UNKNOWN]
    strangers = [i for i in manifest.instances if i["class"] == UNKNOWN]
    assert [i["name"] for i in strangers] == ["stranger_00000", "stranger_00001", "stranger_00002"]
    assert {i["origin"] for i in strangers} == {"drawn stranger"}
    assert manifest.config["objects"]["strangers"] == 3
    dataset = load_dataset(small)
    assert dataset.classes[-1] == UNKNOWN
    assert np.bincount(dataset.labels).tolist() == [8, 8, 6]
    assert np.bincount(dataset.instances).tolist() == [4, 4, 4, 4, 2, 2, 2]


def test_the_known_classes_have_the_same_clouds_without_them(small, tmp_path):
    without = replace(SMALL, objects=replace(OBJECTS, strangers=0))
    made = generate(without, tmp_path / "data", workers=1).directory
    plain = read_manifest(made)
    assert "strangers" not in plain.config["objects"]
    hashes = [record.sha256 for record in read_manifest(small).shards]
    assert [record.sha256 for record in plain.shards] == hashes[: len(plain.shards)]
    with pytest.raises(DatasetError, match=r"config\.objects\.strangers"):
        generate(without, small, workers=1)


@pytest.mark.parametrize("scenario", ["free", "tabletop"])
def test_a_third_of_the_clouds_shows_strangers_where_nothing_is_said(scenario):
    config = CaptureConfig(scenario=scenario, objects=ObjectsConfig(strangers=None), samples_per_instance=100)
    source = open_source(config)
    manifest, jobs = allot(config, source)
    assert len(source.names(UNKNOWN)) == 500
    assert manifest.config["objects"]["strangers"] == 500
    of_strangers = sum(job.n_samples for job in jobs if source.classes[job.members[0].class_index] == UNKNOWN)
    assert of_strangers == sum(job.n_samples for job in jobs) / 3 == 5000


def test_a_folders_own_strangers_are_the_last_class_and_count(tmp_path):
    for name in ("box", "unknown", "zebra"):
        (tmp_path / "meshes" / name).mkdir(parents=True)
        for i in range(3 if name == "unknown" else 2):
            size = (0.05 + 0.02 * i, 0.04, 0.06)
            trimesh.creation.box(size).export(str(tmp_path / "meshes" / name / f"{i}.ply"))
    objects = ObjectsConfig("folder", path=str(tmp_path / "meshes"), strangers=0)
    config = CaptureConfig(objects=objects, samples_per_instance=20)
    source = open_source(config)
    assert source.classes == ("box", "zebra", UNKNOWN)
    assert source.names(UNKNOWN) == ["0", "1", "2"]
    assert source.load(UNKNOWN, 2).class_name == UNKNOWN
    assert open_source(replace(config, objects=replace(objects, strangers=None))).names(UNKNOWN) == ["0", "1", "2"]
    more = open_source(replace(config, objects=replace(objects, strangers=1)))
    assert more.names(UNKNOWN) == ["0", "1", "2", "stranger_00000"]
    assert (more.origin(UNKNOWN, 2), more.origin(UNKNOWN, 3)) == ("mesh 2.ply", "drawn stranger")
    assert more.load(UNKNOWN, 3).class_name == UNKNOWN


def test_a_folder_of_nothing_but_strangers_is_refused(tmp_path):
    (tmp_path / "unknown").mkdir()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(str(tmp_path / "unknown" / "a.ply"))
    with pytest.raises(CaptureError, match="no class but 'unknown'"):
        open_source(CaptureConfig(objects=ObjectsConfig("folder", path=str(tmp_path))))


def test_a_stranger_that_cannot_be_captured_stops_nothing(tmp_path, monkeypatch):
    objects = ObjectsConfig(classes=("can",), instances_per_class=1, strangers=2, strangers_samples=1)
    config = CaptureConfig(
        scenario="tabletop", objects=objects, samples_per_instance=1, tabletop=TabletopConfig(drops=4)
    )
    drawn = WithStrangers.load

    def one_is_too_large(self, class_name, i):
        model = drawn(self, class_name, i)
        if class_name == UNKNOWN and i == 1:
            parts = tuple(replace(part, vertices=part.vertices * 20) for part in model.parts)
            return replace(model, parts=parts)
        return model

    monkeypatch.setattr(WithStrangers, "load", one_is_too_large)
    made = generate(config, tmp_path / "data", workers=1)
    assert (made.n_samples, made.skipped) == (2, {})
    manifest = read_manifest(made.directory)
    assert ["not_captured" in instance for instance in manifest.instances] == [False, False, True]
    assert generate(config, tmp_path / "data", workers=1).n_new == 0
    assert read_shard(made.directory / manifest.shards[-1].file).class_index.tolist() == [1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"strangers": -1}, "strangers must not be negative, got -1"),
        ({"strangers_samples": 0}, "strangers_samples must be at least 1, got 0"),
        ({"source": "modelnet10", "path": "M", "strangers": 5}, "strangers must be 0 with modelnet10"),
    ],
)
def test_what_makes_no_sense_is_named(change, message):
    with pytest.raises(CaptureError, match=message):
        ObjectsConfig(**change)
