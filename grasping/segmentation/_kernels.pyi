"""The compiled kernels, written in csrc/. Arrays are contiguous; images are (h, w), inverse depths in 1/m.

All raise TypeError or ValueError for an array of another type or shape, and ValueError for an index out of range.
"""

import numpy as np
from numpy.typing import NDArray

INTERFACE: int

def positions(
    inverse_depth: NDArray[np.float32],
    along: NDArray[np.float32],
    down: NDArray[np.float32],
    positions: NDArray[np.float32],
    /,
) -> None:
    """Fill positions (h, w, 3) by what columns (w, 3) and rows (h, 3) add to the rays."""

def square_distances(
    points: NDArray[np.float32] | NDArray[np.float64],
    nearest: float,
    farthest: float,
    squared: NDArray[np.float32] | NDArray[np.float64],
    valid: NDArray[np.bool_],
    /,
) -> None:
    """Fill squared and valid (N,) of points (N, 3)."""

def inverse_depths(
    points: NDArray[np.float32] | NDArray[np.float64],
    valid: NDArray[np.bool_],
    x: float,
    y: float,
    z: float,
    camera_depth: float,
    inverse_depth: NDArray[np.float32],
    /,
) -> None:
    """Fill inverse_depth (N,) of points (N, 3), whose depth is (x, y, z) · point − camera_depth."""

def mean_of_nine(values: NDArray[np.float32], measured: NDArray[np.bool_], mean: NDArray[np.float32], /) -> None:
    """Fill mean (h, w)."""

def label_pieces(mask: NDArray[np.bool_], labels: NDArray[np.int32], /) -> int:
    """Fill labels (h, w); return the number of pieces."""

def steps_to_borders(labels: NDArray[np.int32], unknown: NDArray[np.bool_], steps: NDArray[np.uint8], /) -> None:
    """Fill steps (2, h, w), along the rows and down the columns."""

def reduce_blocks(inverse_depth: NDArray[np.float32], block: int, reduced: NDArray[np.float32], /) -> None:
    """Fill `reduced` (h // block, w // block)."""

def fit_surfaces(
    inverse_depth: NDArray[np.float32],
    asked: NDArray[np.int64],
    to_frame: NDArray[np.float32],
    fitted: NDArray[np.float32],
    slopes: NDArray[np.float32],
    normals: NDArray[np.float32],
    /,
) -> None:
    """Fill the asked-for pixels of fitted (h, w), slopes (h, w, 2) and normals (h, w, 3)."""

def edges(
    fitted: NDArray[np.float32],
    slopes: NDArray[np.float32],
    normals: NDArray[np.float32],
    positions: NDArray[np.float32],
    asked: NDArray[np.int64],
    edge: NDArray[np.float32],
    /,
) -> None:
    """Fill the asked-for pixels of edge (h, w)."""

def grow_patches(edge: NDArray[np.float32], fitted: NDArray[np.float32], labels: NDArray[np.int32], /) -> int:
    """Fill labels (h, w); return the number of patches."""

def merge_patches(edge: NDArray[np.float32], labels: NDArray[np.int32], count: int, /) -> int:
    """Change labels (h, w) from 0 … count; return the number of patches that are left."""

def measure_patches(
    inverse_depth: NDArray[np.float32],
    normals: NDArray[np.float32],
    positions: NDArray[np.float32],
    labels: NDArray[np.int32],
    edge: NDArray[np.float32],
    height: NDArray[np.float32],
    table: NDArray[np.bool_],
    pixel: float,
    sums: NDArray[np.float64],
    bins: NDArray[np.float64],
    sides: NDArray[np.float64],
    /,
) -> None:
    """Add to the rows of sums (n + 1, 37), bins (n + 1, 256) and sides (n + 1, 5) of labels 1 … n."""

def add_trees(
    feature: NDArray[np.int32],
    threshold: NDArray[np.float32],
    left: NDArray[np.int32],
    right: NDArray[np.int32],
    missing_left: NDArray[np.int32],
    value: NDArray[np.float64],
    start: NDArray[np.int32],
    features: NDArray[np.float32],
    odds: NDArray[np.float64],
    /,
) -> None:
    """Add all trees' values for each row of features (P, F) to odds (P,). A node's children must come after it."""

def cluster(
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    agreement: NDArray[np.float64],
    root: NDArray[np.int64],
    /,
) -> None:
    """Fill root (count,) with the lowest node of each one's cluster; pairs (P,) once each, first < second."""
