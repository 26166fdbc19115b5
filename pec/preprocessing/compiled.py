"""The compiled kernels that preprocess one cloud, behind the signatures of their references.

`AVAILABLE` says whether this installation has them: without a compiler at hand, or after a change of the sources that
was not built yet, it has not, and the references do their work.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["AVAILABLE", "arranged", "described", "farthest_points", "group_order", "isolation", "surface_forms"]

INTERFACE = 4  # as in _kernels.c


def _load() -> Any:
    try:
        from pec.preprocessing import _kernels
    except ImportError:
        return None
    return _kernels if getattr(_kernels, "INTERFACE", None) == INTERFACE else None


_KERNELS = _load()
AVAILABLE = _KERNELS is not None


def farthest_points(points: np.ndarray, n: int, start: int | None) -> np.ndarray | None:
    """`preprocess.farthest_points`, to the last bit; None where that must judge what is wrong with the points."""
    sampled = np.empty((n, 3), np.float32)
    ordinary = _KERNELS.sample(np.ascontiguousarray(points), -1 if start is None else start, sampled)
    return sampled if ordinary else None


def described(points: np.ndarray) -> np.ndarray:
    """`pec.known.shape_distribution.describe_cloud` of points (n, 3) float32: (37,), but for rounding."""
    out = np.empty(37)
    _KERNELS.describe(np.ascontiguousarray(points), out)
    return out


def surface_forms(points: np.ndarray) -> np.ndarray:
    """`pec.known.surface_forms.surface_forms` of points (n, 3) float32, n > 1: (78,), but for rounding."""
    out = np.empty(78)
    _KERNELS.forms(np.ascontiguousarray(points), out)
    return out


def group_order(points: np.ndarray, group_size: int) -> np.ndarray:
    """`ordering.group_order` of one cloud (n, 3) float32, to the last bit."""
    order = np.empty(len(points), np.int64)
    _KERNELS.group(points, group_size, order)
    return order


def isolation(points: np.ndarray) -> np.ndarray:
    """`isolated.isolation` of finite points (n, 3), but for rounding: (n,) float64."""
    out = np.empty(len(points))
    _KERNELS.isolation(np.ascontiguousarray(points, np.float64), out)
    return out


def arranged(
    candidates: np.ndarray, anchors: np.ndarray, signs: np.ndarray, *, principal: bool, each_axis: bool
) -> np.ndarray:
    """Candidates (K, 3) that are nearest to the anchors (n, 3), in each of the poses signs (V, 3): (V, n, 3) float32.

    As `pose.principal_pose` and `ordering.nearest_candidates` in turn, but for rounding: inside it is double precision.
    The signs of principal axes are left as they come, in a right-handed frame: all four views are the same four.
    """
    out = np.empty((len(signs), len(anchors), 3), np.float32)
    _KERNELS.arrange(candidates, anchors, signs, principal, each_axis, out)
    return out
