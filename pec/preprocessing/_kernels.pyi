"""The compiled kernels, written in _kernels.c. Arrays are contiguous."""

import numpy as np
from numpy.typing import NDArray

INTERFACE: int

def sample(points: NDArray[np.float32] | NDArray[np.float64], start: int, sampled: NDArray[np.float32], /) -> bool:
    """Fill `sampled` (n, 3); False where a coordinate is not finite or too large. start: -1 for the farthest point."""

def group(points: NDArray[np.float32], size: int, order: NDArray[np.int64], /) -> None:
    """Fill `order` (n,)."""

def arrange(
    candidates: NDArray[np.float32],
    anchors: NDArray[np.float32],
    signs: NDArray[np.float32],
    principal: bool,
    each_axis: bool,
    arranged: NDArray[np.float32],
    /,
) -> None:
    """Fill `arranged` (views, n, 3)."""

def describe(points: NDArray[np.float32], described: NDArray[np.float64], /) -> None:
    """Fill `described` (37,)."""

def isolation(points: NDArray[np.float64], distances: NDArray[np.float64], /) -> None:
    """Fill `distances` (n,); points are finite."""
