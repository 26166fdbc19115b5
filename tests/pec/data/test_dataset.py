"""Loading, choosing from and damaging data sets."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pec.data import loading
from pec.data.dataset import remove_around_random_point
from pec.data.loading import load_dataset
from pec.data.shards import read_manifest, write_manifest
from pec.data.tensor_dataset import prepare
from pec.errors import DatasetError
from pec.preprocessing.preprocess import Preprocess


def test_generated_set_is_loaded_whole(shapes):
    dataset = load_dataset(shapes)
    assert dataset.classes == ["ball", "plate", "rod"]
    assert len(dataset) == 120
    assert np.bincount(dataset.labels).tolist() == [40, 40, 40]
    assert np.bincount(dataset.instances).tolist() == [20] * 6
    assert all(dataset.cloud(i).shape == (200, 3) for i in range(120))


def test_clouds_are_read_only_views_of_the_files(shapes):
    dataset = load_dataset(shapes)
    owner = dataset.cloud(7)
    while isinstance(owner.base, np.ndarray):
        owner = owner.base
    assert isinstance(owner, np.memmap)
    assert not dataset.cloud(7).flags.writeable
    assert dataset.offsets.tolist() == list(range(0, 120 * 200 + 1, 200))
    assert dataset.subset(np.array([7, 3])).cloud(1) is dataset.cloud(3)


def test_shards_beyond_those_that_may_stay_open_are_the_same(shapes, monkeypatch):
    mapped = load_dataset(shapes)
    monkeypatch.setattr(loading, "_MOST_MAPPED", 1)
    read = load_dataset(shapes)
    assert all(np.array_equal(a, b) for a, b in zip(mapped.clouds, read.clouds, strict=True))


def test_a_damaged_shard_is_named_with_the_way_out(shapes, tmp_path):
    shutil.copytree(shapes, tmp_path / "data")
    path = tmp_path / "data" / "shards" / "00001.safetensors"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(
        DatasetError, match=rf"{path} is not the file that the manifest lists.*makes.*damaged shards anew"
    ):
        load_dataset(tmp_path / "data")


def test_chosen_classes_keep_their_clouds(shapes):
    whole, part = load_dataset(shapes), load_dataset(shapes, ["rod", "ball"], samples_per_instance=5)
    assert part.classes == ["rod", "ball"]
    assert np.bincount(part.labels).tolist() == [10, 10]
    first_rod = int(np.flatnonzero(whole.labels == 2)[0])
    np.testing.assert_array_equal(part.cloud(int(np.flatnonzero(part.labels == 0)[0])), whole.cloud(first_rod))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"classes": ["teapot"]}, "no class 'teapot'; it has ball, plate, rod"), ({"min_points": 500}, "at least 500")],
)
def test_what_the_set_lacks_is_named(shapes, arguments, message):
    with pytest.raises(DatasetError, match=message):
        load_dataset(shapes, **arguments)


def test_missing_and_unfinished_sets_are_errors(shapes, tmp_path):
    with pytest.raises(DatasetError, match="does not exist"):
        load_dataset(tmp_path)
    with pytest.raises(DatasetError, match=r"x\.npz does not exist"):
        load_dataset(tmp_path / "x.npz")
    write_manifest(tmp_path, replace(read_manifest(shapes), complete=False))
    with pytest.raises(DatasetError, match="unfinished"):
        load_dataset(tmp_path)


def modelnet(n_train, n_test):
    """The arrays of an archive of two classes in turn."""
    rng = np.random.default_rng(0)
    arrays = {"class_names": np.array(["bed", "desk"])}
    for part, n in (("train", n_train), ("test", n_test)):
        arrays[f"{part}_points"] = rng.normal(size=(n, 80, 3)).astype(np.float16)
        arrays[f"{part}_labels"] = np.arange(n, dtype=np.uint8) % 2
    return arrays


def test_modelnet_archive_brings_its_own_split(tmp_path):
    arrays = modelnet(6, 4)
    np.savez(tmp_path / "m.npz", **arrays)
    dataset = load_dataset(tmp_path / "m.npz")
    assert dataset.official_test is not None
    assert np.flatnonzero(dataset.official_test).tolist() == [6, 7, 8, 9]
    np.testing.assert_array_equal(dataset.cloud(7), arrays["test_points"][1].astype(np.float32))


def test_modelnet_clouds_get_the_size_of_their_meshes_back(tmp_path):
    """An inch for each unit of the file; the split, the labels and the order stay."""
    arrays = modelnet(3, 2)
    np.savez(tmp_path / "bare.npz", **arrays)
    with pytest.raises(DatasetError, match=r"dataset\.size=mesh: these clouds come without the sizes"):
        load_dataset(tmp_path / "bare.npz", size="mesh")
    arrays |= {"train_scale": np.array([10, 20, 30], np.float32), "test_scale": np.array([40, 50], np.float32)}
    np.savez(tmp_path / "m.npz", **arrays)
    stored, sized = load_dataset(tmp_path / "m.npz"), load_dataset(tmp_path / "m.npz", ["desk", "bed"], size="mesh")
    for i, radius in enumerate((10, 20, 30, 40, 50)):
        np.testing.assert_allclose(sized.cloud(i), stored.cloud(i) * radius * 0.0254, rtol=1e-6)
    assert sized.fingerprint != stored.fingerprint
    assert sized.labels.tolist() == [1, 0, 1, 1, 0]


def test_clouds_that_a_camera_took_are_metric_already(shapes):
    stored, sized = load_dataset(shapes), load_dataset(shapes, size="mesh")
    assert all(np.array_equal(one, other) for one, other in zip(stored.clouds, sized.clouds, strict=True))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_defect_removes_a_neighbourhood(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(100, 3))
    kept = remove_around_random_point(points, 0.4, rng)
    assert 60 < len(kept) <= 100
    rows = {tuple(row) for row in points}
    gone = np.array(sorted(rows - {tuple(row) for row in kept}))
    assert len(gone) == 100 - len(kept)
    if len(gone):  # some removed point has no kept point nearer than the farthest removed one
        to_gone = np.linalg.norm(gone[:, None] - gone, axis=2).max(axis=1)
        to_kept = np.linalg.norm(gone[:, None] - kept, axis=2).min(axis=1)
        assert (to_gone <= to_kept).any()


def test_cache_gives_the_same_clouds_and_other_settings_another_cache(shapes, tmp_path):
    dataset = load_dataset(shapes)
    fresh = prepare(dataset, Preprocess(), cache=tmp_path)
    assert len(list(tmp_path.iterdir())) == 1
    again = prepare(dataset, Preprocess(), cache=tmp_path)
    assert fresh.candidates.equal(again.candidates)
    assert fresh.valid.all()
    prepare(dataset, Preprocess(group_size=8), cache=tmp_path)  # sampling is the same, only the order differs
    assert len(list(tmp_path.iterdir())) == 1
    prepare(dataset, Preprocess(), cache=tmp_path, removed=0.4)
    prepare(dataset, Preprocess(), cache=tmp_path, seed=1)
    assert len(list(tmp_path.iterdir())) == 3


def test_cut_short_cache_is_made_again(shapes, tmp_path):
    dataset = load_dataset(shapes)
    fresh = prepare(dataset, Preprocess(), cache=tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:1000])
    assert prepare(dataset, Preprocess(), cache=tmp_path).candidates.equal(fresh.candidates)
