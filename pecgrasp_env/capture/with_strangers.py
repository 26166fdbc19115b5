"""A source with one more class, the last: things that are of none of the others, to learn what to refuse.

Strangers are a folder's own, FOLDER/unknown/*, and then as many drawn ones as are asked for.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.source import Source
from pecgrasp_env.objects import UNKNOWN, DrawnStrangers, ObjectError, ObjectModel
from pecgrasp_env.objects.mesh_folder import MeshWarning

__all__ = ["WithStrangers", "n_drawn"]

_MOST_MODELS = 60
"""Of a source, from which strangers near its classes are made; so many of a large one, evenly over the classes."""


def n_drawn(config: CaptureConfig, source: Source) -> int:
    """How many strangers are drawn: as configured, or where that is None so many that a third of all clouds shows
    strangers, those that a folder has itself counted in.
    """
    objects = config.objects
    if objects.strangers is not None:
        return objects.strangers
    most = objects.instances_per_class and objects.instances_per_class * (1 + objects.deformations)
    n_instances = {name: len(source.names(name)[:most]) for name in source.classes}
    own = n_instances.pop(UNKNOWN, 0)
    missing = (sum(n_instances.values()) / 2 - own) * config.samples_per_instance
    return max(0, round(missing / config.samples_of_stranger))


class WithStrangers:
    """The classes of a source and UNKNOWN: the source's own instances of that name, then `n_drawn` drawn ones."""

    def __init__(self, source: Source, n_drawn: int, seed: int) -> None:
        known = tuple(name for name in source.classes if name != UNKNOWN)
        if not known:
            raise CaptureError(f"there is no class but {UNKNOWN!r}, which is none: what is to be told from strangers?")
        self.base = source
        self.classes = (*known, UNKNOWN)
        self.n_own = len(source.names(UNKNOWN)) if UNKNOWN in source.classes else 0
        self._n_drawn, self._seed = n_drawn, seed
        self._drawn: DrawnStrangers | None = None

    def names(self, class_name: str) -> list[str]:
        """The names of the class's instances, in order; of UNKNOWN the source's own come first."""
        if class_name != UNKNOWN:
            return self.base.names(class_name)
        own = self.base.names(UNKNOWN) if self.n_own else []
        return [*own, *(f"stranger_{i:05d}" for i in range(self._n_drawn))]

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance `i` of a class. Raises ObjectError as the source does."""
        if not self.is_drawn(class_name, i):
            return self.base.load(class_name, i)
        return self._strangers.load(i - self.n_own)

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        return "drawn stranger" if self.is_drawn(class_name, i) else self.base.origin(class_name, i)

    def is_drawn(self, class_name: str, i: int) -> bool:
        """Whether instance `i` of a class is a stranger that is drawn, not one of the source's own."""
        return class_name == UNKNOWN and i >= self.n_own

    def models_near(self) -> Iterator[tuple[str, int]]:
        """The instances (class, number) of which strangers near the classes are made, class by class in turns."""
        known = self.classes[:-1]
        most = max(len(self.base.names(name)) for name in known)
        turns = ((name, i) for i in range(most) for name in known if i < len(self.base.names(name)))
        for _, one in zip(range(_MOST_MODELS), turns, strict=False):
            yield one

    @property
    def _strangers(self) -> DrawnStrangers:
        if self._drawn is None:
            models = []
            for name, i in self.models_near():
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore", MeshWarning)
                        models.append(self.base.load(name, i))
                except ObjectError:  # it is named where it is captured itself
                    continue
            self._drawn = DrawnStrangers(models, self._n_drawn, self._seed)
        return self._drawn
