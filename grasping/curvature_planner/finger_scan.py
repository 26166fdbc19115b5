"""Where two fingers that come straight in can stand beside an object: an exhaustive scan over headings and places.

Seen along the approach, an object is a map of heights: whatever lies under its surface cannot be entered. The map is
drawn once for each heading of the gripper; the rows that a pad covers give a profile of heights along the closing
axis; and at each depth of the tips the profile says where a finger stands free and what is left between two of them.

This is the reference of `compiled_backend.scan`, which repeats its arithmetic: sums and products stand in a
fixed order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.geometry import exact_math

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Maps = NDArray[np.float32]

X_STEP = 0.003  # m, resolution along the closing axis
ROWS = 3  # rows of the map under one pad's width
MEASURED = 160  # runs whose contours are measured; those nearest to the centre, narrow, deep and free come first


@dataclass(frozen=True)
class Candidates:
    """C grasp candidates, each with a finger on either side of something; arrays of length C, in the map's frame."""

    heading: FloatArray  # rad, of the closing axis
    x: FloatArray  # centre
    y: FloatArray
    tip: FloatArray  # height of the tips
    width: FloatArray  # of what is between the pads, to X_STEP
    overlap: FloatArray  # m, how far the pads reach below the top of the surface that they touch, worse side
    angle: FloatArray  # rad, of the two contours under the pads against the pads, worse side after the best turn
    room: FloatArray  # share of the wished-for free space beside the fingers, worse side
    whole: NDArray[np.bool_]  # everything under the pads' width is between the pads

    def take(self, index: IntArray | NDArray[np.bool_]) -> Candidates:
        return Candidates(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True)
class Scan:
    """All candidates, and of the lines across the object that are too wide to hold their number and least width, m."""

    candidates: Candidates
    too_wide: int
    narrowest: float


def scan(
    points: FloatArray,
    obstacles: FloatArray,
    *,
    tips: FloatArray,
    headings: FloatArray,
    pad_width: float,
    finger_room: float,
    wished_room: float,
    greatest_width: float,
    reach: float,
    centre: FloatArray,
) -> Scan:
    """Find every grasp candidate on an object given as points seen along the approach, in rising height.

    points (3, N): x and y with the origin in the middle of the object, height against the approach; likewise of the
    obstacles (3, K). tips: heights to try. headings: angles of the closing axis to try. finger_room: free space that a
    finger needs beside the object; wished_room: what it had better have. reach: from the tips to the palm, which must
    not come down on what hangs over the object. centre: (2,) near which candidates are preferred.
    """
    row = pad_width / ROWS
    radius = float(np.sqrt(np.square(points[:2]).sum(axis=0).max()))
    ny = 2 * int(np.ceil(radius / row)) + 3
    nx = 2 * int(np.ceil((radius + wished_room) / X_STEP)) + 3
    maps = _height_maps(points, headings, row, (ny, nx))
    bands = _band(maps)
    walls = bands
    if obstacles.shape[1]:
        walls = np.maximum(bands, _band(_height_maps(obstacles, headings, row, (ny, nx))))
    finger, wished = bins_of_room(finger_room, wished_room)
    runs = _pairs(bands.reshape(-1, nx), walls.reshape(-1, nx), tips, finger, wished)
    width = (runs.end - runs.start + 1) * X_STEP
    fits = width <= greatest_width
    too_wide = len(fits) - int(fits.sum())
    narrowest = float(width[~fits].min()) if too_wide else np.inf
    if too_wide:
        runs = runs.take(fits)
    if obstacles.shape[1]:
        over = _highest_between(np.where(walls > bands, walls, -np.inf), runs)
        runs = runs.take(over <= (runs.tip + reach).astype(np.float32))
    place = _BinPlaces(bands, headings, row)
    if len(runs.line) > MEASURED:
        x, y = place.centres(runs)
        x, y = x - centre[0], y - centre[1]
        cost = np.sqrt(x * x + y * y) + 0.3 * (runs.end - runs.start) * X_STEP
        cost -= 0.02 * np.minimum(place.overlap(runs), 0.03) / 0.03 + 0.01 * runs.room
        runs = runs.take(np.sort(np.argsort(cost, kind="stable")[:MEASURED]))
    return Scan(_measure(maps, runs, place), too_wide, narrowest)


def bins_of_room(finger_room: float, wished_room: float) -> tuple[int, int]:
    """Bins that a finger needs beside the object, and had better have."""
    finger = math.ceil(finger_room / X_STEP)
    return finger, max(finger, math.ceil(wished_room / X_STEP))


@dataclass(frozen=True)
class _Runs:
    """Bins start … end of a line (heading × row) between two places where a finger stands free."""

    line: IntArray
    start: IntArray
    end: IntArray
    tip: FloatArray
    room: FloatArray

    def take(self, index: IntArray | NDArray[np.bool_]) -> _Runs:
        return _Runs(self.line[index], self.start[index], self.end[index], self.tip[index], self.room[index])


@dataclass(frozen=True)
class _BinPlaces:
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
        cos, sin = np.cos(self.headings)[heading], np.sin(self.headings)[heading]
        return cos * along - sin * across, sin * along + cos * across

    def overlap(self, runs: _Runs) -> FloatArray:
        """How far (m) the surface stands above the tips within two bins of either side, the lower one."""
        flat = self.bands.reshape(-1, self.bands.shape[2])
        first = np.maximum(flat[runs.line, runs.start], flat[runs.line, np.minimum(runs.start + 1, runs.end)])
        last = np.maximum(flat[runs.line, runs.end], flat[runs.line, np.maximum(runs.end - 1, runs.start)])
        return np.asarray(np.minimum(first, last) - runs.tip, dtype=np.float64)


def _height_maps(points: FloatArray, headings: FloatArray, row: float, shape: tuple[int, int]) -> Maps:
    """(headings, ny, nx) greatest height in each cell of the map turned by each heading, −inf where it is empty."""
    ny, nx = shape
    cos, sin = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x, y, height = points
    # One more column and line on either side take what lies outside of the map.
    column = cos * x
    column += sin * y
    column *= 1.0 / X_STEP
    column += 0.5 * nx + 1.0
    line = cos * y
    line -= sin * x
    line *= 1.0 / row
    line += 0.5 * ny + 1.0
    flat = np.clip(line, 0, ny + 1, out=line).astype(np.int64)
    flat += np.arange(len(headings))[:, None] * (ny + 2)
    flat *= nx + 2
    flat += np.clip(column, 0, nx + 1, out=column).astype(np.int64)
    maps = np.full((len(headings), ny + 2, nx + 2), -np.inf, dtype=np.float32)
    # Of the points in one cell the last one written, the highest, stays.
    maps.reshape(-1)[flat] = height.astype(np.float32)
    return np.ascontiguousarray(maps[:, 1:-1, 1:-1])


def _band(maps: Maps) -> Maps:
    """Greatest height under a pad whose middle is at each row but the first and the last."""
    return np.maximum(np.maximum(maps[:, :-2], maps[:, 1:-1]), maps[:, 2:])


def _pairs(bands: Maps, walls: Maps, tips: FloatArray, finger: int, wished: int) -> _Runs:
    """Pair free places with free places: to the next one (a part of the object) and to the last one (all of it).

    bands, walls: (lines, nx) heights of the object, and of everything. finger, wished: bins of room beside the object.
    """
    count, nx = bands.shape
    padded = np.full((count, nx + 2 * wished), -np.inf, dtype=np.float32)
    padded[:, wished : wished + nx] = walls
    beside = _highest_in_window(padded, finger)
    level = tips.astype(np.float32)[:, None, None]
    occupied = bands > level
    free_before = beside[:, wished - finger : wished - finger + nx] <= level
    free_after = beside[:, wished + 1 : wished + 1 + nx] <= level
    starts = np.flatnonzero(occupied & free_before)
    ends = np.flatnonzero(occupied & free_after)
    if not len(starts) or not len(ends):
        none = np.empty(0, dtype=np.int64)
        return _Runs(none, none, none, np.empty(0), np.empty(0))
    line = starts // nx
    nearest = np.minimum(np.searchsorted(ends, starts), len(ends) - 1)
    last = np.searchsorted(ends, (line + 1) * nx) - 1
    valid = (last >= nearest) & (ends[nearest] >= starts)
    several = valid & (last > nearest)
    start = np.concatenate([starts[valid], starts[several]])
    end = np.concatenate([ends[nearest[valid]], ends[last[several]]])
    line = start // nx
    start, end = start - line * nx, end - line * nx
    depth, line = np.divmod(line, count)
    # Of the bins from what is needed to what is wished for, those up to the first that is taken on either side.
    free = np.ones(len(line), dtype=bool)
    room = np.zeros(len(line))
    limit, left, right = level[depth, 0, 0], start + wished, end + wished
    for bins in range(finger + 1, wished + 1):
        free &= np.maximum(padded[line, left - bins], padded[line, right + bins]) <= limit
        room += free
    return _Runs(line, start, end, tips[depth], room / max(wished - finger, 1))


def _highest_in_window(heights: Maps, size: int) -> Maps:
    """(lines, n) → (lines, n − size + 1) greatest of the `size` bins from each bin on."""
    window = 1
    while window < size:
        step = min(window, size - window)
        heights = np.maximum(heights[:, :-step], heights[:, step:])
        window += step
    return heights


def _highest_between(heights: Maps, runs: _Runs) -> Maps:
    """(R,) greatest of the heights (headings, rows, nx) from the start to the end of each run."""
    first = runs.line * heights.shape[2] + runs.start
    bounds = np.column_stack([first, first + runs.end - runs.start + 1]).reshape(-1)
    highest: Maps = np.maximum.reduceat(np.append(heights, np.float32(-np.inf)), bounds)[::2]
    return highest


def _measure(maps: Maps, runs: _Runs, place: _BinPlaces) -> Candidates:
    """The contours of each run, three rows under the pad on either side, and whether it is the whole of its line."""
    nx = maps.shape[2]
    heading, band_row = place.heading_and_row(runs)
    bins = np.arange(nx)
    above = maps[heading[:, None], band_row[:, None] + np.arange(ROWS)] > runs.tip.astype(np.float32)[:, None, None]
    inside = (bins >= runs.start[:, None]) & (bins <= runs.end[:, None])
    whole = ~(above.any(axis=1) & ~inside).any(axis=1)
    above &= inside[:, None, :]
    present = np.asarray(above.any(axis=2))
    left = _slope(above.argmax(axis=2), present, place.row)
    right = _slope(nx - 1 - above[:, :, ::-1].argmax(axis=2), present, place.row)
    turn = exact_math.arctan(0.5 * (left + right))
    x, y = place.centres(runs)
    return Candidates(
        heading=place.headings[heading],
        x=x,
        y=y,
        tip=runs.tip,
        width=np.asarray((runs.end - runs.start + 1) * X_STEP, dtype=np.float64),
        overlap=place.overlap(runs),
        angle=np.maximum(np.abs(exact_math.arctan(left) - turn), np.abs(exact_math.arctan(right) - turn)),
        room=runs.room,
        whole=whole,
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
