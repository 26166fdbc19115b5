"""Draws strangers: of any form, or near given classes, never a thing that is one of them in all but name.

A stranger is left out and drawn again where it is kin by name (a cup is kin of a mug, so where there are mugs, no cups
are drawn) or too much alike by shape and size to a member of a class. So a folder of one's own meshes needs no word of
what is kin of what.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.model import Draft, ObjectModel, assemble
from pecgrasp_env.objects.procedural.catalogue import CLASSES, make_object
from pecgrasp_env.objects.procedural.primitives import PRIMITIVES
from pecgrasp_env.objects.procedural.strangers import assembled, blended, jointed, slender
from pecgrasp_env.objects.procedural.strangers.kin import kin_of
from pecgrasp_env.objects.procedural.strangers.likeness import Likeness
from pecgrasp_env.objects.procedural.strangers.near import deformed, fragment, fused
from pecgrasp_env.objects.strangers import UNKNOWN

__all__ = ["FORMS", "DrawnStrangers", "stranger", "strangers_for"]

FORMS: dict[str, Callable[[np.random.Generator], Draft]] = {
    **PRIMITIVES,
    **{name: getattr(assembled, name) for name in assembled.__all__},
    **{name: getattr(blended, name) for name in blended.__all__},
    **{name: getattr(jointed, name) for name in jointed.__all__},
    **{name: getattr(slender, name) for name in slender.__all__},
}
"""Generators of composed strangers."""

_PLAIN = frozenset(
    {
        "ball",
        "cuboid",
        "cylinder",
        "fruit",
        "knobbly",
        "plate",
        "prism",
        "slab",
        "stick",
        "superquadric",
        "tapered",
        "turned",
        "wand",
    }
)
"""Drawn two and a half times as often as others: most of what lies about is round, oblong or long, and little more."""

_LEAST_SIDE, _MOST_SIDE = 0.018, 0.32  # m, of the longest side
_TRIES = 40
_KINDS = {
    1: "of another class",
    3: "out of proportion",
    5: "cut off",
    11: "of another class",
    13: "out of proportion",
    15: "pressed together",
}
"""Of twenty in a row; the others are composed. Of the last two kinds few: from some sides they look like the whole."""
_LEAST_PARTNER = 0.6  # of the size of what it is pressed to, else it is hidden from many sides


@lru_cache(maxsize=1024)
def stranger(index: int, apart_from: tuple[str, ...] = ()) -> ObjectModel:
    """The composed thing that `index` (>= 0) draws, the same in every process; class "unknown", named after its form.

    apart_from: classes whose kin is not drawn (`kin_of`).
    Raises ObjectError for a negative index.
    """
    if index < 0:
        raise ObjectError(f"index of a stranger must not be negative, got {index}")
    kin = kin_of(apart_from)
    rng = np.random.default_rng([zlib.crc32(UNKNOWN.encode()), index])
    forms = [name for name in FORMS if name not in kin]
    often = np.cumsum([2.5 if name in _PLAIN else 1.0 for name in forms])
    for _ in range(_TRIES):
        form = forms[int(np.searchsorted(often, rng.random() * often[-1], side="right"))]
        pieces, mass = FORMS[form](rng)
        model = assemble(UNKNOWN, f"{form}_{index:05d}", pieces, mass)
        if _LEAST_SIDE <= float(model.extents.max()) <= _MOST_SIDE:
            return model
    raise ObjectError(f"stranger {index}: no draw of {_TRIES} has a size of {_LEAST_SIDE} to {_MOST_SIDE} m")


class DrawnStrangers:
    """`count` strangers to the classes of some models: composed things, other classes, and models spoilt.

    Of twenty, fourteen are composed (`stranger`), two of a class of the catalogue that is kin of none of theirs, two a
    model out of proportion, one a part of one, one two pressed together. None is as like to a model as those
    of a class are to each other. The same models, seed and number give the same stranger.

    Raises ObjectError where there are no models, or count or seed is negative.
    """

    def __init__(self, models: Sequence[ObjectModel], count: int, seed: int = 0) -> None:
        if not models:
            raise ObjectError("strangers need the models that they are strangers to, got none")
        if count < 0 or seed < 0:
            raise ObjectError(f"count and seed of strangers must not be negative, got {count} and {seed}")
        self.count, self.seed = count, seed
        self._models = list(models)
        self._classes = tuple(sorted({model.class_name for model in models}))
        kin = kin_of(self._classes)
        self._others = [name for name in CLASSES if name not in kin]
        self._likeness = Likeness(models)

    @property
    def names(self) -> list[str]:
        """Of each: "stranger_00000" and so on."""
        return [f"stranger_{i:05d}" for i in range(self.count)]

    def load(self, i: int) -> ObjectModel:
        """Stranger `i` (0 <= i < count). Raises ObjectError for another."""
        if not 0 <= i < self.count:
            raise ObjectError(f"there are strangers 0 to {self.count - 1}, asked for {i}")
        for attempt in range(_TRIES):
            rng = np.random.default_rng([zlib.crc32(UNKNOWN.encode()), self.seed, i, attempt])
            try:
                model = self._draw(self.kind(i) if attempt < _TRIES // 2 else "composed", rng)
            except ObjectError:  # a model that cannot be cut, a partner that is too small
                continue
            if not self._likeness.is_like(model):
                return replace(model, class_name=UNKNOWN, instance=f"stranger_{i:05d}")
        raise ObjectError(f"stranger {i}: none of {_TRIES} draws is unlike the classes {', '.join(self._classes)}")

    def kind(self, i: int) -> str:
        """Of stranger `i`: "composed", "of another class", "out of proportion", "cut off" or "pressed together"."""
        kind = _KINDS.get(i % 20, "composed")
        return "composed" if kind == "of another class" and not self._others else kind

    def _draw(self, kind: str, rng: np.random.Generator) -> ObjectModel:
        def any_model() -> ObjectModel:
            return self._models[int(rng.integers(len(self._models)))]

        if kind == "of another class":
            return make_object(self._others[int(rng.integers(len(self._others)))], int(rng.integers(10_000, 20_000)))
        if kind == "out of proportion":
            return deformed(any_model(), rng)
        if kind == "cut off":
            return fragment(any_model(), rng)
        if kind == "pressed together":
            first, second = any_model(), any_model()
            if rng.random() < 0.5:
                second = stranger(int(rng.integers(1 << 31)), self._classes)
            if second.extents.max() < _LEAST_PARTNER * first.extents.max():
                raise ObjectError(f"{second.instance} is too small beside {first.instance}")
            return fused(first, second, rng)
        return stranger(int(rng.integers(1 << 31)), self._classes)


def strangers_for(models: Sequence[ObjectModel], count: int, seed: int = 0) -> list[ObjectModel]:
    """`count` strangers to the classes of `models`, as `DrawnStrangers` draws them."""
    strangers = DrawnStrangers(models, count, seed)
    return [strangers.load(i) for i in range(count)]
