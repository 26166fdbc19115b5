"""Grasp candidates looked at closely, on all points: turned to lie flat on their contacts, centred, measured, checked.

This is the reference of what `compiled_backend.rank` does with each candidate: sums and products stand in a
fixed order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.finger_scan import Candidates
from grasping.geometry import exact_math

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CONTOUR_ROWS = 5  # parts of a pad's width over which each contour is drawn
LEAST_WIDTH = 0.002  # m between the two contours, where they are farthest apart: a streak of points is no thing
FEWEST, FEWEST_SPARSE = 5, 3  # points near a pad that say that there is a surface; in the sparsest of clouds
SHARE_NEAR = 0.5  # of the points that a surface has near a pad, as far as there are fewer than that
TOUCHING = 0.006  # m: a contour farther behind the outermost part does not help to hold
ROUGHNESS = 0.003  # m: pads are soft and clouds are noisy, a contour this near to it helps in full
CONTACT_BAND = 0.004  # m behind the outermost points: how high the surface is there says how steep it is
BESIDE = 0.003  # m on either side of a finger that must be free as well
SEARCH = 0.006  # m beyond the coarse extent in which the object's outermost points are looked for
MOST_TURN = 0.15  # rad in one step: half of the scan's step and what its resolution adds
HAIR = 1e-9  # m: the outermost points are between the pads
STEPS = 2
_SIDES = np.array([[1.0], [-1.0]])


@dataclass(frozen=True)
class Contacts:
    """M candidates after refinement, arrays of length M. Lengths in m, angles in rad, frame as for `scan`."""

    heading: FloatArray
    x: FloatArray
    y: FloatArray
    tip: FloatArray
    width: FloatArray
    angle: FloatArray  # of the worse contour against its pad
    contact: FloatArray  # share of the pad's width that touches, worse side: 1 less the contour's lateral curvature
    overlap: FloatArray  # depth of the pad below the top of the surface that it touches, worse side
    area: FloatArray  # m² of the pad beside the surface that it touches, worse side; 0 where next to nothing is there
    gap: FloatArray  # free space beside the object, narrower side, cut at `wished_room`; 0 where the palm would hit
    empty: NDArray[np.bool_]  # too few points between the pads for the rest to mean anything


def refine(
    points: FloatArray,
    blockers: FloatArray,
    candidates: Candidates,
    *,
    pad_width: float,
    wished_room: float,
    reach: float,
    fewest: int = FEWEST,
) -> Contacts:
    """Turn and centre each candidate on the points between its pads.

    points (3, N): x, y and height of the object. blockers (3, K): what else a finger could hit, and
    the palm, which is this far (m) behind the tips. fewest: points near a pad that say that it touches something.
    """
    half = 0.5 * pad_width
    heading, x, y, tip = candidates.heading, candidates.x, candidates.y, candidates.tip
    search = 0.5 * candidates.width + SEARCH
    points = points[:, points[2] > tip.min(initial=np.inf)]
    height = points[2]
    above = height > tip[:, None]
    for step in range(STEPS + 1):
        cos, sin = exact_math.cos(heading), exact_math.sin(heading)
        along, across = _turned(points, cos, sin, x, y)
        between = above & (np.abs(across) <= half) & (np.abs(along) <= search[:, None])
        chosen = np.flatnonzero(between)
        owner = chosen // between.shape[1]
        u = along.reshape(-1)[chosen]
        contour = _contours(owner, u, across.reshape(-1)[chosen], half, len(tip))
        slope = _slopes(contour, pad_width) * _SIDES
        # The second contour is measured backwards, so that outermost is least on either side.
        outermost = contour.min(axis=2)
        empty = ~np.isfinite(outermost[0]) | (np.bincount(owner, minlength=len(tip)) < 3)
        outermost[:, empty] = 0.0
        start, end = outermost[0], -outermost[1]
        middle = 0.5 * (start + end)
        from_x, from_y, x, y = x, y, x + cos * middle, y + sin * middle
        if step < STEPS:
            heading = heading - np.clip(exact_math.arctan(0.5 * (slope[0] + slope[1])), -MOST_TURN, MOST_TURN)

    point = chosen - owner * between.shape[1]
    u, top = np.stack([u, -u]), np.full((2, len(tip)), -np.inf)
    for side in (0, 1):
        touched = u[side] <= outermost[side, owner] + CONTACT_BAND
        np.maximum.at(top[side], owner[touched], height[point[touched]])
    thin = (-contour[1] - contour[0]).max(axis=1) < LEAST_WIDTH
    area = _areas(owner, u, across.reshape(-1)[chosen], height[point], outermost, tip, half, fewest)
    # What is nearer to the object than TOUCHING belongs to the contact itself.
    distance, beside = _beside(along, across, start, end, half)
    gap = np.min(distance, axis=1, initial=wished_room, where=above & beside & (distance >= TOUCHING))
    if blockers.shape[1]:
        along, across = _turned(blockers, cos, sin, from_x, from_y)
        distance, beside = _beside(along, across, start, end, half)
        in_the_way = beside & (distance >= 0.0) & (blockers[2] > tip[:, None])
        under = beside & (distance < 0.0) & (blockers[2] > (tip + reach)[:, None])
        gap = np.minimum(gap, np.min(distance, axis=1, initial=wished_room, where=in_the_way))
        gap = np.where(under.any(axis=1), 0.0, gap)
    return Contacts(
        heading=heading,
        x=x,
        y=y,
        tip=tip,
        width=end - start,
        angle=np.abs(exact_math.arctan(slope)).max(axis=0),
        contact=_support(contour - outermost[:, :, None]).min(axis=0),
        overlap=np.where(empty, 0.0, top.min(axis=0) - tip),
        area=np.where(empty | thin, 0.0, area),
        gap=gap,
        empty=empty,
    )


def fewest_near_a_pad(points: FloatArray, pad_width: float) -> int:
    """How many points near a pad say that there is a surface: FEWEST, or less where the cloud (3, N) is too sparse.

    A surface has as many there as the cloud has on the area that a pad may touch, on the average over its extent.
    """
    x, y, _ = points
    area = float((x.max() - x.min()) * (y.max() - y.min()))
    if SHARE_NEAR * points.shape[1] * TOUCHING * pad_width >= FEWEST * area:
        return FEWEST
    return max(FEWEST_SPARSE, int(SHARE_NEAR * points.shape[1] * TOUCHING * pad_width / area))


def measured(
    cloud: FloatArray, axes: FloatArray, origin: FloatArray, contacts: Contacts, pad_width: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of measured points (3, N), between the pads of each of M grasps: their number; how far they reach, m.

    The grasps are along axes (3, 3), by columns, from an origin (3,) of the cloud's frame. The second is along the
    closing axis, the third across it.
    """
    seen = np.stack([exact_math.project(cloud, axis) - exact_math.project(origin, axis) for axis in axes.T])
    cos, sin = exact_math.cos(contacts.heading), exact_math.sin(contacts.heading)
    along, across = _turned(seen, cos, sin, contacts.x, contacts.y)
    between = (np.abs(across) <= 0.5 * pad_width) & (np.abs(along) <= (0.5 * contacts.width + HAIR)[:, None])
    between &= seen[2] > contacts.tip[:, None]
    number = between.sum(axis=1).astype(np.float64)
    least = (np.min(each, axis=1, initial=np.inf, where=between) for each in (along, across))
    most = (np.max(each, axis=1, initial=-np.inf, where=between) for each in (along, across))
    reach, breadth = (np.where(number > 0.0, high - low, 0.0) for low, high in zip(least, most, strict=True))
    return number, reach, breadth


def _turned(
    points: FloatArray, cos: FloatArray, sin: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(M, N) coordinates of points (3, N) along and across the closing axes of candidates at (x, y)."""
    px, py, _ = points
    cos, sin, x, y = cos[:, None], sin[:, None], x[:, None], y[:, None]
    return (cos * px + sin * py) - (cos * x + sin * y), (cos * py - sin * px) - (cos * y - sin * x)


def _contours(owner: IntArray, u: FloatArray, v: FloatArray, half: float, count: int) -> FloatArray:
    """(2, M, CONTOUR_ROWS) least u and least −u in each row of the pad's width, inf where it is empty.

    u, v: (P,) along and across the closing axis of the point's candidate.
    """
    key = owner * CONTOUR_ROWS + _rows(v, half)
    contour = np.full((2, count * CONTOUR_ROWS), np.inf)
    np.minimum.at(contour[0], key, u)
    np.minimum.at(contour[1], key, -u)
    return contour.reshape(2, count, CONTOUR_ROWS)


def _rows(v: FloatArray, half: float) -> IntArray:
    return np.minimum(((v + half) * (CONTOUR_ROWS / (2 * half))).astype(np.int64), CONTOUR_ROWS - 1)


def _areas(
    owner: IntArray,
    u: FloatArray,
    v: FloatArray,
    height: FloatArray,
    outermost: FloatArray,
    tip: FloatArray,
    half: float,
    fewest: int,
) -> FloatArray:
    """(M,) area of the pad beside what it touches, the lesser side: row by row down from the highest point there.

    owner, u (2, P), v, height (P,): of the points between the pads. outermost: (2, M).
    """
    areas = np.empty_like(outermost)
    row = _rows(v, half)
    for side in (0, 1):
        near = u[side] <= outermost[side, owner] + TOUCHING
        top = np.repeat(tip, CONTOUR_ROWS)
        np.maximum.at(top, (owner * CONTOUR_ROWS + row)[near], height[near])
        depth = top.reshape(-1, CONTOUR_ROWS) - tip[:, None]
        areas[side] = (depth * (2.0 * half / CONTOUR_ROWS)).sum(axis=1)
        areas[side, np.bincount(owner[near], minlength=len(tip)) < fewest] = 0.0
    return areas.min(axis=0)


def _slopes(contour: FloatArray, pad_width: float) -> FloatArray:
    """Least-squares slopes (2, M) of contours over those of their rows that are there; 0 where fewer than two are."""
    there = np.isfinite(contour)
    count = np.maximum(there.sum(axis=2, keepdims=True), 1)
    value = np.where(there, contour, 0.0)
    v = np.where(there, np.arange(CONTOUR_ROWS) * (pad_width / CONTOUR_ROWS), 0.0)
    v = np.where(there, v - v.sum(axis=2, keepdims=True) / count, 0.0)
    return (v * value).sum(axis=2) / np.maximum((v * v).sum(axis=2), 1e-12)


def _support(behind: FloatArray) -> FloatArray:
    """Share of the pad that touches, from how far each row of the contour lies behind the outermost point."""
    return np.clip((TOUCHING - behind) / (TOUCHING - ROUGHNESS), 0.0, 1.0).mean(axis=-1)


def _beside(
    along: FloatArray, across: FloatArray, start: FloatArray, end: FloatArray, half: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """(M, N) how far each point lies outside of start … end along the closing axis; whether it is in the pads' way."""
    distance = np.abs(along - (0.5 * (start + end))[:, None])
    distance -= (0.5 * (end - start))[:, None]
    return distance, np.abs(across) <= half + BESIDE
