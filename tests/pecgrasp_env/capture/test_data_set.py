"""The data set on disk: what belongs to what, the same bytes however it was made, and what is refused."""

import hashlib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pec.data.shards import read_manifest, read_shard
from pec.errors import DatasetError
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, generate, summarise
from pecgrasp_env.capture.scenarios.base import sample_seed
from pecgrasp_env.objects import ObjectError, make_object

SMALL = CaptureConfig(
    objects=ObjectsConfig(classes=("can", "plug_adapter"), instances_per_class=2),
    samples_per_instance=12,
    shard_size=5,
    resolutions=("424x240",),
    seed=7,
)


def contents(directory: Path) -> dict[str, str]:
    """Hash of every file: equal exactly where the bytes are, and a difference is shown in a line."""
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> Path:
    """The small data set, made in one go by one process."""
    return generate(SMALL, tmp_path_factory.mktemp("reference") / "data", workers=1).directory


def test_every_object_is_wholly_in_view_beyond_the_minimum_depth(reference):
    manifest = read_manifest(reference)
    for record in manifest.shards:
        shard = read_shard(reference / record.file, record)
        assert np.all(np.diff(shard.offsets) >= SMALL.min_points)
        depth = shard.points[:, 2]
        assert depth.min() >= SMALL.intrinsics[0].min_depth
        assert shard.T_camera_object[:, 2, 3].max() <= 2.0


def test_labels_poses_and_seeds_belong_to_the_clouds(reference):
    manifest = read_manifest(reference)
    assert manifest.complete
    assert manifest.classes == ["can", "plug_adapter"]
    names = [instance["name"] for instance in manifest.instances]
    assert names == ["can_0000", "can_0001", "plug_adapter_0000", "plug_adapter_0001"]
    counts: Counter[int] = Counter()
    for record in manifest.shards:
        shard = read_shard(reference / record.file, record)
        for i in range(len(shard)):
            instance = int(shard.instance_index[i])
            assert manifest.classes[shard.class_index[i]] == manifest.instances[instance]["class"]
            vertices = make_object(*split_name(names[instance])).visual_mesh().vertices
            T = shard.T_camera_object[i].astype(float)
            cloud = (shard.cloud(i) - T[:3, 3]) @ T[:3, :3]
            assert np.all(cloud > vertices.min(0) - 1e-4)
            assert np.all(cloud < vertices.max(0) + 1e-4)
            seed = sample_seed(7, manifest.instances[instance]["class"], names[instance], counts[instance])
            assert shard.seed[i] == seed
            counts[instance] += 1
    assert counts == {0: 12, 1: 12, 2: 12, 3: 12}


def split_name(name: str) -> tuple[str, int]:
    class_name, _, number = name.rpartition("_")
    return class_name, int(number)


def test_two_workers_write_the_same_bytes_as_one(reference, tmp_path):
    made = generate(SMALL, tmp_path / "two", workers=2)
    assert made.n_new == made.n_samples == 48
    assert contents(made.directory) == contents(reference)


class Stop(Exception):
    pass


def test_an_interrupted_run_goes_on_to_the_same_bytes(reference, tmp_path):
    directory = tmp_path / "data"
    seen = []

    def stop_after(done, total):
        seen.append(done)
        assert total == 48
        if len(seen) > 4:
            raise Stop

    with pytest.raises(Stop):
        generate(SMALL, directory, workers=1, progress=stop_after)
    partial = read_manifest(directory)
    assert not partial.complete
    assert sum(record.n_samples for record in partial.shards) == seen[-1] < 48
    resumed = generate(SMALL, directory, workers=1)
    assert resumed.n_new == 48 - seen[-1]
    assert contents(directory) == contents(reference)
    again = generate(SMALL, directory, workers=1)
    assert (again.n_new, again.n_samples) == (0, 48)
    assert again.rejected == resumed.rejected


def test_a_damaged_or_missing_shard_is_made_again(reference, tmp_path):
    made = generate(SMALL, tmp_path / "data", workers=1).directory
    (made / "shards/00002.safetensors").write_bytes(b"damaged")
    (made / "shards/00004.safetensors").unlink()
    repaired = generate(SMALL, made, workers=1)
    assert repaired.n_new == 10 - 3  # shards of 5, 5 and 2 samples an instance: 00002 has 2, 00004 has 5
    assert contents(made) == contents(reference)


def test_other_classes_and_more_samples_change_no_sample(reference, tmp_path):
    config = CaptureConfig(
        objects=ObjectsConfig(classes=("plug_adapter",), instances_per_class=1),
        samples_per_instance=5,
        resolutions=("424x240",),
        seed=7,
    )
    (record,) = read_manifest(generate(config, tmp_path / "alone", workers=1).directory).shards
    alone = read_shard(tmp_path / "alone" / record.file)
    among = read_shard(reference / "shards/00006.safetensors")
    assert np.array_equal(alone.points, among.points)
    assert np.array_equal(alone.seed, among.seed)


def test_another_configuration_in_the_same_folder_is_refused(reference):
    for change, message in (
        ({"max_depth": 1.5}, r"config\.max_depth=2\.0, not 1\.5"),
        ({"seed": 8}, r"config\.seed=7, not 8"),
        ({"objects": ObjectsConfig(classes=("can",), instances_per_class=2)}, "config.objects.classes"),
    ):
        with pytest.raises(DatasetError, match=message):
            generate(CaptureConfig(**{**vars(SMALL), **change}), reference, workers=1)


def test_summary_counts_what_is_there(reference):
    summary = summarise(generate(SMALL, reference, workers=1))
    assert [(row["class"], row["instances"], row["clouds"]) for row in summary["classes"]] == [
        ("can", 2, 24),
        ("plug_adapter", 2, 24),
    ]
    assert summary["clouds"] == 48
    assert summary["new_clouds"] == 0
    low, median, high = summary["classes"][0]["points"]
    assert SMALL.min_points <= low <= median <= high


def test_a_folder_of_meshes_becomes_a_data_set(tmp_path):
    for class_name, size in (("brick", 0.1), ("plank", 0.2)):
        (tmp_path / "meshes" / class_name).mkdir(parents=True)
        mesh = trimesh.creation.box((1000 * size, 40, 30))
        mesh.export(tmp_path / "meshes" / class_name / "1.stl")  # one name in both classes, and millimetres
    objects = ObjectsConfig(path=str(tmp_path / "meshes"), scale=0.001)
    config = CaptureConfig(objects=objects, samples_per_instance=4, resolutions=("424x240",))
    manifest = read_manifest(generate(config, tmp_path / "data", workers=1).directory)
    assert [(i["class"], i["name"], i["extents_m"]) for i in manifest.instances] == [
        ("brick", "1", [0.1, 0.04, 0.03]),
        ("plank", "1", [0.2, 0.04, 0.03]),
    ]
    assert [record.n_samples for record in manifest.shards] == [8]


def test_an_unknown_class_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(ObjectError, match="teapot"):
        generate(CaptureConfig(objects=ObjectsConfig(classes=("teapot",))), tmp_path / "data", workers=1)
    assert not (tmp_path / "data").exists()


def test_workers_and_a_file_in_the_way_are_named(tmp_path):
    with pytest.raises(CaptureError, match="workers must be at least 1, got 0"):
        generate(SMALL, tmp_path, workers=0)
    (tmp_path / "data").write_text("a file, not a folder")
    with pytest.raises(CaptureError, match="cannot write the data set in"):
        generate(SMALL, tmp_path / "data", workers=1)
