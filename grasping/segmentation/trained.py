"""The trees that come with the package, and those of a file of one's own."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from grasping.segmentation.boosted_trees import Relations, read_relations
from grasping.segmentation.group_features import OF_GROUP
from grasping.segmentation.pair_features import AT_BORDER, OF_BOTH

TRAINED = Path(__file__).with_name("relations.npz")
NAMES: dict[str, tuple[str, ...]] = {
    "near": (*AT_BORDER, *OF_BOTH),
    "far": tuple(OF_BOTH),
    "near_again": (*AT_BORDER, *OF_BOTH),
    "far_again": tuple(OF_BOTH),
    "thing": tuple(OF_GROUP),
    "whole": tuple(OF_GROUP),
}


@lru_cache(maxsize=4)
def trained_relations(path: Path | None = None) -> Relations:
    """Read the trees of a file, by default of the one that is part of the package. Raises ConfigError for another."""
    return read_relations(path or TRAINED, NAMES)
