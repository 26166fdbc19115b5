"""Read a cloud from a file, whatever wrote it: .ply, .pcd, .npy, .npz, .xyz.

cloud = read_cloud("frame.pcd")    # (N, 3), or (H, W, 3) where the file keeps a camera's rows and columns
points = valid_points(cloud)       # (M, 3), without what the camera missed
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasping.cloud_files.arrays import read_npy, read_npz
from grasping.cloud_files.pcd import read_pcd
from grasping.cloud_files.ply import read_ply
from grasping.cloud_files.text import read_xyz
from grasping.errors import CloudError

__all__ = ["SUFFIXES", "read_cloud", "valid_points"]

_READERS: dict[str, Callable[[bytes], NDArray]] = {
    ".npy": read_npy,
    ".npz": read_npz,
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".xyz": read_xyz,
}
SUFFIXES = tuple(_READERS)


def read_cloud(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """Return the points of a file as float32, in its own units and frame: (N, 3), or organised (H, W, 3).

    In an organised cloud a point with a coordinate that is not finite is NaN throughout; a loose one leaves it out.

    .ply: the vertices; ASCII or binary of either byte order, any other properties and elements beside them.
    .pcd: x, y, z of version 0.7; ascii, binary or binary_compressed; HEIGHT above 1 is organised. VIEWPOINT is ignored.
    .npy: shape (N, 3) or (H, W, 3), or a structured array with fields x, y, z.
    .npz: the array "points", else "xyz", else "depth" (H, W) with intrinsics "K" (3, 3) → OpenCV's camera frame, depth
        of an integer type in millimetres and of a floating type in metres; else the one array of a cloud's shape.
    .xyz: three numbers a line and whatever follows them, apart by blanks, commas or semicolons; # and // are comments,
        and a first line of names or of the number of points is left out.

    Nothing is ever unpickled. Raises FileNotFoundError, or CloudError that names the file and what is wrong in it.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        found = path.suffix or "a file without suffix"
        raise CloudError(f"{path}: a cloud is read from {', '.join(SUFFIXES)}, not {found}")
    if not path.is_file():
        raise FileNotFoundError(f"cloud {path} does not exist")
    try:
        points = reader(path.read_bytes())
    except CloudError as error:
        raise CloudError(f"{path}: {error}") from error
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32: infinite, and so no point
        points = points.astype(np.float32)
    finite = np.isfinite(points).all(axis=-1)
    if points.ndim == 2:
        return points[finite]
    points[~finite] = np.nan
    return points


def valid_points(cloud: NDArray) -> NDArray:
    """Those points (M, 3) of a cloud (N, 3) or (H, W, 3) that were seen: finite, and not (0, 0, 0)."""
    points = cloud.reshape(-1, 3)
    return points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
