"""Pictures that are taken when somebody looks at them: most steps of an episode nobody does, and rendering is the most
of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any


class Pictures(Mapping[str, Any]):
    """What one camera's observation holds, taken at the first look, which must come before the task's next step."""

    def __init__(self, kinds: Sequence[str], take: Callable[[], Mapping[str, Any]]) -> None:
        """kinds: the keys, known beforehand. take: draws all of them."""
        self._kinds = tuple(kinds)
        self._take: Callable[[], Mapping[str, Any]] | None = take
        self._taken: Mapping[str, Any] | None = None

    def __getitem__(self, kind: str) -> Any:
        if kind not in self._kinds:
            raise KeyError(kind)
        if self._taken is None:
            if self._take is None:
                raise RuntimeError(f"{kind}: nobody looked while the task stood there, and it has moved on")
            self._taken = self._take()
        return self._taken[kind]

    def __contains__(self, kind: object) -> bool:
        return kind in self._kinds  # the mixin's would take the picture

    def __iter__(self) -> Iterator[str]:
        return iter(self._kinds)

    def __len__(self) -> int:
        return len(self._kinds)

    def expire(self) -> None:
        """From now on only what was taken can be had."""
        self._take = None
