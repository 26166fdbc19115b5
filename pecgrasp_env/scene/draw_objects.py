"""Which objects lie on the table and which of them may be asked for, drawn by a generator of the sub-environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.objects.strangers import Strangers
from pecgrasp_env.scene.placement import PlacementError, can_rest

STRANGER = -1  # instead of the index of a class
_ROOM_M2, _AIR_M = 0.17, 0.03  # of the table that objects may cover, each with so much air, and still find places
_SMALL_M2 = 0.015  # what is kept free for each stranger to come
_LOOKED_AT = 50  # strangers, for one that fits


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
    """Which of the objects (K,) may be the asked-for one: those whose class is there once, with ``twins`` twice; never
    a stranger, whose class is `STRANGER`. Returns their indices.
    """
    known = slot_classes != STRANGER
    counts = np.bincount(slot_classes[known], minlength=1)[slot_classes]
    return np.flatnonzero(known & (counts == (2 if twins else 1)))


def leave_out(
    n_classes: int, rng: np.random.Generator, wanted: int | None, absent: bool | None, chance: float
) -> tuple[list[int], int | None]:
    """The classes that may lie there where one stays away, and which of them, by its place, has to be there.

    wanted: the class that is asked for, None: it is drawn later, among those there or those away. absent: whether it is
    the one that stays away; None: with the probability ``chance``.
    """
    if wanted is None:
        away = int(rng.integers(n_classes))
    elif rng.random() < chance if absent is None else absent:
        away = wanted
    else:
        away = (wanted + 1 + int(rng.integers(n_classes - 1))) % n_classes
    there = [k for k in range(n_classes) if k != away]
    return there, None if wanted in (None, away) else there.index(wanted)


def mix_in(known: list[ObjectModel], strangers: list[ObjectModel], rng: np.random.Generator) -> list[ObjectModel]:
    """All of them, the known ones in their order, and strangers anywhere between: a number tells nothing."""
    places = set(rng.choice(len(known) + len(strangers), len(strangers), replace=False).tolist())
    of_known, of_strangers = iter(known), iter(strangers)
    return [next(of_strangers if k in places else of_known) for k in range(len(known) + len(strangers))]


def draw_strangers(
    source: Strangers,
    n: int,
    beside: Sequence[ObjectModel],
    rng: np.random.Generator,
    given: Sequence[int] | None = None,
) -> list[ObjectModel]:
    """``n`` strangers, different ones while there are enough, and none that leaves no room for the others and those
    ``beside`` them, as long as there are smaller ones. given: their numbers, where they are not drawn.

    Raises PlacementError where all of them roll on and never rest, as balls do, which are not drawn.
    """
    if given is not None:
        return [source.load(i) for i in given]
    models: list[ObjectModel] = []
    room = _ROOM_M2 - sum(map(_footprint, beside))
    while len(models) < n:
        drawn = len(models)
        large: list[ObjectModel] = []
        for i in rng.permutation(len(source.names))[:_LOOKED_AT].tolist():
            model = source.load(i)
            if len(models) == n or not can_rest(model):
                continue
            if _footprint(model) + (n - len(models) - 1) * _SMALL_M2 <= room:
                models.append(model)
                room -= _footprint(model)
            else:
                large.append(model)
        if len(models) == drawn and not large:
            raise PlacementError(f"strangers: none of {len(source.names)} comes to rest on a table")
        if len(models) == drawn:
            models.append(min(large, key=_footprint))
    return models


def _footprint(model: ObjectModel) -> float:
    """m² of the table that an object takes as it usually lies, with some air around it."""
    shorter, longer = np.sort(model.extents)[1:] + _AIR_M
    return float(shorter * longer)


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
