"""What a frame is cut into: the objects on a table, the table, and what was left out and why."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Rejected:
    """Something that is no object: what ("plane", "cluster", "points"), why, and the number of points concerned.

    way_out: the setting of the segmenter with which it would be taken, "max_extent=0.6", or "frame=world", which is
    `up` along z, or "up=[x,y,z]"; empty where there is none. indices: (n_points,) of the points in the input,
    flattened; empty for a plane, whose points are said with what else they are.
    """

    what: str
    why: str
    n_points: int
    way_out: str = ""
    indices: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64), compare=False, repr=False)

    def as_results(self) -> dict[str, str | int]:
        """What `results.json` says of it: all but the indices."""
        return {"what": self.what, "why": self.why, "n_points": self.n_points, "way_out": self.way_out}


@dataclass(frozen=True)
class Cut:
    """Where two objects of a scene adjoin: their numbers, and how sure it is, in [0, 1], that they are two.

    At 1 they are surely two things, at 0.5 they may as well be one: another view would tell.
    """

    first: int
    second: int
    sure: float


class OnDemand(Sequence[FloatArray]):
    """Arrays that are made when they are first asked for: of ten objects one is grasped."""

    def __init__(self, make: Sequence[Callable[[], FloatArray]]) -> None:
        self._make = make
        self._made: dict[int, FloatArray] = {}

    def __len__(self) -> int:
        return len(self._make)

    @overload
    def __getitem__(self, at: int) -> FloatArray: ...

    @overload
    def __getitem__(self, at: slice) -> list[FloatArray]: ...

    def __getitem__(self, at: int | slice) -> FloatArray | list[FloatArray]:
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(len(self)))]
        number = range(len(self))[at]
        if number not in self._made:
            self._made[number] = self._make[number]()
        return self._made[number]


@dataclass(frozen=True)
class Scene:
    """The objects of a frame, the largest first; lists of one length.

    objects: clouds (M, 3) in the frame and dtype of the input. indices: of their points in the input, flattened.
    plane: (4,), n·p + d = 0 with n up, or None; n_table: its points. touches_border: cut off by the image (never so
    for a loose cloud). touches_gripper: within 1 cm of what was cut out as the robot. rejected: what was left out
    and why. obstacles: clouds of those of it that a gripper could hit. Every point of the input is in an object, in
    the table, or counted in `rejected` as "points" or "cluster". viewpoint: (3,) where the camera stood, in the
    frame of the input, or None where that is not known. unseen: for each object (K, 3), the far ends, on the table
    where there is one, of the lines of sight on which the sensor measured nothing, or the robot, in the object or
    beside it, looked for when they are asked for; (0, 3) for a loose cloud. other_planes: (4,) each, the largest
    first: a floor, a wall, a box's side; where they are stands in `rejected`. confidence: for each object how sure
    it is, in [0, 1], that it is one whole thing, no part and no sum of some; empty where the segmenter does not
    say. cuts: pairs of neighbouring objects, first < second, that it told apart; empty likewise.
    """

    objects: list[FloatArray]
    indices: list[IntArray]
    plane: FloatArray | None
    touches_border: list[bool]
    touches_gripper: list[bool]
    rejected: list[Rejected] = field(default_factory=list)
    obstacles: list[FloatArray] = field(default_factory=list)
    n_table: int = 0
    viewpoint: FloatArray | None = None
    unseen: Sequence[FloatArray] = field(default_factory=list)
    other_planes: list[FloatArray] = field(default_factory=list)
    confidence: list[float] = field(default_factory=list)
    cuts: list[Cut] = field(default_factory=list)

    def certainties(self) -> list[float]:
        """How sure it is of each object that it is one, and no part or sum of some, by its `confidence` and its `cuts`;
        1 where the segmenter does not say.
        """
        certainties = list(self.confidence) or [1.0] * len(self.objects)
        for cut in self.cuts:
            for k in (cut.first, cut.second):
                certainties[k] = min(certainties[k], cut.sure)
        return certainties

    def summary(self) -> str:
        """What was rejected, in a sentence, with the settings that would take it."""
        parts = [
            ("" if entry.what == "points" else f"a {entry.what} of ")
            + f"{entry.n_points} points: {entry.why}"
            + (f" (say {entry.way_out})" if entry.way_out else "")
            for entry in self.rejected
        ]
        return "; ".join(parts) if parts else "nothing was rejected"
