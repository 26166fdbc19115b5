"""One's own clouds as one .npz: what is unambiguous is read, everything else says which form is expected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pec.data.labelled_arrays import read_labelled, write_labelled
from pec.data.loading import data_version, load_dataset
from pec.errors import DatasetError

RNG = np.random.default_rng(0)
POINTS = RNG.random((6, 5, 3)).astype(np.float32)
LABELS = np.array([0, 1, 0, 1, 1, 0])
NAMES = np.array(["mug", "can"])
RAGGED = [POINTS[i, : 5 - i % 3] for i in range(6)]
FLAT: dict[str, Any] = {"points": np.concatenate(RAGGED), "offsets": np.cumsum([0, *map(len, RAGGED)])}


def save(path: Path, **arrays: Any) -> Path:
    np.savez(path / "own.npz", **{"points": POINTS, "labels": LABELS, "class_names": NAMES, **arrays})
    return path / "own.npz"


def without(path: Path, *names: str, **arrays: Any) -> Path:
    kept = {"points": POINTS, "labels": LABELS, "class_names": NAMES, **arrays}
    np.savez(path / "own.npz", **{name: array for name, array in kept.items() if name not in names})
    return path / "own.npz"


@pytest.mark.parametrize(
    "arrays",
    [
        {},
        {"points": POINTS.astype(np.float64)},
        {"points": np.concatenate([POINTS, POINTS[..., ::-1]], axis=2)},  # a colour behind
        {"labels": LABELS[:, None]},
        {"labels": LABELS.astype(float)},
        {"labels": NAMES[LABELS]},
        {"labels": NAMES[LABELS].astype("S")},
        {"points": POINTS.reshape(-1, 3), "offsets": np.arange(0, 31, 5)},
    ],
)
def test_clouds_and_labels_come_back(tmp_path: Path, arrays: dict[str, Any]) -> None:
    dataset = load_dataset(save(tmp_path, **arrays))
    assert dataset.classes == ["mug", "can"]
    np.testing.assert_array_equal(dataset.labels, LABELS)
    np.testing.assert_array_equal(np.stack(dataset.clouds), POINTS)
    assert len(np.unique(dataset.instances)) == 6  # nothing says that two are of one object


def test_clouds_of_unequal_length_need_no_pickle(tmp_path: Path) -> None:
    dataset = load_dataset(save(tmp_path, **FLAT))
    for cloud, written in zip(dataset.clouds, RAGGED, strict=True):
        np.testing.assert_array_equal(cloud, written)


def test_instances_are_of_one_class_each_and_named_as_one_likes(tmp_path: Path) -> None:
    dataset = load_dataset(save(tmp_path, instances=np.array(["a", "a", "a", "b", "a", "c"])))
    a_mug, a_can = dataset.instances[0], dataset.instances[1]
    assert dataset.instances.tolist() == [a_mug, a_can, a_mug, dataset.instances[3], a_can, dataset.instances[5]]
    assert len({a_mug, a_can, dataset.instances[3], dataset.instances[5]}) == 4


def test_names_of_classes_may_come_from_the_labels(tmp_path: Path) -> None:
    dataset = load_dataset(without(tmp_path, "class_names", labels=NAMES[LABELS]))
    assert [dataset.classes[label] for label in dataset.labels] == NAMES[LABELS].tolist()


def test_rows_that_are_not_finite_are_left_out_and_counted(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[2, 1, 0], points[2, 4, 1], points[5, 0, 2] = np.nan, np.inf, -np.inf
    labelled = read_labelled(save(tmp_path, points=points))
    assert [len(cloud) for cloud in labelled.dataset.clouds] == [5, 5, 3, 5, 5, 4]
    np.testing.assert_array_equal(labelled.dataset.clouds[2], POINTS[2, [0, 2, 3]])
    assert labelled.remarks == ["left out: 3 rows that are not finite; clouds: 2, first 2, row 1"]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"points": np.zeros((6, 5, 4))}, r"points \(6, 5, 4\) .* last column a label.*: expected points \(n, P, 3\)"),
        ({"points": np.zeros((30, 4))}, r"points \(30, 4\) .* last column a label"),
        ({"points": np.zeros((6, 3, 50))}, r"save points.transpose\(0, 2, 1\)"),
        ({"points": np.array([*RAGGED, None], dtype=object)[:6]}, r"'points' holds Python objects.*np.cumsum"),
        ({"points": np.concatenate(RAGGED)}, r"need offsets, where each cloud begins: expected"),
        ({"points": np.zeros((6, 3))}, r"need offsets.*labels are one a cloud, not one a point"),
        ({**FLAT, "offsets": FLAT["offsets"][:-1]}, r"offsets from 0 to \d+ must rise from 0 to 24"),
        ({**FLAT, "offsets": FLAT["offsets"][::-1]}, "must rise from 0 to 24"),
        ({**FLAT, "offsets": FLAT["offsets"] / 2}, r"offsets \(7,\) of float64, expected whole numbers"),
        ({"offsets": np.arange(7)}, r"points \(6, 5, 3\) need no offsets"),
        ({"labels": LABELS[:5]}, r"labels \(5,\) for 6 clouds, expected \(6,\)"),
        ({"labels": np.eye(2)[LABELS]}, r"labels \(6, 2\) .*labels.argmax\(axis=1\)"),
        ({"labels": LABELS + 1}, r"labels\[1\] = 2 is none of 0 to 1"),
        ({"labels": LABELS + 0.5}, "expected whole numbers or names"),
        ({"labels": np.array(["mug", "can", "cup"] * 2)}, r"labels\[2\] = 'cup' is none of class_names"),
        ({"class_names": np.arange(2)}, r"class_names \(2,\) of int64, expected strings"),
        ({"instances": np.arange(5)}, r"instances \(5,\) of int64, expected \(6,\)"),
    ],
)
def test_another_form_is_refused_with_the_expected_one(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        load_dataset(save(tmp_path, **arrays))


def test_what_is_missing_is_named_beside_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(
        DatasetError, match=r"no array 'points', only labels \(6,\), .*data \(6, 5, 3\): expected points"
    ):
        load_dataset(without(tmp_path, "points", data=POINTS))
    with pytest.raises(DatasetError, match=r"need class_names \(C,\)"):
        load_dataset(without(tmp_path, "class_names"))
    (tmp_path / "torn.npz").write_bytes(b"PK\3\4")
    with pytest.raises(DatasetError, match=r"torn.npz is not a readable .npz"):
        load_dataset(tmp_path / "torn.npz")
    (tmp_path / "own.npy").touch()
    with pytest.raises(DatasetError, match=r"own.npy is no data set: a folder, or a .npz"):
        load_dataset(tmp_path / "own.npy")


def test_the_same_clouds_are_written_as_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write_labelled(tmp_path / name, RAGGED, LABELS.tolist(), list("aabbcd"), NAMES.tolist(), ["one was torn"])
    assert data_version(tmp_path / "a.npz") == data_version(tmp_path / "b.npz")
    labelled = read_labelled(tmp_path / "a.npz")
    assert labelled.remarks == ["one was torn"]
    for cloud, written in zip(labelled.dataset.clouds, RAGGED, strict=True):
        np.testing.assert_array_equal(cloud, written)
