"""One instance made into many: deformed copies of each, for classes that are wider than their few members."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Protocol

import numpy as np

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.meshing.convex_hulls import hull_volume
from pecgrasp_env.objects.meshing.free_form import FreeForm
from pecgrasp_env.objects.model import LIGHTEST, ObjectModel, centre_of_mass

__all__ = ["MOST", "Deformed", "deformed", "mapped"]

MOST = 0.4
"""Greatest strength: beyond, the map may fold."""


class _Source(Protocol):
    classes: tuple[str, ...]

    def names(self, class_name: str) -> list[str]: ...
    def load(self, class_name: str, i: int) -> ObjectModel: ...
    def origin(self, class_name: str, i: int) -> str: ...


class Deformed:
    """A source with `copies` deformed copies of each instance behind the undeformed ones; "cup~2" is the second of cup.

    strength: of `FreeForm`, at most MOST. Copies are drawn by seed and name: the same in every process. Classes in
    `untouched` are as the source has them. Raises ObjectError for fewer than 1 copy or a strength out of range.
    """

    def __init__(
        self, base: _Source, copies: int, strength: float, seed: int = 0, untouched: tuple[str, ...] = ()
    ) -> None:
        if copies < 1:
            raise ObjectError(f"objects.deformations must be at least 1 to deform, got {copies}")
        if not 0 < strength <= MOST:
            raise ObjectError(f"objects.deformation must be above 0 and at most {MOST}, got {strength}")
        self.base, self.classes = base, base.classes
        self.copies, self.strength, self.seed, self.untouched = copies, strength, seed, untouched

    def names(self, class_name: str) -> list[str]:
        """The names of the class's instances, in order."""
        own = self.base.names(class_name)
        if class_name in self.untouched:
            return own
        return own + [f"{name}~{copy}" for copy in range(1, self.copies + 1) for name in own]

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance `i` of a class. Raises ObjectError as the source does."""
        number, copy = self.original(class_name, i)
        model = self.base.load(class_name, number)
        if copy == 0:
            return model
        name = f"{model.instance}~{copy}"
        rng = np.random.default_rng([self.seed, zlib.crc32(f"{class_name}/{name}".encode())])
        return replace(deformed(model, self.strength, rng), instance=name)

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        number, copy = self.original(class_name, i)
        origin = self.base.origin(class_name, number)
        return f"{origin}, deformed" if copy else origin

    def original(self, class_name: str, i: int) -> tuple[int, int]:
        """The number in the source of what instance `i` is made of, and the number of the copy, 0 for itself."""
        n_own = len(self.base.names(class_name))
        if class_name not in self.untouched and n_own:
            return i % n_own, i // n_own
        return i, 0


def deformed(model: ObjectModel, strength: float, rng: np.random.Generator) -> ObjectModel:
    """The model after a map that `rng` draws. Its mass goes with its volume, textures with their faces."""
    points = np.concatenate([part.vertices for part in model.parts])
    return mapped(model, FreeForm(points.min(axis=0), points.max(axis=0), strength, rng))


def mapped(model: ObjectModel, free_form: FreeForm) -> ObjectModel:
    """The model with all its points mapped: each convex part is the hull of its mapped corners."""
    hulls = [free_form(hull) for hull in model.hulls]
    centre = centre_of_mass(hulls)
    volume = sum(hull_volume(hull) for hull in hulls)
    parts = tuple(
        replace(part, vertices=(free_form(part.vertices) - centre).astype(np.float32)) for part in model.parts
    )
    centred = tuple((hull - centre).astype(np.float32) for hull in hulls)
    return replace(model, parts=parts, hulls=centred, mass=max(model.mass * volume / model.volume, LIGHTEST))
