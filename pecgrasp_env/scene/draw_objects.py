"""Which objects lie on the table and which of them may be asked for, drawn by a generator of the sub-environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pecgrasp_env.objects import ObjectModel


def draw_classes(
    n_classes: int, n_objects: int, twins: bool, rng: np.random.Generator, wanted: int | None = None
) -> np.ndarray:
    """The class of each object, (n_objects,) indices below ``n_classes``.

    No class comes twice while there are enough of them. Where there are not, or with ``twins``, at least one class
    comes exactly as often as `askable` wants it, and the order says nothing about which. The class ``wanted`` is one of
    those; where it would have been anyway, nothing else changes.
    """
    order = rng.permutation(n_classes)
    kinds = min(n_objects - twins, n_classes)
    if kinds == n_objects:
        if wanted is not None and wanted not in order[:n_objects]:
            order[rng.integers(n_objects)] = wanted
        return order[:n_objects]
    if wanted is not None:
        place = int(np.flatnonzero(order == wanted)[0])
        order[[place, kinds - 1]] = order[[kinds - 1, place]]
    asked, others = order[kinds - 1], order[: kinds - 1]
    fill = [others[k % len(others)] for k in range(n_objects - kinds - twins)]
    return rng.permutation(np.array([*order[:kinds], *([asked] if twins else []), *fill]))


def askable(slot_classes: np.ndarray, twins: bool) -> np.ndarray:
    """Which of the objects (n_objects,) may be the asked-for one: those whose class is there once, with ``twins``
    twice. Returns their indices.
    """
    counts = np.bincount(slot_classes)[slot_classes]
    return np.flatnonzero(counts == (2 if twins else 1))


def draw_instances(
    source: Any, names: Sequence[str], rng: np.random.Generator, given: Sequence[int | None] | None = None
) -> list[ObjectModel]:
    """An instance of each class in ``names``; those of one class differ while the source has enough of them.

    source: a `Catalogue`, a `MeshFolder` or whatever has their ``names`` and ``load``. given: the number of the
    instance where it is not drawn.
    """
    given = [None] * len(names) if given is None else given
    models: list[ObjectModel] = []
    taken: dict[str, list[int]] = {}
    for name, number in zip(names, given, strict=True):
        if number is not None:
            taken.setdefault(name, []).append(number)
    for name, number in zip(names, given, strict=True):
        if number is None:
            known = taken.setdefault(name, [])
            free = [i for i in range(len(source.names(name))) if i not in known] or known
            number = free[int(rng.integers(len(free)))]
            known.append(number)
        models.append(source.load(name, number))
    return models
