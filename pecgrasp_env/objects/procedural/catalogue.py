"""The procedural catalogue: a class is a family of shapes, an instance is a draw from it by seed.

A class of one's own goes by its dotted name: "my_objects.torus" is the function `torus` of an importable module
my_objects.py, which draws as the generators here do, `np.random.Generator` → `Draft`.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib import import_module

import numpy as np

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.model import Draft, ObjectModel, assemble
from pecgrasp_env.objects.procedural.bottle import bottle
from pecgrasp_env.objects.procedural.clamp import clamp
from pecgrasp_env.objects.procedural.containers import box, can
from pecgrasp_env.objects.procedural.drill import drill
from pecgrasp_env.objects.procedural.joypad import joypad
from pecgrasp_env.objects.procedural.mouse import mouse
from pecgrasp_env.objects.procedural.pliers import pliers
from pecgrasp_env.objects.procedural.plug_adapter import plug_adapter
from pecgrasp_env.objects.procedural.proportions import KINDS, in_proportion
from pecgrasp_env.objects.procedural.stapler import stapler
from pecgrasp_env.objects.procedural.vessels import bowl, mug
from pecgrasp_env.objects.procedural.wire_cutter import open_wire_cutter, wire_cutter

_GENERATORS: dict[str, Callable[[np.random.Generator], Draft]] = {
    "joypad": joypad,
    "mouse": mouse,
    "pliers": pliers,
    "stapler": stapler,
    "plug_adapter": plug_adapter,
    "can": can,
    "box": box,
    "bottle": bottle,
    "mug": mug,
    "bowl": bowl,
    "clamp": clamp,
    "drill": drill,
    "wire_cutter": wire_cutter,
    "open_wire_cutter": open_wire_cutter,
}
CLASSES: tuple[str, ...] = tuple(_GENERATORS)
LARS_CLASSES = CLASSES[:5]
FAMILIES = ("narrow", "wide")


def make_object(class_name: str, seed: int, families: str = "narrow") -> ObjectModel:
    """The instance of `class_name` that `seed` (>= 0) draws: the same shape in every process.

    families: "narrow", as the published sets have it, or "wide", in the sizes and proportions of many products
    (`proportions`); a class of one's own is the same in both.

    Drawn once in a process. Raises ObjectError for a class that the catalogue does not have.
    """
    return _drawn(class_name, seed, families)


@lru_cache(maxsize=1024)
def _drawn(class_name: str, seed: int, families: str) -> ObjectModel:
    """`make_object`: arguments that are left out and said are the same here, so that nothing is drawn or kept twice."""
    generator = _generator(class_name)
    if seed < 0:
        raise ObjectError(f"seed of a {class_name} must not be negative, got {seed}")
    name, rng = f"{class_name}_{seed:04d}", np.random.default_rng([zlib.crc32(class_name.encode()), seed])
    if families == "wide" and class_name in KINDS:
        name, rng = f"{class_name}_wide_{seed:04d}", np.random.default_rng([zlib.crc32(class_name.encode()), seed, 1])
        pieces, mass = in_proportion(class_name, generator, rng)
    else:
        pieces, mass = generator(rng)
    return assemble(class_name, name, pieces, mass)


def _generator(class_name: str) -> Callable[[np.random.Generator], Draft]:
    if class_name in _GENERATORS:
        return _GENERATORS[class_name]
    module_name, _, function_name = class_name.rpartition(".")
    if not module_name:
        has = f"the catalogue has {', '.join(CLASSES)}, and module.function of your own"
        raise ObjectError(f"unknown object class {class_name!r}; {has}")
    try:
        found = getattr(import_module(module_name), function_name, None)
    except ModuleNotFoundError as error:
        way_out = f"is the folder of {module_name.partition('.')[0]}.py on PYTHONPATH?"
        raise ObjectError(f"object class {class_name!r} cannot be imported: {error}; {way_out}") from error
    if not callable(found):
        raise ObjectError(f"object class {class_name!r}: {module_name} has no function {function_name}")
    return found


class Catalogue:
    """`instances_per_class` draws of each class: seeds seed, seed + 1, ... name them ("stapler_0003" is seed 3).

    Two catalogues whose seed ranges do not overlap share no instance.
    Raises ObjectError for an unknown class, no class at all, or fewer than one instance a class.
    """

    def __init__(
        self, classes: Sequence[str] = CLASSES, instances_per_class: int = 10, seed: int = 0, families: str = "narrow"
    ) -> None:
        for class_name in classes:
            _generator(class_name)
        if not classes or len(set(classes)) != len(classes):
            raise ObjectError(f"classes must be named once each and at least one, got {list(classes)}")
        if instances_per_class < 1 or seed < 0:
            raise ObjectError(f"instances_per_class must be >= 1 and seed >= 0, got {instances_per_class} and {seed}")
        if families not in FAMILIES:
            raise ObjectError(f"families {families!r} does not exist; choose one of {', '.join(FAMILIES)}")
        self.classes = tuple(classes)
        self.families = families
        self.instances_per_class = instances_per_class
        self.seed = seed

    def names(self, class_name: str) -> list[str]:
        """The names of the class's instances, in order."""
        self._check(class_name)
        wide = "wide_" if self.families == "wide" and class_name in KINDS else ""
        return [f"{class_name}_{wide}{self.seed + i:04d}" for i in range(self.instances_per_class)]

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance `i` (0 <= i < instances_per_class) of a class."""
        self._check(class_name)
        if not 0 <= i < self.instances_per_class:
            raise ObjectError(f"{class_name} has instances 0 to {self.instances_per_class - 1}, asked for {i}")
        return make_object(class_name, self.seed + i, self.families)

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        self._check(class_name)
        return "procedural catalogue"

    def _check(self, class_name: str) -> None:
        if class_name not in self.classes:
            raise ObjectError(f"unknown object class {class_name!r}; this catalogue has {', '.join(self.classes)}")
