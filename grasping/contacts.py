"""One hold looked at closely, on all points: turned to lie flat on its contacts, centred, measured, checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.gripper import Gripper

FloatArray = NDArray[np.float64]

CONTOUR_ROWS = 5  # parts of a pad's width over which each contour is drawn
TOUCHING = 0.005  # m: pads are soft and clouds are noisy, a contour this near the outermost part helps to hold
CONTACT_BAND = 0.004  # m behind the outermost points: how high the surface is there says how steep it is
BESIDE = 0.003  # m on either side of a finger that must be free as well
SEARCH = 0.006  # m beyond the coarse extent in which the object's outermost points are looked for


@dataclass(frozen=True)
class Contacts:
    """A hold after refinement. Lengths in m, angles in rad, frame as for `scan`."""

    heading: float
    x: float
    y: float
    tip: float
    width: float
    angle: float  # of the worse contour against its pad
    contact: float  # share of the pad's width that touches, worse side
    overlap: float  # depth of the pad below the top of the surface it touches, worse side
    gap: float  # free space beside the object, narrower side, cut at `wished_room`
    blocked: bool  # a finger would hit something on its way in


def refine(
    xy: FloatArray,
    height: FloatArray,
    blockers: FloatArray,
    blocker_height: FloatArray,
    *,
    heading: float,
    x: float,
    y: float,
    tip: float,
    width: float,
    gripper: Gripper,
    finger_room: float,
    wished_room: float,
) -> Contacts | None:
    """Turn and centre a hold on the points between its pads; None where there are too few of them.

    blockers: (K, 2) with heights, points other than the object's own.
    """
    half = 0.5 * gripper.finger_width
    above = height > tip
    points, tops = xy[above], height[above]
    reach = 0.5 * width + SEARCH
    for last in (False, False, True):
        along, across = _turned(points, heading, x, y)
        between = (np.abs(across) <= half) & (np.abs(along) <= reach)
        if np.count_nonzero(between) < 3:
            return None
        u, v = along[between], across[between]
        low, high = _contours(u, v, half)
        left, right = _slope(low, 2 * half), _slope(high, 2 * half)
        if last:
            break
        turn = np.arctan(0.5 * (left + right))
        heading -= float(np.clip(turn, -0.15, 0.15))
        along, across = _turned(points, heading, x, y)
        between = (np.abs(across) <= half) & (np.abs(along) <= reach)
        if not between.any():
            return None
        middle = 0.5 * (along[between].min() + along[between].max())
        x += float(np.cos(heading) * middle)
        y += float(np.sin(heading) * middle)

    start, end = float(u.min()), float(u.max())
    contact = min(_support(low - start), _support(end - high))
    angle = max(abs(float(np.arctan(left))), abs(float(np.arctan(right))))
    near = tops[between]
    overlap = min(near[u <= start + CONTACT_BAND].max(), near[u >= end - CONTACT_BAND].max()) - tip

    gap = wished_room
    for other, other_height in ((points, tops), (blockers, blocker_height)):
        along, across = _turned(other, heading, x, y)
        beside = (np.abs(across) <= half + BESIDE) & (other_height > tip)
        outside = along[beside]
        outside = outside[(outside < start - 1e-9) | (outside > end + 1e-9)]
        # Points within a finger's breadth that belong to the contact itself (BESIDE is wider than the pad) move it out.
        distance = np.where(outside < start, start - outside, outside - end)
        own = distance < TOUCHING
        if own.any():
            distance = distance[~own]
        if len(distance):
            gap = min(gap, float(distance.min()))
    return Contacts(heading, x, y, tip, end - start, angle, contact, float(overlap), gap, gap < finger_room)


def _turned(points: FloatArray, heading: float, x: float, y: float) -> tuple[FloatArray, FloatArray]:
    """Coordinates along and across the closing axis of a hold at (x, y)."""
    cos, sin = np.cos(heading), np.sin(heading)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return cos * dx + sin * dy, cos * dy - sin * dx


def _contours(u: FloatArray, v: FloatArray, half: float) -> tuple[FloatArray, FloatArray]:
    """Least and greatest u in each row of the pad's width, (CONTOUR_ROWS,), NaN where a row is empty."""
    row = np.minimum(((v + half) / (2 * half) * CONTOUR_ROWS).astype(np.int64), CONTOUR_ROWS - 1)
    order = np.argsort(u)
    low, high = np.full(CONTOUR_ROWS, np.nan), np.full(CONTOUR_ROWS, np.nan)
    high[row[order]] = u[order]  # the last one written stays
    low[row[order[::-1]]] = u[order[::-1]]
    return low, high


def _slope(contour: FloatArray, pad_width: float) -> float:
    """Least-squares slope du/dv of a contour; 0 where only one of its rows is there."""
    rows = np.flatnonzero(np.isfinite(contour))
    if len(rows) < 2:
        return 0.0
    v = (rows - rows.mean()) * (pad_width / CONTOUR_ROWS)
    return float(v @ contour[rows] / (v @ v))


def _support(behind: FloatArray) -> float:
    """Share of the pad that touches, from how far each row of the contour lies behind the outermost point."""
    return float(np.where(np.isfinite(behind), np.clip(1.0 - behind / TOUCHING, 0.0, 1.0), 0.0).mean())
