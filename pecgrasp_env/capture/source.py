"""Where the objects of a data set come from."""

from __future__ import annotations

from typing import Protocol

from pecgrasp_env.objects import ObjectModel

__all__ = ["Source"]


class Source(Protocol):
    """Where objects come from: classes, and instances of each, in a fixed order; picklable until one is loaded."""

    classes: tuple[str, ...]

    def names(self, class_name: str) -> list[str]: ...
    def load(self, class_name: str, i: int) -> ObjectModel: ...
    def origin(self, class_name: str, i: int) -> str: ...
