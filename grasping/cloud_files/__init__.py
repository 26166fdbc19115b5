"""Read a cloud from a file, whatever wrote it: .ply, .pcd, .npy, .npz, or columns of text.

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
from grasping.cloud_files.columns import read_columns
from grasping.cloud_files.pcd import read_pcd
from grasping.cloud_files.ply import read_ply
from grasping.errors import CloudError

__all__ = ["SUFFIXES", "read_cloud", "read_object", "valid_points"]

_READERS: dict[str, Callable[[bytes], NDArray]] = {
    ".npy": read_npy,
    ".npz": read_npz,
    ".pcd": read_pcd,
    ".ply": read_ply,
    **dict.fromkeys((".xyz", ".csv", ".asc", ".pts"), read_columns),
}
SUFFIXES = tuple(_READERS)
_READERS[".txt"] = read_columns  # by its name only: in a folder of clouds it may be notes


def read_cloud(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """Return the points of a file as float32, in its own units and frame: (N, 3), or organised (H, W, 3).

    In an organised cloud a point with a coordinate that is not finite is NaN throughout; a loose one leaves it out.
    One row or one column is loose, in every format.

    .ply: the vertices; ASCII or binary of either byte order, any other properties and elements beside them.
    .pcd: x, y, z of version 0.7; ascii, binary or binary_compressed; HEIGHT above 1 is organised. VIEWPOINT is ignored.
        In ASCII files of both kinds numbers are counted, not lines, and as many must be there as the header promises.
    .npy: shape (N, 3) or (H, W, 3), also with three colours or a normal behind: (N, 6), (H, W, 6); or a structured
        array with fields x, y, z.
    .npz: the array "points", else "xyz", else "depth" (H, W) with the matrix "K" (3, 3) of that image → OpenCV's camera
        frame, depth of an integer type in millimetres and of a floating type in metres unless "depth_scale" says how
        many metres a unit is; else the one array of shape (N, 3) or (H, W, 3).
    .xyz, .csv, .txt, .asc, .pts: a point a line, its numbers apart by blanks, commas or semicolons, with decimal
        points. The columns that a first line or comment names x, y and z, else the first three; all lines have as many.
        Lines and ends of lines behind #, // or % are comments; a first line may have the number of points.

    Nothing is ever unpickled. Raises FileNotFoundError, or CloudError that names the file and what is wrong in it.
    """
    points = _as_stored(Path(path))
    finite = np.isfinite(points).all(axis=-1)
    if points.ndim == 2:
        return points[finite]
    points[~finite] = np.nan
    return points


def _as_stored(path: Path) -> NDArray[np.float32]:
    """(N, 3) or (H, W, 3), also what is not finite."""
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        found = path.suffix or "a file without suffix"
        raise CloudError(f"{path}: a cloud is read from {', '.join(_READERS)}, not {found}")
    if not path.is_file():
        raise FileNotFoundError(f"cloud {path} does not exist")
    try:
        points = reader(path.read_bytes())
    except CloudError as error:
        raise CloudError(f"{path}: {error}") from error
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32: infinite, and so no point
        points = points.astype(np.float32)
    return points.reshape(-1, 3) if points.ndim == 3 and 1 in points.shape[:2] else points


def read_object(path: str | os.PathLike[str]) -> tuple[NDArray[np.float32], int]:
    """The valid points (M, 3) of a file with one object, and how many others it holds, which are left out.

    Raises as `read_cloud`, and CloudError for a stack of clouds, which is no image: all of its points are valid.
    """
    stored = _as_stored(Path(path))
    points = valid_points(stored)
    others = stored.size // 3 - len(points)
    if stored.ndim == 3 and not others:
        raise CloudError(
            f"{path}: {stored.shape[0]} × {stored.shape[1]} valid points: several clouds, or a whole frame? A file "
            "holds one object, (N, 3), or an image of it that is NaN around it"
        )
    return points, others


def valid_points(cloud: NDArray) -> NDArray:
    """Those points (M, 3) of a cloud (N, 3) or (H, W, 3) that were seen: finite, and not (0, 0, 0)."""
    points = cloud.reshape(-1, 3)
    return points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
