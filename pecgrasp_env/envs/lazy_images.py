"""Images that are rendered when they are read: in most steps of an episode nobody reads them, and rendering is the most
of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any


class LazyImages(Mapping[str, Any]):
    """What one camera's observation holds, rendered when first read, which must come before the task's next step."""

    def __init__(self, kinds: Sequence[str], render: Callable[[], Mapping[str, Any]]) -> None:
        """kinds: the keys, known beforehand. render: makes all of them."""
        self._kinds = tuple(kinds)
        self._render: Callable[[], Mapping[str, Any]] | None = render
        self._rendered: Mapping[str, Any] | None = None

    def __getitem__(self, kind: str) -> Any:
        if kind not in self._kinds:
            raise KeyError(kind)
        if self._rendered is None:
            if self._render is None:
                raise RuntimeError(f"{kind}: nobody looked while the task stood there, and it has moved on")
            self._rendered = self._render()
        return self._rendered[kind]

    def __contains__(self, kind: object) -> bool:
        return kind in self._kinds  # the mixin's would render

    def __iter__(self) -> Iterator[str]:
        return iter(self._kinds)

    def __len__(self) -> int:
        return len(self._kinds)

    def expire(self) -> None:
        """From now on only what was rendered can be had."""
        self._render = None
