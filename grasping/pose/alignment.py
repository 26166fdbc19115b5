"""Iterative closest points of many poses at once; the compiled kernel does the same, sooner.

Every pose is moved so that the scene's points come to lie on the tangent planes of their partners on the model (Chen
and Medioni 1992), and, far more weakly, on the partners themselves: what the surfaces leave open does not drift.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.pose import kernels
from grasping.pose.surface_grid import SIDES, SurfaceGrid

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

SAME_SIDE = 0.5  # least cosine between the normals of two partners
ALONG = 0.02  # weight of the distance between partners, beside that to the tangent plane
RESTS = 1e-6  # m and rad: a pose that the last gate moves by less has come to rest
DAMPED = 1e-6  # of the normal equations' trace: a plane seen alone does not fly away


def partners(grid: SurfaceGrid, points: FloatArray, normals: FloatArray, T: FloatArray) -> tuple[IntArray, FloatArray]:
    """Of each pose (H, 4, 4) and each point (S, 3) the model's point (H, S), −1 for none, and the place (H, S, 3).

    T: T_scene_object. The place is the scene's point in the object frame.
    """
    if kernels.compiled is not None:
        found, where = np.empty((len(T), len(points)), dtype=np.int32), np.empty((len(T), len(points), 3))
        kernels.compiled.partners(
            *(grid.points, grid.normals, grid.nearest, grid.corner, grid.cell, grid.centre),
            *(np.ascontiguousarray(points), np.ascontiguousarray(normals), np.ascontiguousarray(T), found, where),
        )
        return found, where
    x, y, z = (points[None, :, i] - T[:, i, 3, None] for i in range(3))
    place = [T[:, 0, i, None] * x + T[:, 1, i, None] * y + T[:, 2, i, None] * z for i in range(3)]
    a, b, c = normals.T[:, None, :]
    facing = [T[:, 0, i, None] * a + T[:, 1, i, None] * b + T[:, 2, i, None] * c for i in range(3)]
    shape = grid.nearest.shape[:3]
    number = [np.floor((place[i] - grid.corner[i]) / grid.cell) for i in range(3)]
    inside = np.logical_and.reduce([(number[i] >= 0) & (number[i] < shape[i]) for i in range(3)])
    i, j, k = (np.where(inside, n, 0).astype(np.int64) for n in number)
    flat = (i * shape[1] + j) * shape[2] + k
    best = np.full(inside.shape, np.inf)
    partner = np.full(inside.shape, -1, dtype=np.int32)
    for side in range(SIDES):
        index = grid.nearest[..., side].reshape(-1)[flat]
        q, n = grid.points[index], grid.normals[index]
        dx, dy, dz = (place[i] - q[..., i] for i in range(3))
        squared = dx * dx + dy * dy + dz * dz
        alike = facing[0] * n[..., 0] + facing[1] * n[..., 1] + facing[2] * n[..., 2]
        better = inside & (index >= 0) & (alike > SAME_SIDE) & (squared < best)
        best[better] = squared[better]
        partner[better] = index[better]
    return partner, np.stack(place, axis=-1)


def align(
    grid: SurfaceGrid, points: FloatArray, normals: FloatArray, start: FloatArray, gates: FloatArray
) -> FloatArray:
    """T_scene_object (H, 4, 4) after one step a gate (m), beyond which points have no partner, from `start`.

    Where the last gate comes several times a pose that has come to rest stays.
    points, normals: (S, 3) of the scene, seen from outside.
    """
    T = np.ascontiguousarray(start, dtype=np.float64).copy()
    if not len(T) or not len(points):
        return T
    if kernels.compiled is not None:
        kernels.compiled.align(
            *(grid.points, grid.normals, grid.nearest, grid.corner, grid.cell, grid.centre),
            *(np.ascontiguousarray(points), np.ascontiguousarray(normals), gates, T),
        )
        return T
    moving = np.arange(len(T))
    for gate in gates:
        step = _step(grid, points, normals, T[moving], float(gate))
        T[moving] = moved_back(T[moving], step, grid.centre)
        if gate == gates[-1]:
            moving = moving[(np.abs(step) >= RESTS).any(axis=1)]
    return T


def _step(grid: SurfaceGrid, points: FloatArray, normals: FloatArray, T: FloatArray, gate: float) -> FloatArray:
    """(H, 6) by which the object frame's points are to be moved, as `moved_back` takes it."""
    partner, place = partners(grid, points, normals, T)
    q, n = grid.points[partner], grid.normals[partner]
    e = [place[..., i] - q[..., i] for i in range(3)]
    squared = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    near = 1.0 - squared / (gate * gate)
    weight = np.where((partner >= 0) & (near > 0.0), near * near, 0.0)
    arm = [place[..., i] - grid.centre[i] for i in range(3)]
    zero, one = np.zeros_like(weight), np.ones_like(weight)
    nx, ny, nz = (n[..., i] for i in range(3))
    rows = [
        ([nx, ny, nz], e[0] * nx + e[1] * ny + e[2] * nz, weight),
        ([one, zero, zero], e[0], weight * ALONG),
        ([zero, one, zero], e[1], weight * ALONG),
        ([zero, zero, one], e[2], weight * ALONG),
    ]
    A, b = np.zeros((len(T), 6, 6)), np.zeros((len(T), 6))
    for axis, residual, w in rows:
        x, y, z = axis
        jacobian = [arm[1] * z - arm[2] * y, arm[2] * x - arm[0] * z, arm[0] * y - arm[1] * x, x, y, z]
        for i in range(6):
            weighted = w * jacobian[i]
            b[:, i] += np.add.accumulate(weighted * residual, axis=1)[:, -1]
            for j in range(i + 1):
                A[:, i, j] += np.add.accumulate(weighted * jacobian[j], axis=1)[:, -1]
    return solved(A, b)


def solved(A: FloatArray, b: FloatArray) -> FloatArray:
    """The steps x (H, 6) of A x = −b by Cholesky's decomposition of A (H, 6, 6), of which the lower half is read."""
    A, x = A.copy(), -b
    trace = A[:, 0, 0].copy()
    for i in range(1, 6):
        trace = trace + A[:, i, i]
    for i in range(6):
        A[:, i, i] = A[:, i, i] + (DAMPED * trace + 1e-12)
    for j in range(6):
        for k in range(j):
            A[:, j, j] = A[:, j, j] - A[:, j, k] * A[:, j, k]
        A[:, j, j] = np.sqrt(np.maximum(A[:, j, j], 1e-18))
        for i in range(j + 1, 6):
            for k in range(j):
                A[:, i, j] = A[:, i, j] - A[:, i, k] * A[:, j, k]
            A[:, i, j] = A[:, i, j] / A[:, j, j]
    for i in range(6):
        for k in range(i):
            x[:, i] = x[:, i] - A[:, i, k] * x[:, k]
        x[:, i] = x[:, i] / A[:, i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            x[:, i] = x[:, i] - A[:, k, i] * x[:, k]
        x[:, i] = x[:, i] / A[:, i, i]
    return x


def moved_back(T: FloatArray, step: FloatArray, centre: FloatArray) -> FloatArray:
    """T_scene_object (H, 4, 4) after the object frame's points were moved by `step` (H, 6): a turn about the centre, as
    Cayley's transform has it, and a shift.
    """
    a, b, c = (0.5 * step[:, i] for i in range(3))
    d = 1.0 + a * a + b * b + c * c
    # R of the step; its inverse, the transpose, is what the pose takes up.
    R = [
        [(1.0 + a * a - b * b - c * c) / d, 2.0 * (a * b - c) / d, 2.0 * (a * c + b) / d],
        [2.0 * (a * b + c) / d, (1.0 - a * a + b * b - c * c) / d, 2.0 * (b * c - a) / d],
        [2.0 * (a * c - b) / d, 2.0 * (b * c + a) / d, (1.0 - a * a - b * b + c * c) / d],
    ]
    # p' = R (p − m) + m + v, so p = Rᵀ (p' − m − v) + m
    shift = []
    at = [centre[i] + step[:, 3 + i] for i in range(3)]
    for i in range(3):
        shift.append(centre[i] - (R[0][i] * at[0] + R[1][i] * at[1] + R[2][i] * at[2]))
    out = np.zeros_like(T)
    out[:, 3, 3] = 1.0
    for i in range(3):
        for j in range(3):
            out[:, i, j] = T[:, i, 0] * R[j][0] + T[:, i, 1] * R[j][1] + T[:, i, 2] * R[j][2]
        out[:, i, 3] = T[:, i, 0] * shift[0] + T[:, i, 1] * shift[1] + T[:, i, 2] * shift[2] + T[:, i, 3]
    return out
