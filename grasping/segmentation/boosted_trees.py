"""Gradient-boosted decision trees as arrays in a file: read and asked here, made by `pecgrasp train-segmenter`."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping.errors import DAMAGED_NPZ, ConfigError
from grasping.segmentation import kernels

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

FORMAT = 2
KINDS = ("near", "far", "near_again", "far_again", "thing", "whole")
ARRAYS = ("feature", "threshold", "left", "right", "missing_left", "value", "start")


@dataclass(frozen=True)
class BoostedTrees:
    """Nodes (K,) of all trees, each tree's after the last one's. feature: what is asked, −1 in a leaf; a value of at
    most threshold goes on to the node `left`, others to `right`, NaN where missing_left says. value: a leaf's part of
    the log odds. start: (T,) the trees' first nodes. baseline: the log odds before any tree.
    """

    feature: NDArray[np.int32]
    threshold: Float32Array
    left: NDArray[np.int32]
    right: NDArray[np.int32]
    missing_left: NDArray[np.int32]
    value: FloatArray
    start: NDArray[np.int32]
    baseline: float

    def log_odds(self, features: Float32Array) -> FloatArray:
        """(P,) for rows of features (P, F), NaN where one is not known."""
        features = np.ascontiguousarray(features, dtype=np.float32)
        if kernels.compiled is not None:
            odds = np.full(len(features), self.baseline)
            kernels.compiled.add_trees(self._packed, features, odds)
            return odds
        return self.log_odds_reference(features)

    @cached_property
    def _packed(self) -> Any:
        """The same as the kernel reads it, made once."""
        nodes = (self.feature, self.threshold, self.left, self.right, self.missing_left, self.value, self.start)
        return kernels.compiled.pack_trees(*nodes)  # type: ignore[union-attr]

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # what is packed stays in its process

    def log_odds_reference(self, features: Float32Array) -> FloatArray:
        """`log_odds` in NumPy."""
        rows = np.arange(len(features))[:, None]
        node = np.tile(self.start, (len(features), 1))
        while True:
            asked = self.feature[node]
            inner = asked >= 0
            if not inner.any():
                break
            known = features[rows, np.maximum(asked, 0)]
            to_left = np.where(np.isnan(known), self.missing_left[node] > 0, known <= self.threshold[node])
            node = np.where(inner, np.where(to_left, self.left[node], self.right[node]), node)
        odds = np.full(len(features), self.baseline)
        for part in self.value[node].T:  # one tree after the other, as C adds
            odds += part
        return odds


@dataclass(frozen=True)
class Relations:
    """What trees say of patches and of groups of them.

    near, far: whether two patches are of one object, of those that adjoin and of those that do not. near_again,
    far_again: the same of the parts that patches make in a first grouping. thing: whether a
    group is anything but a wrinkle of the table or of the background. whole: whether it is one thing, all that is seen
    of it. about: where the trees come from: data, its hash, metrics.
    """

    near: BoostedTrees
    far: BoostedTrees
    near_again: BoostedTrees
    far_again: BoostedTrees
    thing: BoostedTrees
    whole: BoostedTrees
    about: dict[str, Any]


def write_relations(path: Path, relations: Relations, names: dict[str, tuple[str, ...]]) -> None:
    """Write an .npz file with the metadata as JSON in it. names: of the features that each kind of trees asks for."""
    arrays: dict[str, NDArray] = {}
    for name in KINDS:
        trees = getattr(relations, name)
        arrays |= {f"{name}_{key}": getattr(trees, key) for key in ARRAYS}
        arrays[f"{name}_baseline"] = np.float64(trees.baseline)
    head = {"format": FORMAT, "names": {name: list(names[name]) for name in KINDS}, "about": relations.about}
    arrays["head"] = np.frombuffer(json.dumps(head, sort_keys=True).encode(), dtype=np.uint8)
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_relations(path: Path, names: dict[str, tuple[str, ...]]) -> Relations:
    """Read what `write_relations` wrote for these features. Raises ConfigError where it was written for others."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        head = json.loads(arrays["head"].tobytes())
        trees = {name: _trees(arrays, name) for name in KINDS}
    except FileNotFoundError as error:
        raise ConfigError(f"relations = {path}: there is no such file") from error
    except DAMAGED_NPZ as error:
        raise ConfigError(f"relations = {path}: not a file of pecgrasp train-segmenter ({error})") from error
    if head["format"] != FORMAT or head["names"] != {name: list(names[name]) for name in KINDS}:
        way_out = "train it again with pecgrasp train-segmenter"
        raise ConfigError(f"relations = {path}: its trees ask for other features than this version knows; {way_out}")
    return Relations(**trees, about=head["about"])


def _trees(arrays: dict[str, NDArray], name: str) -> BoostedTrees:
    return BoostedTrees(**{key: arrays[f"{name}_{key}"] for key in ARRAYS}, baseline=float(arrays[f"{name}_baseline"]))
