"""What a training of the segmenter has come to, kept in files, so that the same command goes on where it was stopped.

FOLDER/run.json    what decides all of it: data, seed, code
FOLDER/NAME.npz    what one share of the frames gives, for each kind of examples: KIND_features (n, F) float32, KIND_so
                   (n,) bool, KIND_weight (n,) float64; or trees, as `write_relations` writes them

A file lies there whole or not at all; what is not there, or damaged, is made.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping.errors import DAMAGED_NPZ
from grasping.errors import ConfigError as RelationsError
from grasping.segmentation.boosted_trees import Relations, read_relations, write_relations
from grasping.segmentation.trained import NAMES
from pec.common.atomic_files import replacing, write_json, write_whole
from pec.common.run_identity import first_difference
from pec.errors import ConfigError

__all__ = ["Examples", "KeptExamples", "check_same", "write_trees"]


@dataclass
class Examples:
    """Rows of features, whether what is asked is so, and each row's weight."""

    features: list[NDArray[np.float32]] = field(default_factory=list)
    so: list[NDArray[np.bool_]] = field(default_factory=list)
    weight: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, features: NDArray[np.float32], so: NDArray[np.bool_], weight: NDArray[np.float64]) -> None:
        used = weight > 0
        self.features.append(features[used])
        self.so.append(so[used])
        self.weight.append(weight[used])

    def __add__(self, other: Examples) -> Examples:
        return Examples(self.features + other.features, self.so + other.so, self.weight + other.weight)

    def arrays(self) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float64]]:
        return np.concatenate(self.features), np.concatenate(self.so), np.concatenate(self.weight)


@dataclass(frozen=True)
class KeptExamples:
    """The files of one run, in a folder that is made for them."""

    folder: Path

    @classmethod
    def of_run(cls, folder: Path, run: Mapping[str, Any]) -> KeptExamples:
        """The folder's files, if they are of this run. Raises ConfigError where they are of another."""
        record = folder / "run.json"
        if record.is_file():
            check_same(folder.parent, json.loads(record.read_text()), run)
        write_json(record, dict(run))
        return cls(folder)

    def __contains__(self, name: str) -> bool:
        return self._file(name).is_file()

    def examples(self, name: str, make: Callable[[], dict[str, Examples]]) -> dict[str, Examples]:
        """The examples of each kind that are kept by this name, or else those that `make` gives."""
        try:
            with np.load(self._file(name), allow_pickle=False) as kept:
                return {kind: _read(kept, kind) for kind in kept["kinds"].tolist()}
        except DAMAGED_NPZ:
            pass
        made = make()
        arrays: dict[str, NDArray] = {"kinds": np.array(list(made))}
        for kind, found in made.items():
            if found.features:
                features, so, weight = found.arrays()
                arrays |= {f"{kind}_features": features, f"{kind}_so": so, f"{kind}_weight": weight}
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
        write_whole(self._file(name), buffer.getvalue())
        return made

    def trees(self, name: str, make: Callable[[], Relations]) -> Relations:
        """The trees that are kept by this name, or else those that `make` gives."""
        try:
            return read_relations(self._file(name), NAMES)
        except RelationsError:
            made = make()
            write_trees(self._file(name), made)
            return made

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.npz"


def write_trees(path: Path, relations: Relations) -> None:
    """`write_relations`, whole or not at all."""
    with replacing(path) as temporary:
        write_relations(temporary, relations, NAMES)


def check_same(output: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """ConfigError where what output holds was made by other settings, data or code than asked for now."""
    difference = first_difference({name: before.get(name) for name in now}, now)
    if difference is not None:
        raise ConfigError(f"output {output} holds a run with {difference}: choose another output, or delete it")


def _read(kept: Mapping[str, NDArray], kind: str) -> Examples:
    if f"{kind}_features" not in kept:  # none of the share's frames gave any
        return Examples()
    return Examples([kept[f"{kind}_features"]], [kept[f"{kind}_so"]], [kept[f"{kind}_weight"]])
