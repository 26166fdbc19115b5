"""Where two fingers that come straight in can stand beside an object: an exhaustive scan over headings and places.

Seen along the approach, an object is a map of heights: whatever lies under its surface cannot be entered. The map is
drawn once for each heading of the gripper; the rows that a pad covers give a profile of heights along the closing
axis; and at each depth of the tips the profile says where a finger stands free and what is left between two of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Maps = NDArray[np.float32]

X_STEP = 0.003  # m, resolution along the closing axis
ROWS = 3  # rows of the map under one pad's width
MEASURED = 250  # runs whose contours are measured; those nearest to the centre, narrow, deep and free come first


@dataclass(frozen=True)
class Holds:
    """C ways to stand with a finger on either side of something; arrays of length C, in the map's frame."""

    heading: FloatArray  # rad, of the closing axis
    x: FloatArray  # centre
    y: FloatArray
    tip: FloatArray  # height of the tips
    width: FloatArray  # of what is between the pads, to X_STEP
    overlap: FloatArray  # m, how far the pads reach below the top of the surface that they touch, worse side
    angle: FloatArray  # rad, of the two contours under the pads against the pads, worse side after the best turn
    room: FloatArray  # share of the wished-for free space beside the fingers, worse side
    whole: NDArray[np.bool_]  # everything under the pads' width is between the pads

    def take(self, index: IntArray | NDArray[np.bool_]) -> Holds:
        return Holds(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True)
class Scan:
    """All holds, and for how many of the lines that cross the object each condition was the one that failed."""

    holds: Holds
    lines: int
    blocked: int
    too_wide: int
    narrowest: float  # m, the least width of a line that was too wide


def scan(
    xy: FloatArray,
    height: FloatArray,
    obstacle_xy: FloatArray,
    obstacle_height: FloatArray,
    *,
    tips: FloatArray,
    headings: FloatArray,
    pad_width: float,
    finger_room: float,
    wished_room: float,
    greatest_width: float,
    centre: FloatArray,
) -> Scan:
    """Find every hold of an object given as points seen along the approach.

    xy (N, 2) with the origin in the middle of the object, height (N,) against the approach; likewise of the obstacles.
    tips: heights to try. headings: angles of the closing axis to try. finger_room: free space that a finger needs
    beside the object; wished_room: what it had better have. centre: (2,) near which holds are preferred.
    """
    row = pad_width / ROWS
    radius = float(np.sqrt((xy**2).sum(axis=1).max()))
    ny = 2 * int(np.ceil(radius / row)) + 3
    nx = 2 * int(np.ceil((radius + wished_room) / X_STEP)) + 3
    maps = _height_maps(xy, height, headings, row, (ny, nx))
    bands = _band(maps)
    blocked_bands = bands
    if len(obstacle_xy):
        blocked_bands = np.maximum(bands, _band(_height_maps(obstacle_xy, obstacle_height, headings, row, (ny, nx))))

    finger = int(np.ceil(finger_room / X_STEP))
    wished = max(finger, int(np.ceil(wished_room / X_STEP)))
    parts, lines, blocked, too_wide, narrowest = [], 0, 0, 0, np.inf
    for tip in tips:
        found = _at_depth(bands, blocked_bands, float(tip), finger, wished)
        width = (found.end - found.start + 1) * X_STEP
        crossed = int((bands > tip).any(axis=2).sum())
        lines += crossed
        blocked += crossed - len(np.unique(found.line))
        fits = width <= greatest_width
        too_wide += int((~fits).sum())
        if not fits.all():
            narrowest = min(narrowest, float(width[~fits].min()))
        parts.append(found.take(fits))
    runs = _Runs(*(np.concatenate([getattr(part, name) for part in parts]) for name in _Runs.__dataclass_fields__))
    place = _Places(bands, headings, row)
    if len(runs.line) > MEASURED:
        x, y = place.centres(runs)
        cost = np.hypot(x - centre[0], y - centre[1]) + 0.3 * (runs.end - runs.start) * X_STEP
        cost -= 0.02 * np.minimum(place.overlap(runs), 0.03) / 0.03 + 0.01 * runs.room
        runs = runs.take(np.sort(np.argpartition(cost, MEASURED)[:MEASURED]))
    return Scan(_measure(maps, runs, place), lines, blocked, too_wide, narrowest)


@dataclass(frozen=True)
class _Runs:
    """Bins start … end of a line (heading × row) between two places where a finger stands free."""

    line: IntArray
    start: IntArray
    end: IntArray
    tip: FloatArray
    room: FloatArray
    whole: NDArray[np.bool_]

    def take(self, index: IntArray | NDArray[np.bool_]) -> _Runs:
        return _Runs(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class _Places:
    """Where the bins of the bands (headings, rows, nx) lie."""

    bands: Maps
    headings: FloatArray
    row: float

    def heading_and_row(self, runs: _Runs) -> tuple[IntArray, IntArray]:
        heading, row = np.divmod(runs.line, self.bands.shape[1])
        return heading, row

    def centres(self, runs: _Runs) -> tuple[FloatArray, FloatArray]:
        heading, row = self.heading_and_row(runs)
        along = (0.5 * (runs.start + runs.end + 1 - self.bands.shape[2])) * X_STEP
        across = (row + 0.5 - 0.5 * self.bands.shape[1]) * self.row
        cos, sin = np.cos(self.headings[heading]), np.sin(self.headings[heading])
        return cos * along - sin * across, sin * along + cos * across

    def overlap(self, runs: _Runs) -> FloatArray:
        """How far (m) the surface stands above the tips within two bins of either side, the lower one."""
        flat = self.bands.reshape(-1, self.bands.shape[2])
        first = np.maximum(flat[runs.line, runs.start], flat[runs.line, np.minimum(runs.start + 1, runs.end)])
        last = np.maximum(flat[runs.line, runs.end], flat[runs.line, np.maximum(runs.end - 1, runs.start)])
        return np.asarray(np.minimum(first, last) - runs.tip, dtype=np.float64)


def _height_maps(xy: FloatArray, height: FloatArray, headings: FloatArray, row: float, shape: tuple[int, int]) -> Maps:
    """(headings, ny, nx) greatest height in each cell of the map turned by each heading, −inf where it is empty."""
    ny, nx = shape
    order = np.argsort(height)  # of points in one cell the last one written, the highest, stays
    x, y = xy[order].T
    cos, sin = np.cos(headings)[:, None], np.sin(headings)[:, None]
    column = np.floor((cos * x + sin * y) / X_STEP + 0.5 * nx).astype(np.int64)
    line = np.floor((cos * y - sin * x) / row + 0.5 * ny).astype(np.int64)
    inside = (column >= 0) & (column < nx) & (line >= 0) & (line < ny)
    flat = (np.arange(len(headings))[:, None] * ny + line) * nx + column
    maps = np.full((len(headings), ny, nx), -np.inf, dtype=np.float32)
    maps.reshape(-1)[flat[inside]] = np.broadcast_to(height[order], flat.shape)[inside]
    return maps


def _band(maps: Maps) -> Maps:
    """Greatest height under a pad whose middle is at each row but the first and the last."""
    return np.maximum(np.maximum(maps[:, :-2], maps[:, 1:-1]), maps[:, 2:])


def _at_depth(bands: Maps, blocked_bands: Maps, tip: float, finger: int, wished: int) -> _Runs:
    """Pair free places with free places: to the next one (a part of the object) and to the last one (all of it)."""
    nx = bands.shape[2]
    occupied = (bands > tip).reshape(-1, nx)
    blocked = (blocked_bands > tip).reshape(-1, nx)
    counted = np.zeros((len(blocked), nx + 1 + 2 * wished), dtype=np.int32)
    np.cumsum(blocked, axis=1, out=counted[:, wished + 1 : wished + 1 + nx])
    counted[:, wished + 1 + nx :] = counted[:, wished + nx, None]

    # counted[:, wished + i] is the number of blocked bins before bin i: equal counts mean a free span between them.
    free_before = counted[:, wished : wished + nx] == counted[:, wished - finger : wished - finger + nx]
    free_after = counted[:, wished + 1 + finger : wished + 1 + finger + nx] == counted[:, wished + 1 : wished + 1 + nx]
    starts = np.flatnonzero(occupied & free_before)
    ends = np.flatnonzero(occupied & free_after)
    if not len(starts) or not len(ends):
        none = np.empty(0, dtype=np.int64)
        return _Runs(none, none, none, np.empty(0), np.empty(0), np.empty(0, dtype=bool))
    line = starts // nx
    nearest = np.minimum(np.searchsorted(ends, starts), len(ends) - 1)
    last = np.searchsorted(ends, (line + 1) * nx) - 1
    first_start = np.concatenate([[True], line[1:] != line[:-1]])
    valid = (ends[nearest] >= starts) & (ends[nearest] // nx == line)
    several = valid & (last > nearest)
    start = np.concatenate([starts[valid], starts[several]])
    end = np.concatenate([ends[nearest[valid]], ends[last[several]]])
    leftmost = np.concatenate([first_start[valid], first_start[several]])
    rightmost = np.concatenate([last[valid] == nearest[valid], np.ones(int(several.sum()), dtype=bool)])
    line = start // nx
    # Of the span from what is needed to what is wished for, the thirds that are free on both sides.
    room = np.zeros(len(start))
    left, right = wished + start - line * nx, wished + 1 + end - line * nx
    for step in (1, 2, 3):
        bins = finger + (wished - finger) * step // 3
        free = counted[line, left] == counted[line, left - bins]
        free &= counted[line, right] == counted[line, right + bins]
        room += free / 3.0
    # Everything of the object on the line is between the pads where both outermost ends were taken.
    whole = leftmost & rightmost
    first_occupied = occupied.argmax(axis=1)[line]
    last_occupied = nx - 1 - occupied[:, ::-1].argmax(axis=1)[line]
    whole &= (first_occupied >= start - line * nx) & (last_occupied <= end - line * nx)
    return _Runs(line, start - line * nx, end - line * nx, np.full(len(line), tip), room, whole)


def _measure(maps: Maps, runs: _Runs, place: _Places) -> Holds:
    """The contours of each run: the three rows under the pad on either side."""
    nx = maps.shape[2]
    heading, band_row = place.heading_and_row(runs)
    bins = np.arange(nx)
    inside = (bins >= runs.start[:, None]) & (bins <= runs.end[:, None])
    rows = band_row[:, None] + np.arange(ROWS)
    occupied = (maps[heading[:, None], rows] > runs.tip[:, None, None]) & inside[:, None, :]
    present = np.asarray(occupied.any(axis=2))
    left = _slope(occupied.argmax(axis=2), present, place.row)
    right = _slope(nx - 1 - occupied[:, :, ::-1].argmax(axis=2), present, place.row)
    turn = np.arctan(0.5 * (left + right))
    x, y = place.centres(runs)
    return Holds(
        heading=place.headings[heading],
        x=x,
        y=y,
        tip=runs.tip,
        width=np.asarray((runs.end - runs.start + 1) * X_STEP, dtype=np.float64),
        overlap=place.overlap(runs),
        angle=np.maximum(np.abs(np.arctan(left) - turn), np.abs(np.arctan(right) - turn)),
        room=runs.room,
        whole=runs.whole,
    )


def _slope(position: IntArray, present: NDArray[np.bool_], row: float) -> FloatArray:
    """Slope of the contour over the outer rows under the pad; over the half that is there where one is missing."""
    x = position * X_STEP
    both = present[:, 0] & present[:, 2]
    upper = present[:, 1] & present[:, 2]
    lower = present[:, 0] & present[:, 1]
    return np.where(
        both,
        (x[:, 2] - x[:, 0]) / (2 * row),
        np.where(upper, (x[:, 2] - x[:, 1]) / row, np.where(lower, (x[:, 1] - x[:, 0]) / row, 0.0)),
    )
