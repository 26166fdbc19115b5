"""Point-pair features of a model, in a table by their bins (Drost et al. 2010, "Model globally, match locally").

A pair of oriented points has four numbers that no rigid motion changes: their distance and the angles between their
normals and the line that joins them, and between the two normals. Pairs of the model that fall into one bin are kept
together with where they lie round the first one's normal, so that a pair of the scene finds in one step all poses that
would bring a pair of the model onto it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

ANGLES = 15  # bins of 12° from 0 to 180°
TURNS = 30  # bins of the turn about a normal, 12° each
FINE = 8  # parts of such a bin in which turns are kept, so that the difference of two is right to a part
DISTANCES = 21  # bins, each of a twentieth of the diameter, and what rounding adds
CELLS = DISTANCES * ANGLES**3
SPREAD = 0.25  # of a bin: a pair of the scene that near a border counts beyond it, too (Vidal et al. 2018)


def frames(points: FloatArray, normals: FloatArray) -> FloatArray:
    """T_local_points (N, 4, 4): the point in the origin, its normal along x, the rest fixed by the normal alone."""
    x = normals
    # The axis that the normal leans to least, so that none is nearly parallel to it.
    least = np.eye(3)[np.abs(x).argmin(axis=1)]
    y = np.cross(x, least)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    T = np.zeros((len(points), 4, 4))
    T[:, 0, :3], T[:, 1, :3], T[:, 2, :3] = x, y, np.cross(x, y)
    T[:, :3, 3] = -np.einsum("nij,nj->ni", T[:, :3, :3], points)
    T[:, 3, 3] = 1.0
    return T


@dataclass(frozen=True)
class Pairs:
    """Pairs of a sample: which two, the numbers that describe them in bins (Q, 4), and the turn in fine parts (Q,)."""

    first: IntArray
    second: IntArray
    bins: FloatArray
    turn: IntArray


def pairs_of(points: FloatArray, normals: FloatArray, firsts: NDArray, step: float, farthest: float) -> Pairs:
    """Pairs of each of the points `firsts` with every other that is at most `farthest` m away."""
    local = frames(points[firsts], normals[firsts])
    offset = points[None] - points[firsts][:, None]  # (R, N, 3)
    distance = np.sqrt(np.einsum("rni,rni->rn", offset, offset))
    row, second = np.nonzero((distance < farthest) & (distance > 0.5 * step))
    distance = distance[row, second]
    along = offset[row, second] / distance[:, None]
    n1, n2 = normals[firsts][row], normals[second]
    cosines = [np.einsum("ij,ij->i", a, b) for a, b in ((n1, along), (n2, along), (n1, n2))]
    angles = [np.arccos(np.clip(c, -1.0, 1.0)) * (ANGLES / np.pi) for c in cosines]
    bins = np.stack([distance / step, *angles], axis=1)
    y = np.einsum("ij,ij->i", local[row, 1, :3], along)
    z = np.einsum("ij,ij->i", local[row, 2, :3], along)
    turn = np.floor((np.arctan2(z, y) / (2.0 * np.pi) + 0.5) * (TURNS * FINE)).astype(np.int32) % (TURNS * FINE)
    return Pairs(row.astype(np.int32), second.astype(np.int32), bins, turn)


def cells_of(bins: FloatArray) -> IntArray:
    """The cell (Q,) of the table that numbers in bins (Q, 4) fall into."""
    whole = np.floor(bins).astype(np.int32)
    np.minimum(whole, [DISTANCES - 1, ANGLES - 1, ANGLES - 1, ANGLES - 1], out=whole)
    return (((whole[:, 0] * ANGLES + whole[:, 1]) * ANGLES + whole[:, 2]) * ANGLES + whole[:, 3]).astype(np.int32)


def spread_cells(bins: FloatArray) -> tuple[IntArray, IntArray]:
    """As `cells_of`, with the neighbours of what is near a border: (pair (K,), cell (K,)), by pair."""
    limits = np.array([DISTANCES, ANGLES, ANGLES, ANGLES], dtype=np.int32)
    whole = np.minimum(np.floor(bins).astype(np.int32), limits - 1)
    part = bins - whole
    step = (part > 1.0 - SPREAD).astype(np.int32) - (part < SPREAD).astype(np.int32)
    step[(whole + step < 0) | (whole + step >= limits)] = 0
    strides = np.array([ANGLES**3, ANGLES**2, ANGLES, 1], dtype=np.int32)
    cell = (whole * strides).sum(axis=1, dtype=np.int32)
    pair = np.arange(len(bins), dtype=np.int32)
    for axis in range(4):
        near = step[pair, axis] != 0
        cell = np.concatenate([cell, cell[near] + step[pair[near], axis] * strides[axis]])
        pair = np.concatenate([pair, pair[near]])
    order = np.argsort(pair, kind="stable")
    return pair[order], cell[order]


@dataclass(frozen=True)
class PairTable:
    """A model's sample and its pairs by cell.

    points, normals: (n, 3), object frame, m. step: the bins of distances, m. to_local: (n, 4, 4) of `frames`. starts:
    (CELLS + 1,) of each cell's entries in `first` (E,), the pair's first point, and `turn` (E,), in fine parts.
    """

    points: FloatArray
    normals: FloatArray
    step: float
    to_local: FloatArray
    starts: IntArray
    first: IntArray
    turn: IntArray

    @staticmethod
    def of(points: FloatArray, normals: FloatArray, step: float) -> PairTable:
        """All pairs of a sample (n, 3), which is at most DISTANCES steps (m) long."""
        pairs = pairs_of(points, normals, np.arange(len(points)), step, np.inf)
        cells = cells_of(pairs.bins)
        order = np.argsort(cells, kind="stable")
        starts = np.searchsorted(cells[order], np.arange(CELLS + 1)).astype(np.int32)
        first, turn = pairs.first[order], pairs.turn[order]
        return PairTable(points, normals, step, frames(points, normals), starts, first, turn)
