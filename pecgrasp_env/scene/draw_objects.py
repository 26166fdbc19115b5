"""Which objects lie on the table and which of them may be asked for, drawn by a generator of the sub-environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from pecgrasp_env.objects import ObjectModel

MOST_OBJECTS = 8  # more do not fit apart into the part of the table that the camera sees from its home posture


def draw_classes(n_classes: int, n_objects: int, twins: bool, rng: np.random.Generator) -> np.ndarray:
    """The class of each object, (n_objects,) indices below ``n_classes``.

    No class comes twice while there are enough of them. Where there are not, or with ``twins``, at least one class
    comes exactly as often as `askable` wants it, and the order says nothing about which.
    """
    order = rng.permutation(n_classes)
    kinds = min(n_objects - twins, n_classes)
    if kinds == n_objects:
        return order[:n_objects]
    asked, others = order[kinds - 1], order[: kinds - 1]
    fill = [others[k % len(others)] for k in range(n_objects - kinds - twins)]
    return rng.permutation(np.array([*order[:kinds], *([asked] if twins else []), *fill]))


def askable(slot_classes: np.ndarray, twins: bool) -> np.ndarray:
    """Which of the objects (n_objects,) may be the asked-for one: those whose class is there once, with ``twins``
    twice. Returns their indices.
    """
    counts = np.bincount(slot_classes)[slot_classes]
    return np.flatnonzero(counts == (2 if twins else 1))


def draw_instances(source: Any, names: list[str], rng: np.random.Generator) -> list[ObjectModel]:
    """An instance of each class in ``names``; those of one class differ while the source has enough of them.

    source: a `Catalogue`, a `MeshFolder` or whatever has their ``names`` and ``load``.
    """
    models: list[ObjectModel] = []
    taken: dict[str, list[int]] = {}
    for name in names:
        known = taken.setdefault(name, [])
        free = [i for i in range(len(source.names(name))) if i not in known] or known
        chosen = free[int(rng.integers(len(free)))]
        known.append(chosen)
        models.append(source.load(name, chosen))
    return models
