"""Cut what stands on the table into patches: smooth pieces of surface, each of one object, an object of several.

Edges are where planes fitted on either side of a pixel fold or jump. Patches grow from the smooth inside of surfaces
up to the edges, and those are merged whose common border is hardly an edge.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grasping.segmentation import kernels
from grasping.segmentation.surface_fits import SurfaceFits

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Labels = NDArray[np.int32]

STEP = 2  # pixels to both sides of one, whose planes are compared
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
CONVEX, CONCAVE = 0.9, 1.3  # of an edge a radian: things touch in concave folds
JUMP = 0.016  # 1/m of a jump that is an edge of 1
LEVELS = (0.25, 0.4, 0.6, 1.0)  # of edge, up to which patches grow, one after the other
ANY = float(np.finfo(np.float32).max)  # of edge: the last level
LEAST_SEED = 12  # pixels from which a patch grows
LEAST_PATCH = 6  # pixels that are left over and no patch's
SMOOTH = 0.5  # mean edge of a border that divides nothing
BROKEN = 1.5  # of edge, above all levels, of a pixel beside one that lies elsewhere
CONTINUOUS = 0.03  # 1/m between a pixel and the one that it takes its label from
MOST_EDGE = 2.0
NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def cut_into_patches(fits: SurfaceFits, positions: Float32Array, asked: IntArray) -> tuple[Labels, int, Float32Array]:
    """Labels (h, w) from 1 up of the asked-for pixels (M,), 0 elsewhere; their number; and the edges (h, w).

    positions: (h, w, 3) of the pixels from the camera, m.
    """
    edge = edges(fits, positions, asked)
    if kernels.compiled is not None:
        labels = np.zeros(edge.shape, dtype=np.int32)
        count = kernels.compiled.grow_patches(edge, fits.inverse_depth, labels)
        count = kernels.compiled.merge_patches(edge, labels, count)
        return labels, count, edge
    labels, count = grow_patches_reference(edge, fits.inverse_depth)
    labels, count = merge_patches_reference(edge, labels, count)
    return labels, count, edge


def edges(fits: SurfaceFits, positions: Float32Array, asked: IntArray) -> Float32Array:
    """(h, w): how much of an edge each asked-for pixel (M,) is, from 0 up; infinite elsewhere."""
    edge = np.full(fits.inverse_depth.shape, np.inf, dtype=np.float32)
    arrays = (fits.inverse_depth, fits.slopes, fits.normals, positions)
    if kernels.compiled is not None:
        kernels.compiled.edges(*arrays, asked, edge)
    else:
        edge.reshape(-1)[asked] = edges_reference(*arrays, asked)
    return edge


def edges_reference(
    inverse_depth: Float32Array, slopes: Float32Array, normals: Float32Array, positions: Float32Array, asked: IntArray
) -> Float32Array:
    """`edges` of the asked-for pixels (M,)."""
    h, w = inverse_depth.shape
    q, slope, normal, place = (
        inverse_depth.ravel(),
        slopes.reshape(-1, 2),
        normals.reshape(-1, 3),
        positions.reshape(-1, 3),
    )
    row, column = np.divmod(asked, w)
    most = np.zeros(len(asked), dtype=np.float32)
    for down, across in DIRECTIONS:
        reach_r, reach_c = STEP * down, STEP * abs(across)
        inside = (row >= reach_r) & (row < h - reach_r) & (column >= reach_c) & (column < w - reach_c)
        step = STEP * (down * w + across)
        one, other = np.where(inside, asked - step, 0), np.where(inside, asked + step, 0)
        inside &= (q[one] > 0) & (q[other] > 0)
        here, there = np.float32(STEP * across), np.float32(STEP * down)
        from_one = q[one] + slope[one, 0] * here + slope[one, 1] * there
        from_other = q[other] - slope[other, 0] * here - slope[other, 1] * there
        jump = np.abs(from_one - from_other) * np.float32(1 / JUMP)
        turn = [normal[one, k] - normal[other, k] for k in range(3)]
        apart = [place[one, k] - place[other, k] for k in range(3)]
        chord = np.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
        convex = turn[0] * apart[0] + turn[1] * apart[1] + turn[2] * apart[2] > 0
        fold = np.where(convex, np.float32(CONVEX), np.float32(CONCAVE)) * chord
        most = np.maximum(most, np.where(inside, np.maximum(fold, jump), np.float32(0)))
    for down, across in NEIGHBOURS:
        inside = (row + down >= 0) & (row + down < h) & (column + across >= 0) & (column + across < w)
        beside = np.where(inside, asked + (down * w + across), asked)
        broken = (q[beside] > 0) & (np.abs(q[beside] - q[asked]) >= np.float32(CONTINUOUS))
        most = np.maximum(most, np.where(broken, np.float32(BROKEN), np.float32(0)))
    return most


def grow_patches_reference(edge: Float32Array, inverse_depth: Float32Array) -> tuple[Labels, int]:
    """Patches that grow level by level, by one pixel at a time, from where it is smooth, and never over a jump."""
    labels, count = np.zeros(edge.shape, dtype=np.int32), 0
    for level in (*LEVELS, ANY):
        least = LEAST_SEED if level < ANY else LEAST_PATCH
        open_ = edge <= np.float32(level)
        _grow(labels, open_, inverse_depth)
        new, found = ndimage.label(open_ & (labels == 0))
        sizes = np.bincount(new.ravel(), minlength=found + 1)
        number = np.zeros(found + 1, dtype=np.int32)
        large = np.flatnonzero(sizes[1:] >= least) + 1
        number[large] = count + 1 + np.arange(len(large))
        count += len(large)
        labels += number[new]
    return labels, count


def _grow(labels: Labels, open_: NDArray[np.bool_], inverse_depth: Float32Array) -> None:
    """Give open pixels the label of a neighbour, one ring after the other, until none is left beside a label."""
    h, w = labels.shape
    framed = np.zeros((h + 2, w + 2), dtype=np.int32)
    framed[1:-1, 1:-1] = labels
    free = np.zeros((h + 2, w + 2), dtype=bool)
    free[1:-1, 1:-1] = open_ & (labels == 0)
    depth = np.zeros((h + 2, w + 2), dtype=np.float32)
    depth[1:-1, 1:-1] = inverse_depth
    flat, free, depth = framed.ravel(), free.ravel(), depth.ravel()
    steps = [row * (w + 2) + column for row, column in NEIGHBOURS]
    front = np.flatnonzero(flat > 0)
    while len(front):
        beside = np.concatenate([front + step for step in steps])
        beside = np.unique(beside[free[beside]])
        taken = np.zeros(len(beside), dtype=np.int32)
        for step in steps:
            near = (taken == 0) & (np.abs(depth[beside + step] - depth[beside]) < np.float32(CONTINUOUS))
            taken = np.where(near, flat[beside + step], taken)
        front = beside[taken > 0]
        flat[front] = taken[taken > 0]
        free[front] = False
    labels[:] = framed[1:-1, 1:-1]


def merge_patches_reference(edge: Float32Array, labels: Labels, count: int) -> tuple[Labels, int]:
    """Merge the two patches with the smoothest border, again and again, while it is smooth."""
    neighbours: list[dict[int, tuple[float, int]]] = [{} for _ in range(count + 1)]
    for one, other in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        border = np.flatnonzero((one != other) & (one > 0) & (other > 0))
        beside = (edge[:, :-1], edge[:, 1:]) if one.shape[1] < labels.shape[1] else (edge[:-1], edge[1:])
        value = np.minimum(np.maximum(beside[0].ravel()[border], beside[1].ravel()[border]), np.float32(MOST_EDGE))
        for i, j, v in zip(one.ravel()[border].tolist(), other.ravel()[border].tolist(), value.tolist(), strict=True):
            total, pixels = neighbours[i].get(j, (0.0, 0))
            neighbours[i][j] = neighbours[j][i] = (total + v, pixels + 1)
    heap = [(v / n, i, j) for i in range(1, count + 1) for j, (v, n) in neighbours[i].items() if i < j]
    heapq.heapify(heap)
    root = np.arange(count + 1)
    while heap:
        mean, i, j = heapq.heappop(heap)
        if mean > SMOOTH:
            break
        current = neighbours[i].get(j)
        if current is None or current[0] / current[1] != mean:
            continue
        root[root == j] = i
        gone, neighbours[j] = neighbours[j], {}
        del neighbours[i][j]
        for k, (total, pixels) in gone.items():
            if k == i:
                continue
            own, own_pixels = neighbours[i].get(k, (0.0, 0))
            sums = (own + total, own_pixels + pixels)
            del neighbours[k][j]
            neighbours[i][k] = neighbours[k][i] = sums
            heapq.heappush(heap, (sums[0] / sums[1], min(i, k), max(i, k)))
    used = np.unique(root)
    number = np.zeros(count + 1, dtype=np.int32)
    number[used] = np.arange(len(used))
    return number[root][labels], len(used) - 1
