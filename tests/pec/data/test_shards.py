"""The on-disk format: what is written is read back; what is broken is named."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.numpy import load_file

from pec.data.shards import CloudSample, Manifest, read_manifest, read_shard, shard_name, write_manifest, write_shard
from pec.errors import DatasetError


def _samples(sizes: list[int], seed: int = 0) -> list[CloudSample]:
    rng = np.random.default_rng(seed)
    return [
        CloudSample(
            rng.normal(size=(n, 3)).astype(np.float32),
            i % 3,
            i % 5,
            np.eye(4) * (i + 1),
            2**40 + i,
            i % 2,
            i / 8,
            1 - i / 8,
        )
        for i, n in enumerate(sizes)
    ]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, 30), max_size=6), st.booleans())
def test_shard_comes_back_as_written(tmp_path_factory, sizes, mapped):
    samples = _samples(sizes)
    directory = tmp_path_factory.mktemp("set")
    record = write_shard(directory / shard_name(3), samples)
    assert record.file == "shards/00003.safetensors"
    assert record.n_samples == len(sizes)
    shard = read_shard(directory / record.file, record, mapped=mapped)
    assert len(shard) == len(samples)
    assert isinstance(shard.points, np.ndarray)
    for i, sample in enumerate(samples):
        np.testing.assert_array_equal(shard.cloud(i), sample.points)
        np.testing.assert_array_equal(shard.T_camera_object[i], sample.T_camera_object)
        assert shard.class_index[i] == sample.class_index
        assert shard.instance_index[i] == sample.instance_index
        for name in ("seed", "camera", "occlusion", "purity"):
            assert getattr(shard, name)[i] == getattr(sample, name)
    assert [p.name for p in (directory / "shards").iterdir()] == ["00003.safetensors"]


def test_same_samples_give_the_same_bytes(tmp_path):
    one = write_shard(tmp_path / "a" / "shards" / "0.safetensors", _samples([4, 9]))
    two = write_shard(tmp_path / "b" / "shards" / "0.safetensors", _samples([4, 9]))
    assert one == two


def test_changed_truncated_or_missing_shard_is_named(tmp_path):
    record = write_shard(tmp_path / shard_name(0), _samples([5, 6]))
    path = tmp_path / record.file
    with pytest.raises(DatasetError, match=r"00001\.safetensors does not exist"):
        read_shard(tmp_path / shard_name(1))
    whole = path.read_bytes()
    for size in (len(whole) - 8, 100, 5):
        path.write_bytes(whole[:size])
        with pytest.raises(DatasetError, match=r"00000\.safetensors.*sha256.*makes missing and damaged shards anew"):
            read_shard(path, record)
        with pytest.raises(DatasetError, match=r"00000\.safetensors is not a readable"):
            read_shard(path, mapped=True)
    path.write_bytes(b"")
    with pytest.raises(DatasetError, match=r"00000\.safetensors is damaged"):
        read_shard(path, record, mapped=True)


def test_the_file_is_a_safetensors_file(tmp_path):
    samples = _samples([4, 9])
    path = tmp_path / write_shard(tmp_path / shard_name(0), samples).file
    tensors = load_file(path)  # the format's own reader
    shard = read_shard(path)
    assert set(tensors) == {"points", "offsets", "class_index", "instance_index", "camera", "seed"} | {
        "T_camera_object",
        "occlusion",
        "purity",
    }
    for name, tensor in tensors.items():
        np.testing.assert_array_equal(getattr(shard, name), tensor)


def test_cloud_with_nan_is_not_written(tmp_path):
    bad = CloudSample(np.array([[0, 0, np.nan]], np.float32), 0, 0, np.eye(4), 0)
    with pytest.raises(DatasetError, match="sample 0"):
        write_shard(tmp_path / shard_name(0), [bad])
    assert not (tmp_path / shard_name(0)).exists()


def test_manifest_comes_back_as_written(tmp_path):
    record = write_shard(tmp_path / shard_name(0), _samples([3]))
    manifest = Manifest(
        ["can"], [{"name": "can_0000", "class": "can"}], [{"name": "a"}], {"width": 424}, 7, {"pecgrasp": "0"}, [record]
    )
    write_manifest(tmp_path, manifest)
    assert read_manifest(tmp_path) == manifest


def test_broken_manifest_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"manifest\.json does not exist"):
        read_manifest(tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(DatasetError, match="not a manifest"):
        read_manifest(tmp_path)


@pytest.mark.parametrize(
    ("content", "made_by"), [({}, "unknown"), ({"generator": {"pecgrasp": "7.0"}, "new": 1}, "pecgrasp 7.0")]
)
def test_another_schema_is_refused_with_the_way_out(tmp_path, content, made_by):
    (tmp_path / "manifest.json").write_text(json.dumps({"schema_version": 99, **content}))
    with pytest.raises(DatasetError, match=rf"schema version 99, this package reads 2: generate.*anew.*{made_by}"):
        read_manifest(tmp_path)
