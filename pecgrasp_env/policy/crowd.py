"""Among many objects: which lies on which, as far as was seen, and on what an object lies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError, cKDTree

from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.robot.kinematics import UP

_CELL_M = 0.005
_HIGHER_M = 0.008  # than the seen edge of what lies below it
_NEXT_M = 0.010
_LEAST_OVERLAP_M2 = 2e-4  # twice what the task asks for: outlines of half-seen things are rough
_COVERS = 0.10  # of an object's outline: of what covers less a quarter lies beside it, and it can be tipped off
_GULF_M = 0.03  # half the width of a gap in what is seen of an object that another may fill: what lies on it hides it
_AROUND_M = 0.05
_THICKEST_FLOOR_M = 0.015
_NO_FLOOR_M = 0.002  # a table is measured better than that
_LEAST_FLOOR = 50  # points
_DOWN_M = 0.010  # above the table or the floor of a bin: what is seen so far down stands there


def lying_on(objects: Sequence[SeenObject], lower: int) -> dict[int, float]:
    """The objects that lie on objects[lower], each with the share of its outline (convex, seen from above) that it
    covers.
    """
    outline = _outline(objects[lower].points)
    if outline is None:
        return {}
    edge = cKDTree(objects[lower].points[:, :2])
    heights = objects[lower].points[:, 2]
    found = {}
    for k, seen in enumerate(objects):
        if k == lower:
            continue
        cells, tops = _cells(seen.points)
        inside = (cells @ outline[:, :2].T + outline[:, 2] <= 0).all(axis=1)
        if not inside.any():
            continue
        # The nearest of what is seen of the lower one ends where it is covered.
        _, nearest = edge.query(cells[inside])
        over = np.count_nonzero(tops[inside] > heights[nearest] + _HIGHER_M) * _CELL_M**2
        if over >= _LEAST_OVERLAP_M2:
            found[k] = min(1.0, over / ConvexHull(objects[lower].points[:, :2]).volume)
    return found


def borne_by(objects: Sequence[SeenObject], lower: int, plane: np.ndarray | None) -> list[int]:
    """Those that lie on objects[lower] and are not seen to reach down to the plane (4,), or z = 0: what stands there or
    leans stays behind by itself when the lower one is lifted.
    """
    return _not_standing(objects, lying_on(objects, lower), plane)


def _not_standing(objects: Sequence[SeenObject], which: Iterable[int], plane: np.ndarray | None) -> list[int]:
    normal, offset = (UP, 0.0) if plane is None else (plane[:3], plane[3])
    return [k for k in which if np.quantile(objects[k].points @ normal + offset, 0.02) > _DOWN_M]


def stands_over(objects: Sequence[SeenObject], lower: int) -> np.ndarray | None:
    """From objects[lower] towards what stands next to it and higher, (2,) m: there it may lie on it, unseen from above;
    None where nothing does.
    """
    edge = cKDTree(objects[lower].points[:, :2])
    heights = objects[lower].points[:, 2]
    over = []
    for k, seen in enumerate(objects):
        if k != lower:
            cells, tops = _cells(seen.points)
            distance, nearest = edge.query(cells, distance_upper_bound=_NEXT_M)
            near = np.isfinite(distance)
            over.append(cells[near][tops[near] > heights[nearest[near]] + _HIGHER_M])
    found = np.concatenate([np.zeros((0, 2)), *over])
    if len(found) * _CELL_M**2 < _LEAST_OVERLAP_M2:
        return None
    return np.asarray(found.mean(axis=0) - objects[lower].centroid[:2])


def uppermost_on(objects: Sequence[SeenObject], lower: int, floor: np.ndarray | None = None) -> list[int]:
    """Which objects can be taken off objects[lower]: those that surely lie on it (`surely_on`) and are not seen to
    stand on the floor, the plane (4,) on which it lies, or others so on them, on which nothing lies; the highest first.
    """
    borne = _not_standing(objects, surely_on(objects, lower), floor)
    upon, pending, free = {lower, *borne}, borne, []
    while pending:
        k = pending.pop()
        above = _not_standing(objects, surely_on(objects, k), floor)
        if not above:
            free.append(k)
        pending += [each for each in above if each not in upon]
        upon.update(above)
    return sorted(free, key=lambda k: -float(objects[k].points[:, 2].max()))


def surely_on(objects: Sequence[SeenObject], lower: int) -> list[int]:
    """The objects that cover a good share of objects[lower], and not only of what is around it: seen from above, its
    outline here follows its own shape, but for gaps that something on it may make.
    """
    cells, tops = _cells(objects[lower].points)
    margin = round(_GULF_M / _CELL_M)
    corner = np.floor(cells.min(axis=0) / _CELL_M).astype(int) - margin - 1

    def index_of(cells: np.ndarray) -> np.ndarray:
        return np.asarray(np.floor(cells / _CELL_M).astype(int) - corner)

    own = index_of(cells)
    height = np.full(own.max(axis=0) + margin + 2, -np.inf)
    height[tuple(own.T)] = tops
    seen = np.isfinite(height)
    outline = ndimage.binary_closing(seen, np.hypot(*np.mgrid[-margin : margin + 1, -margin : margin + 1]) <= margin)
    nearest = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
    height = np.where(outline, height[tuple(nearest)], np.inf)
    least = max(_COVERS * np.count_nonzero(outline), _LEAST_OVERLAP_M2 / _CELL_M**2)
    found = []
    for k, other in enumerate(objects):
        if k != lower:
            cells, tops = _cells(other.points)
            at = index_of(cells)
            inside = ((at >= 0) & (at < height.shape)).all(axis=1)
            over = tops[inside] > height[tuple(at[inside].T)] + _HIGHER_M
            if np.count_nonzero(over) >= least:
                found.append(k)
    return found


def floor_below(points: np.ndarray, around: np.ndarray, plane: np.ndarray | None) -> np.ndarray | None:
    """The plane (4,) on which an object (M, 3) lies: the table's, or one just above it, as the bottom of a bin is.

    around: (K, 3) of all that was seen.
    """
    normal, offset = (UP, 0.0) if plane is None else (plane[:3], plane[3])
    height = around @ normal + offset
    near = np.abs(height) < _THICKEST_FLOOR_M
    low, high = points[:, :2].min(axis=0) - _AROUND_M, points[:, :2].max(axis=0) + _AROUND_M
    near &= ((around[:, :2] > low) & (around[:, :2] < high)).all(axis=1)
    if np.count_nonzero(near) < _LEAST_FLOOR:
        return plane
    rise = float(np.median(height[near]))
    return plane if rise < _NO_FLOOR_M else np.append(normal, offset - rise)


def without_rim(points: np.ndarray, rim: float) -> np.ndarray:
    """The points (M, 3) of an object that lie further than ``rim`` (m) within its outline, seen from above: what a
    finger meets that pushes it aside by so much. Of what is thinner all.
    """
    cells = np.floor(points[:, :2] / _CELL_M).astype(int)
    cells -= cells.min(axis=0) - 1
    covered = np.zeros(cells.max(axis=0) + 2, bool)
    covered[tuple(cells.T)] = True
    inside = ndimage.distance_transform_edt(ndimage.binary_closing(covered)) * _CELL_M
    inner = inside[tuple(cells.T)] > rim
    return points[inner] if inner.any() else points


def _cells(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres (C, 2) of the cells of the table over which points lie, and the height of the highest in each."""
    cells, index = np.unique(np.floor(points[:, :2] / _CELL_M).astype(np.int64), axis=0, return_inverse=True)
    tops = np.full(len(cells), -np.inf)
    np.maximum.at(tops, index.reshape(-1), points[:, 2])
    return (cells + 0.5) * _CELL_M, tops


def _outline(points: np.ndarray) -> np.ndarray | None:
    """Edges (E, 3) of the convex outline seen from above: a · p + b <= 0 inside; None where it has no area."""
    try:
        return np.asarray(ConvexHull(points[:, :2]).equations)
    except QhullError:
        return None
