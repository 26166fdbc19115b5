"""The compiled kernels behind the signatures of their NumPy references: the same results to the last bit, sooner.

`AVAILABLE` says whether this installation has them: without a compiler at hand, or after a change of the sources that
was not built yet, it has not, and the planner takes the references.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping.contacts import Contacts
from grasping.primitives import FLAT
from grasping.profiles import MEASURED, Holds, Scan, bins_of_room
from grasping.survey import Parts
from grasping.views import View

FloatArray = NDArray[np.float64]

INTERFACE = 2  # as in _kernels.c


def _load() -> Any:
    try:
        from grasping import _kernels
    except ImportError:
        return None
    return _kernels if getattr(_kernels, "INTERFACE", None) == INTERFACE else None


_KERNELS = _load()
AVAILABLE = _KERNELS is not None


def short_side(cloud: FloatArray, axes: FloatArray, cell: float) -> tuple[float, float]:
    """`projection.short_side`."""
    return _KERNELS.short_side(cloud, np.ascontiguousarray(axes), cell)


def thin(cloud: FloatArray, axes: FloatArray, box: float) -> FloatArray:
    """`projection.thin`."""
    thinned = np.empty_like(cloud)
    return np.ascontiguousarray(thinned[:, : _KERNELS.thin(cloud, np.ascontiguousarray(axes), box, thinned)])


def place(
    cloud: FloatArray, axes: FloatArray, table_height: float | None, cell: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`projection.place`."""
    local = np.empty_like(cloud)
    height = math.nan if table_height is None else table_height
    *middle, x, y = _KERNELS.place(cloud, np.ascontiguousarray(axes), height, cell, local)
    return local, np.array(middle), np.array([x, y])


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
    """`profiles.scan`."""
    finger, wished = bins_of_room(finger_room, wished_room)
    terms = np.empty((9, MEASURED))
    count, too_wide, narrowest = _KERNELS.scan(
        _rows(xy, height),
        _rows(obstacle_xy, obstacle_height),
        tips,
        headings,
        np.cos(headings),
        np.sin(headings),
        pad_width,
        wished_room,
        greatest_width,
        centre[0],
        centre[1],
        finger,
        wished,
        terms,
    )
    heading, x, y, tip, width, overlap, angle, room, whole = terms[:, :count]
    return Scan(Holds(heading, x, y, tip, width, overlap, angle, room, whole > 0.0), int(too_wide), narrowest)


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
    """`contacts.refine`."""
    found = np.empty((9, len(holds)))
    coarse = (holds.heading, holds.x, holds.y, holds.tip, holds.width)
    _KERNELS.refine(_rows(xy, height), _rows(blocker_xy, blocker_height), *coarse, pad_width, wished_room, found)
    heading, x, y, width, angle, contact, overlap, gap, empty = found
    return Contacts(heading, x, y, holds.tip, width, angle, contact, overlap, gap, empty > 0.0)


def measured_parts(view: View, holds: Holds | None, slab_height: float) -> Parts:
    """`survey.measured_parts`."""
    count = len(view.height)
    order, table, measures = np.empty(count, np.int64), np.empty((count, 7), np.int64), np.empty((count, 5))
    x, y = (_NONE, _NONE) if holds is None else (holds.x, holds.y)
    found = _KERNELS.survey(_rows(view.xy, view.height), x, y, slab_height, FLAT, order, table, measures)
    measures = measures[:found]
    return Parts(order, table[:found], measures[:, :2], measures[:, 2:4], measures[:, 4])


_NONE = np.empty(0)


def _rows(xy: FloatArray, height: FloatArray) -> FloatArray:
    rows = np.empty((3, len(height)))
    rows[:2], rows[2] = xy.T, height
    return rows
