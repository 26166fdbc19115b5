"""The model's nearest point to any place, looked up in a grid: one for each of six directions that a normal may have.

A thin wall has two surfaces a few millimetres apart; only the one that faces as the scene's point does is its partner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

CELLS_ALONG = 40  # of the longest side
REACH = 0.12  # of the diameter: as far beyond the model a partner is found
SIDES = 6


@dataclass(frozen=True)
class SurfaceGrid:
    """points, normals: (n, 3), object frame, m. nearest: (X, Y, Z, 6) index of the nearest point to a cell's middle
    among those whose normal's greatest part is along +x, −x, +y, −y, +z, −z; −1 where there is none. distance: (X, Y,
    Z) of the middle to the nearest of all, m, infinity beyond reach. corner: (3,) m. cell: m. centre: (3,) mean of the
    points.
    """

    points: FloatArray
    normals: FloatArray
    nearest: IntArray
    distance: FloatArray
    corner: FloatArray
    cell: float
    centre: FloatArray

    @staticmethod
    def of(points: FloatArray, normals: FloatArray, diameter: float) -> SurfaceGrid:
        low, high = points.min(axis=0) - REACH * diameter, points.max(axis=0) + REACH * diameter
        cell = float((high - low).max()) / CELLS_ALONG
        shape = np.ceil((high - low) / cell).astype(np.int64)
        axes = [low[i] + (np.arange(shape[i]) + 0.5) * cell for i in range(3)]
        middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        near, _ = cKDTree(points).query(middles, distance_upper_bound=REACH * diameter + cell)
        asked = np.flatnonzero(np.isfinite(near))
        greatest = np.abs(normals).argmax(axis=1)
        side = 2 * greatest + (normals[np.arange(len(normals)), greatest] < 0)
        nearest = np.full((len(middles), SIDES), -1, dtype=np.int32)
        for number in range(SIDES):
            own = np.flatnonzero(side == number)
            if len(own):
                nearest[asked, number] = own[cKDTree(points[own]).query(middles[asked])[1]]
        nearest = nearest.reshape(*shape, SIDES)
        return SurfaceGrid(points, normals, nearest, near.reshape(shape), low, cell, points.mean(axis=0))

    def within(self, points: FloatArray, reach: float) -> NDArray[np.bool_]:
        """Whether each of the points (N, 3), object frame, lies within a reach (m) of the surface, to half a cell."""
        number = np.floor((points - self.corner) / self.cell)
        inside = np.all((number >= 0) & (number < np.array(self.distance.shape)), axis=1)
        i, j, k = np.where(inside[:, None], number, 0).astype(np.int64).T
        return inside & (self.distance[i, j, k] <= reach)
