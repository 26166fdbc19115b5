"""One's own labelled clouds as one .npz of plain arrays, of equal or unequal length, without pickles.

    points       (n, P, 3)          clouds of equally many points, metres; or
                 (M, 3)             all clouds one after the other, with
    offsets      (n + 1,) integers  cloud i is points[offsets[i]:offsets[i + 1]]
    labels       (n,)               one a cloud: numbers into class_names, or the names themselves
    class_names  (C,) strings       may be missing where the labels are names
    instances    (n,)               which clouds are of one object, as numbers or names; missing: each is its own

Of six columns the first three are the points (colours or a normal stand behind), and rows that are not finite are left
out: `LabelledArrays.remarks` counts them.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pec.common.atomic_files import replacing
from pec.common.damaged_npz import DAMAGED_NPZ
from pec.data.dataset import CloudDataset
from pec.errors import DatasetError

__all__ = ["FORM", "LabelledArrays", "read_arrays", "read_labelled", "write_labelled"]

FORM = (
    "expected points (n, P, 3), or points (M, 3) with offsets (n + 1,); labels (n,), one a cloud; class_names (C,); "
    "see docs/own_objects.md"
)


@dataclass(frozen=True)
class LabelledArrays:
    """remarks: what was left out, and why."""

    dataset: CloudDataset
    remarks: list[str]


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a .npz. Raises DatasetError where it is missing, broken, or holds Python objects."""
    if not path.is_file():
        raise DatasetError(f"{path} does not exist")
    name = ""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {}
            for name in archive.files:
                arrays[name] = archive[name]
            return arrays
    except DAMAGED_NPZ as error:
        if "allow_pickle" in str(error):
            raise DatasetError(
                f"{path}: array {name!r} holds Python objects, which are not unpickled. Clouds of unequal length: "
                "points=np.concatenate(clouds), offsets=np.cumsum([0, *map(len, clouds)])"
            ) from error
        raise DatasetError(f"{path} is not a readable .npz: {error}") from error


def read_labelled(path: str | os.PathLike[str], arrays: dict[str, np.ndarray] | None = None) -> LabelledArrays:
    """The clouds of a .npz as the module's docstring says. Raises DatasetError that says what is not of this form."""
    path = Path(path)
    arrays = read_arrays(path) if arrays is None else arrays
    for name in ("points", "labels"):
        if name not in arrays:
            there = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())[:200]
            raise DatasetError(f"{path} has no array {name!r}, only {there or 'none'}: {FORM}")
    clouds = _clouds(path, arrays["points"], arrays.get("offsets"), arrays["labels"])
    n = len(clouds)
    labels, classes = _labels(path, arrays["labels"], arrays.get("class_names"), n)
    named = arrays.get("instances", np.arange(n))
    if named.shape != (n,) or named.dtype.kind not in "iuUS":
        raise DatasetError(f"{path}: instances {_form(named)}, expected ({n},) numbers or names: one a cloud")
    _, instances = np.unique(np.rec.fromarrays([labels, named]), return_inverse=True)
    finite = [np.isfinite(cloud).all(axis=1) for cloud in clouds]
    lost = np.array([len(mask) - np.count_nonzero(mask) for mask in finite])
    remarks = [str(remark) for remark in arrays.get("remarks", [])]
    if lost.any():
        first = int(np.flatnonzero(lost)[0])
        row = int(np.flatnonzero(~finite[first])[0])
        where = f"clouds: {np.count_nonzero(lost)}, first {first}, row {row}"
        remarks.append(f"left out: {lost.sum()} rows that are not finite; {where}")
        clouds = [cloud[mask] for cloud, mask in zip(clouds, finite, strict=True)]
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return LabelledArrays(
        CloudDataset(classes, clouds, labels, instances.reshape(-1).astype(np.int64), digest), remarks
    )


def write_labelled(
    path: str | os.PathLike[str],
    clouds: Sequence[np.ndarray],
    labels: Sequence[int],
    instances: Sequence[str],
    class_names: Sequence[str],
    remarks: Sequence[str] = (),
) -> None:
    """Write clouds (N, 3) of any lengths in this form, atomically; the same clouds give the same bytes."""
    arrays: dict[str, Any] = {
        "points": np.concatenate([np.empty((0, 3), np.float32), *clouds]).astype(np.float32),
        "offsets": np.cumsum([0, *map(len, clouds)], dtype=np.int64),
        "labels": np.array(labels, np.int64),
        "class_names": np.array(class_names, dtype=np.str_),
        "instances": np.array(instances, dtype=np.str_),
        "remarks": np.array(remarks, dtype=np.str_),
    }
    with replacing(Path(path)) as temporary, open(temporary, "wb") as file:
        np.savez(file, **arrays)


def _form(array: np.ndarray) -> str:
    return f"{array.shape} of {array.dtype}"


def _clouds(path: Path, points: np.ndarray, offsets: np.ndarray | None, labels: np.ndarray) -> list[np.ndarray]:
    """(N, 3) float32 each."""
    if points.dtype.kind not in "fiu" or points.ndim not in (2, 3) or points.shape[-1] not in (3, 6):
        hint = ""
        if points.ndim in (2, 3) and points.shape[-1] == 4:
            hint = "; is the last column a label? Labels stand in labels, one a cloud"
        elif points.ndim == 3 and points.shape[1] == 3:
            hint = "; coordinates stand in rows: save points.transpose(0, 2, 1)"
        raise DatasetError(f"{path}: points {_form(points)}{hint}: {FORM}")
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32: not finite
        points = points[..., :3].astype(np.float32)
    if points.ndim == 3:
        if offsets is not None:
            raise DatasetError(f"{path}: points {points.shape} need no offsets: {FORM}")
        return list(points)
    m = len(points)
    if offsets is None:
        hint = " (labels are one a cloud, not one a point)" if labels.shape == (m,) else ""
        raise DatasetError(f"{path}: points {points.shape} need offsets, where each cloud begins{hint}: {FORM}")
    if offsets.ndim != 1 or offsets.dtype.kind not in "iu" or len(offsets) < 2:
        raise DatasetError(f"{path}: offsets {_form(offsets)}, expected whole numbers (n + 1,)")
    steps = np.diff(offsets.astype(np.int64))
    if offsets[0] != 0 or offsets[-1] != m or (steps < 0).any():
        raise DatasetError(
            f"{path}: offsets from {offsets[0]} to {offsets[-1]} must rise from 0 to {m}, the rows of points: "
            "np.cumsum([0, *map(len, clouds)])"
        )
    return np.split(points, offsets[1:-1])


def _labels(path: Path, labels: np.ndarray, names: np.ndarray | None, n: int) -> tuple[np.ndarray, list[str]]:
    """(n,) int64 into the names of the classes, and those."""
    if labels.shape == (n, 1):
        labels = labels[:, 0]
    if labels.shape != (n,):
        hint = "; of a column a class save labels.argmax(axis=1)" if labels.ndim == 2 and len(labels) == n else ""
        raise DatasetError(f"{path}: labels {labels.shape} for {n} clouds, expected ({n},): one a cloud{hint}")
    if names is not None and (names.ndim != 1 or names.dtype.kind not in "US"):
        raise DatasetError(f"{path}: class_names {_form(names)}, expected strings (C,)")
    classes = None if names is None else [_text(name) for name in names]
    if labels.dtype.kind in "US":
        words = [_text(label) for label in labels]
        classes = sorted(set(words)) if classes is None else classes
        for row, word in enumerate(words):
            if word not in classes:
                raise DatasetError(
                    f"{path}: labels[{row}] = {word!r} is none of class_names, {', '.join(classes)[:200]}"
                )
        return np.array([classes.index(word) for word in words], np.int64), classes
    if classes is None:
        raise DatasetError(f"{path}: labels of {labels.dtype} need class_names (C,), the names of the classes")
    if labels.dtype.kind not in "fiu" or (labels != np.floor(labels)).any():
        raise DatasetError(f"{path}: labels {_form(labels)}, expected whole numbers or names")
    wrong = np.flatnonzero((labels < 0) | (labels >= len(classes)))
    if len(wrong):
        raise DatasetError(
            f"{path}: labels[{wrong[0]}] = {labels[wrong[0]]:g} is none of 0 to {len(classes) - 1}, as class_names has "
            f"{len(classes)}"
        )
    return labels.astype(np.int64), classes


def _text(word: Any) -> str:
    return word.decode(errors="replace") if isinstance(word, bytes) else str(word)
