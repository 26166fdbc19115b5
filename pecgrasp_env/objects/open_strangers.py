"""Strangers from whatever a setting names: a folder of meshes, or composed things where it names nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.model import ObjectModel
from pecgrasp_env.objects.procedural.strangers.draw import stranger
from pecgrasp_env.objects.strangers import StrangerMeshes, Strangers

_COMPOSED = 1000


class ComposedStrangers:
    """A thousand composed things, none of which is kin of ``classes`` by name, as `stranger` draws them."""

    def __init__(self, classes: Sequence[str]) -> None:
        self._classes = tuple(classes)
        self.names: Sequence[str] = [f"stranger_{i:03d}" for i in range(_COMPOSED)]

    def load(self, i: int) -> ObjectModel:
        """Raises ObjectError for a number that there is not."""
        if not 0 <= i < _COMPOSED:
            raise ObjectError(f"there are strangers 0 to {_COMPOSED - 1}, asked for {i}")
        return replace(stranger(i, self._classes), instance=self.names[i])


def open_strangers(strangers: Any, classes: Sequence[str]) -> Strangers:
    """A folder of meshes, arguments of `StrangerMeshes` as a mapping, a source that is open already, or for None things
    that are composed, strangers to ``classes``.

    Raises ObjectError as `StrangerMeshes` does.
    """
    if strangers is None:
        return ComposedStrangers(classes)
    if hasattr(strangers, "load"):
        source: Strangers = strangers
        return source
    return StrangerMeshes(**strangers) if isinstance(strangers, Mapping) else StrangerMeshes(strangers)
