"""The compiled loops, written in csrc/. Arrays are contiguous; poses are (H, 4, 4).

All raise TypeError or ValueError for an array of another type or shape, and ValueError for an index out of range.
"""

import numpy as np
from numpy.typing import NDArray

INTERFACE: int

def vote(
    starts: NDArray[np.int32],
    first: NDArray[np.int32],
    turn: NDArray[np.int32],
    row: NDArray[np.int32],
    bins: NDArray[np.float64],
    turned: NDArray[np.int32],
    points: int,
    turns: int,
    fine: int,
    found: NDArray[np.int32],
    /,
) -> None:
    """Fill found (rows, peaks, 3)."""

def align(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    nearest: NDArray[np.int32],
    corner: NDArray[np.float64],
    cell: float,
    centre: NDArray[np.float64],
    scene: NDArray[np.float64],
    scene_normals: NDArray[np.float64],
    gates: NDArray[np.float64],
    poses: NDArray[np.float64],
    /,
) -> None:
    """Change poses (H, 4, 4), a step a gate."""

def partners(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    nearest: NDArray[np.int32],
    corner: NDArray[np.float64],
    cell: float,
    centre: NDArray[np.float64],
    scene: NDArray[np.float64],
    scene_normals: NDArray[np.float64],
    poses: NDArray[np.float64],
    partner: NDArray[np.int32],
    place: NDArray[np.float64],
    /,
) -> None:
    """Fill partner (H, S) and place (H, S, 3)."""

def look(
    near: NDArray[np.float64],
    far: NDArray[np.float64],
    left: float,
    top: float,
    pitch: float,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    poses: NDArray[np.float64],
    coarse: float,
    tolerance: float,
    sums: NDArray[np.float64],
    /,
) -> None:
    """Add to sums (H, 4)."""

def normals(
    points: NDArray[np.float64],
    places: NDArray[np.float64],
    axis: int,
    neighbours: int,
    normals: NDArray[np.float64],
    /,
) -> None:
    """Fill normals (M, 3) at places (M, 3); points (N, 3) in the order of the coordinate `axis`."""
