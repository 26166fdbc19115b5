"""The compiled kernels, written in csrc/. Arrays are contiguous; points are rows x, y, height of (3, N) arrays."""

import numpy as np
from numpy.typing import NDArray

INTERFACE: int

def short_side(cloud: NDArray[np.float64], axes: NDArray[np.float64], cell: float, /) -> tuple[float, float]: ...
def thin(
    cloud: NDArray[np.float64], axes: NDArray[np.float64], box: float, depth: float, thinned: NDArray[np.float64], /
) -> int:
    """Fill `thinned` (3, N); return the number of points."""

def place(
    cloud: NDArray[np.float64],
    axes: NDArray[np.float64],
    table_height: float,
    cell: float,
    local: NDArray[np.float64],
    /,
) -> tuple[float, float, float, float, float, float, float]:
    """Fill `local` (3, N); return the middle, the centre, how far it is to the farthest cell, and the volume."""

def neighbours(
    others: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle_x: float,
    middle_y: float,
    middle_z: float,
    reach_x: float,
    reach_y: float,
    cell: float,
    local: NDArray[np.float64],
    /,
) -> int:
    """others: (K, 3). Fill each row of `local` (3, K) from its start; return the number of neighbours."""

def look(
    cloud: NDArray[np.float64],
    others: NDArray[np.float64],
    unseen: NDArray[np.float64],
    x: float,
    y: float,
    z: float,
    lens: NDArray[np.float64],
    depth: NDArray[np.float64],
    /,
) -> float:
    """others: (K, 3). unseen: (U, 3). Fill `lens` (15,) and `depth` (96, 96); return the share that the cloud hides."""

def assume_back(
    cloud: NDArray[np.float64],
    up_x: float,
    up_y: float,
    up_z: float,
    floor: float,
    cell: float,
    viewpoints: NDArray[np.float64],
    lenses: NDArray[np.float64],
    depth: NDArray[np.float64],
    found: NDArray[np.float64],
    /,
) -> int:
    """Fill `found` (capacity, 3), a row each; return the number of places."""

def scan(
    object: NDArray[np.float64],
    others: NDArray[np.float64],
    tips: NDArray[np.float64],
    headings: NDArray[np.float64],
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
    pad_width: float,
    wished_room: float,
    greatest_width: float,
    reach: float,
    centre_x: float,
    centre_y: float,
    finger: int,
    wished: int,
    candidates: NDArray[np.float64],
    /,
) -> tuple[int, float, float]:
    """Fill `candidates` (9, 160), a column each; return their number, how many are too wide, their least width."""

def rank(
    object: NDArray[np.float64],
    others: NDArray[np.float64],
    lenses: NDArray[np.float64],
    depth: NDArray[np.float64],
    measured: NDArray[np.float64],
    axes: NDArray[np.float64],
    origin_x: float,
    origin_y: float,
    origin_z: float,
    candidates: NDArray[np.float64],
    count: int,
    centre_x: float,
    centre_y: float,
    rules: NDArray[np.float64],
    ranked: NDArray[np.float64],
    problems: NDArray[np.int64],
    /,
) -> tuple[int, int]:
    """Fill `ranked` (22, 64), a column each, or `problems` (64,) where none holds; return the number of either."""

def survey(
    object: NDArray[np.float64],
    hold_x: NDArray[np.float64],
    hold_y: NDArray[np.float64],
    slab_height: float,
    flat: float,
    order: NDArray[np.int64],
    parts: NDArray[np.int64],
    measures: NDArray[np.float64],
    /,
) -> int:
    """Fill `order` (N,), and `parts` (N, 7) and `measures` (N, 5) from the top; return the number of parts."""
