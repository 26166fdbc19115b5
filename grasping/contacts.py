"""Holds looked at closely, on all points: turned to lie flat on their contacts, centred, measured, checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.profiles import Holds

FloatArray = NDArray[np.float64]

CONTOUR_ROWS = 5  # parts of a pad's width over which each contour is drawn
TOUCHING = 0.006  # m: a contour farther behind the outermost part does not help to hold
ROUGHNESS = 0.002  # m: pads are soft and clouds are noisy, a contour this near to it helps in full
CONTACT_BAND = 0.004  # m behind the outermost points: how high the surface is there says how steep it is
BESIDE = 0.003  # m on either side of a finger that must be free as well
SEARCH = 0.006  # m beyond the coarse extent in which the object's outermost points are looked for
MOST_TURN = 0.15  # rad in one step: half of the scan's step and what its resolution adds
STEPS = 2


@dataclass(frozen=True)
class Contacts:
    """M holds after refinement, arrays of length M. Lengths in m, angles in rad, frame as for `scan`."""

    heading: FloatArray
    x: FloatArray
    y: FloatArray
    tip: FloatArray
    width: FloatArray
    angle: FloatArray  # of the worse contour against its pad
    contact: FloatArray  # share of the pad's width that touches, worse side: 1 less the contour's lateral curvature
    overlap: FloatArray  # depth of the pad below the top of the surface that it touches, worse side
    gap: FloatArray  # free space beside the object, narrower side, cut at `wished_room`
    empty: NDArray[np.bool_]  # too few points between the pads for the rest to mean anything


def refine(
    xy: FloatArray,
    height: FloatArray,
    blocker_xy: FloatArray,
    blocker_height: FloatArray,
    holds: Holds,
    *,
    pad_width: float,
    wished_room: float,
) -> Contacts:
    """Turn and centre each hold on the points between its pads.

    xy (N, 2) with heights (N,): the object. blocker_xy (K, 2) with heights: anything else that a finger could hit.
    """
    half = 0.5 * pad_width
    heading, x, y, tip = holds.heading, holds.x, holds.y, holds.tip
    reach = 0.5 * holds.width + SEARCH
    above = height > tip[:, None]
    for step in range(STEPS + 1):
        along, across = _turned(xy, heading, x, y)
        between = above & (np.abs(across) <= half) & (np.abs(along) <= reach[:, None])
        low, high = _contours(along, across, between, half)
        left, right = _slopes(low, pad_width), _slopes(high, pad_width)
        start, end = low.min(axis=1), high.max(axis=1)
        empty = ~np.isfinite(start) | (between.sum(axis=1) < 3)
        start, end = np.where(empty, 0.0, start), np.where(empty, 0.0, end)
        if step == STEPS:
            break
        middle = 0.5 * (start + end)
        x, y = x + np.cos(heading) * middle, y + np.sin(heading) * middle
        heading = heading - np.clip(np.arctan(0.5 * (left + right)), -MOST_TURN, MOST_TURN)
    middle = 0.5 * (start + end)
    x, y = x + np.cos(heading) * middle, y + np.sin(heading) * middle

    def top_at(side: NDArray[np.bool_]) -> FloatArray:
        return np.where(between & side, height, -np.inf).max(axis=1)

    tops = np.minimum(top_at(along <= start[:, None] + CONTACT_BAND), top_at(along >= end[:, None] - CONTACT_BAND))
    gap = np.minimum(
        _gap(along, across, above, start, end, half, wished_room),
        _gap(
            *_turned(blocker_xy, heading, x - np.cos(heading) * middle, y - np.sin(heading) * middle),
            blocker_height > tip[:, None],
            start,
            end,
            half,
            wished_room,
        ),
    )
    return Contacts(
        heading=heading,
        x=x,
        y=y,
        tip=tip,
        width=end - start,
        angle=np.maximum(np.abs(np.arctan(left)), np.abs(np.arctan(right))),
        contact=np.minimum(_support(low - start[:, None]), _support(end[:, None] - high)),
        overlap=np.where(empty, 0.0, tops - tip),
        gap=gap,
        empty=empty,
    )


def _turned(points: FloatArray, heading: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(M, N) coordinates along and across the closing axes of holds at (x, y)."""
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    dx, dy = points[:, 0] - x[:, None], points[:, 1] - y[:, None]
    return cos * dx + sin * dy, cos * dy - sin * dx


def _contours(
    along: FloatArray, across: FloatArray, between: NDArray[np.bool_], half: float
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest coordinate in each row of the pad's width, (M, CONTOUR_ROWS); inf and −inf where empty."""
    hold, point = np.nonzero(between)
    u, v = along[hold, point], across[hold, point]
    row = np.minimum(((v + half) * (CONTOUR_ROWS / (2 * half))).astype(np.int64), CONTOUR_ROWS - 1)
    key = hold * CONTOUR_ROWS + row
    order = np.argsort(u)
    key, u = key[order], u[order]
    low = np.full(len(between) * CONTOUR_ROWS, np.inf)
    high = np.full(len(between) * CONTOUR_ROWS, -np.inf)
    high[key] = u  # of several values for one place the last one written stays
    low[key[::-1]] = u[::-1]
    return low.reshape(-1, CONTOUR_ROWS), high.reshape(-1, CONTOUR_ROWS)


def _slopes(contour: FloatArray, pad_width: float) -> FloatArray:
    """Least-squares slope (M,) of each contour over those of its rows that are there; 0 where fewer than two are."""
    there = np.isfinite(contour)
    count = np.maximum(there.sum(axis=1), 1)[:, None]
    value = np.where(there, contour, 0.0)
    value = np.where(there, value - value.sum(axis=1, keepdims=True) / count, 0.0)
    v = np.arange(CONTOUR_ROWS) * (pad_width / CONTOUR_ROWS) * there
    v = np.where(there, v - v.sum(axis=1, keepdims=True) / count, 0.0)
    return (v * value).sum(axis=1) / np.maximum((v * v).sum(axis=1), 1e-12)


def _support(behind: FloatArray) -> FloatArray:
    """Share (M,) of the pad that touches, from how far each row of the contour lies behind the outermost point."""
    return np.clip((TOUCHING - behind) / (TOUCHING - ROUGHNESS), 0.0, 1.0).mean(axis=1)


def _gap(
    along: FloatArray,
    across: FloatArray,
    above: NDArray[np.bool_],
    start: FloatArray,
    end: FloatArray,
    half: float,
    most: float,
) -> FloatArray:
    """Free space (M,) beside start … end. What is nearer than TOUCHING belongs to the contact itself."""
    if not along.shape[1]:
        return np.full(len(along), most)
    distance = np.maximum(start[:, None] - along, along - end[:, None])
    in_the_way = above & (np.abs(across) <= half + BESIDE) & (distance >= TOUCHING)
    return np.where(in_the_way, distance, most).min(axis=1, initial=most)
