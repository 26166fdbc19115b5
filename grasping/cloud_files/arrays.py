"""NumPy's .npy and .npz. Headers are checked against the bytes that are there; nothing is unpickled."""

from __future__ import annotations

import io
import math
import tokenize
import warnings
import zipfile

import numpy as np
from numpy.typing import NDArray

from grasping.cloud_files.depth_frame import back_projected
from grasping.errors import DAMAGED_ZIP, CloudError

# What NumPy raises where it evaluates a damaged header as a Python literal.
_HEADER_ERRORS = (
    ValueError,
    TypeError,
    SyntaxError,
    KeyError,
    IndexError,
    RecursionError,
    MemoryError,
    tokenize.TokenError,
)


def read_npy(data: bytes) -> NDArray:
    """(N, 3) or (H, W, 3), also from a structured array with fields x, y, z. Raises CloudError."""
    return _cloud(_array(data), "the array")


def read_npz(data: bytes) -> NDArray:
    """See `grasping.cloud_files.read_cloud` for which of the arrays is the cloud. Raises CloudError."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]

            def load(name: str) -> NDArray:
                try:
                    return _array(archive.read(f"{name}.npy"))
                except CloudError as error:
                    raise CloudError(f"array {name!r}: {error}") from error

            for name in ("points", "xyz"):
                if name in names:
                    return _cloud(load(name), f"array {name!r}")
            if "depth" in names:
                if "K" not in names:
                    raise CloudError(
                        "array 'depth' needs the intrinsics (3, 3) as array 'K' beside it; there are "
                        + ", ".join(names)[:200]
                    )
                return back_projected(load("depth"), load("K"), load("depth_scale") if "depth_scale" in names else None)
            arrays = {name: load(name) for name in names}
    except CloudError:  # a ValueError, too
        raise
    except DAMAGED_ZIP as error:
        raise CloudError(f"not a readable .npz: {error}") from error
    clouds = [name for name, array in arrays.items() if _is_cloud(array)]
    if len(clouds) == 1:
        return _cloud(arrays[clouds[0]], f"array {clouds[0]!r}")
    if clouds:
        raise CloudError(f"the cloud may be any of {', '.join(clouds)[:200]}; name it 'points'")
    shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
    raise CloudError(f"no array of shape (N, 3) or (H, W, 3) among {shapes[:200] or 'no arrays'}")


def _array(data: bytes) -> NDArray:
    """What `np.load` gives, which would allocate all that a header promises before it finds the file too short."""
    file = io.BytesIO(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers by Python 2, and of odd literals in damaged ones
            if np.lib.format.read_magic(file) == (1, 0):
                shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
            else:  # version 3 differs in the encoding of fields' names only
                shape, fortran, dtype = np.lib.format.read_array_header_2_0(file)
    except _HEADER_ERRORS as error:
        raise CloudError(f"not a readable .npy: {str(error)[:200]}") from error
    if dtype.hasobject:
        raise CloudError("it holds Python objects, which are not unpickled: save an array of numbers, a cloud a file")
    if not dtype.itemsize:
        raise CloudError(f"an array of {dtype} holds no numbers")
    if min(shape, default=0) < 0:
        raise CloudError(f"not a readable .npy: its shape is {shape!r:.120}")
    needed, there = math.prod(shape) * dtype.itemsize, len(data) - file.tell()
    if needed > there:
        raise CloudError(f"an array of shape {shape} needs {needed} bytes, and {there} are there")
    array = np.frombuffer(data, dtype, count=math.prod(shape), offset=file.tell())
    try:
        return array.reshape(shape, order="F" if fortran else "C")
    except ValueError as error:  # of no points, but in more rows than can be counted
        raise CloudError(f"not a readable .npy: {error}") from error


def _is_cloud(array: NDArray) -> bool:
    if array.dtype.names:
        return {"x", "y", "z"} <= set(array.dtype.names) and array.ndim in (1, 2)
    return array.ndim in (2, 3) and array.shape[-1] == 3 and array.dtype.kind in "fiu"


def _cloud(array: NDArray, name: str) -> NDArray:
    if array.ndim in (2, 3) and array.shape[-1] == 6 and not array.dtype.names:  # colours or a normal behind
        array = array[..., :3]
    if not _is_cloud(array):
        raise CloudError(
            f"{name}: shape {array.shape} of {array.dtype}, expected numbers (N, 3) or (H, W, 3){_way_out(array)}"
        )
    if array.dtype.names:
        axes = [array[axis] for axis in "xyz"]
        if any(axis.dtype.kind not in "fiu" or axis.ndim != array.ndim for axis in axes):
            raise CloudError(f"{name}: fields x, y, z are not numbers")
        return np.stack([axis.astype(np.float64) for axis in axes], axis=-1)
    return array


def _way_out(array: NDArray) -> str:
    if array.dtype.kind not in "fiu" or not array.size:
        return ""
    if array.ndim in (2, 3) and 3 < array.shape[-1] < 10:
        return f"; of {array.shape[-1]} columns save the three of the points, [..., :3] where they come first"
    if array.ndim in (2, 3) and array.shape[0] == 3:
        return "; coordinates stand in columns: save its transpose"
    if array.ndim == 2 and min(array.shape) > 10:
        return '; a depth image is read from a .npz with arrays "depth" and "K"'
    return "; a file holds one cloud" if array.ndim > 3 else ""
