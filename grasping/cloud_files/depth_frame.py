"""A depth image and its intrinsics as an organised cloud; intrinsics that cannot be those of the image are refused."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.errors import CloudError

# Of width or height: no depth camera is as wide or as narrow, and none has its centre as far from the middle.
_FOCAL = (0.2, 8.0)
_OFF_CENTRE = 0.1
_MOST_SCALE = 0.011  # m a unit; centimetres are the coarsest


def back_projected(depth: NDArray, intrinsics: NDArray, scale: NDArray | None) -> NDArray[np.float64]:
    """The organised cloud (H, W, 3) of a depth image (H, W), NaN where the depth is 0 or less.

    intrinsics: K (3, 3), in pixels. scale: metres a unit of depth; None: 0.001 for integers, 1 for floating types.
    Raises CloudError for arrays of other shapes, and for intrinsics that are not plausible for the image.
    """
    if depth.ndim == 3 and 1 in (depth.shape[0], depth.shape[2]):
        depth = depth.squeeze(axis=2 if depth.shape[2] == 1 else 0)
    if depth.ndim != 2 or depth.dtype.kind not in "fiu":
        more = ": save one frame, not several" if depth.ndim == 3 else ""
        raise CloudError(f"array 'depth': shape {depth.shape} of {depth.dtype}, expected numbers (H, W){more}")
    k = checked_intrinsics(intrinsics, depth.shape)
    with np.errstate(over="ignore", invalid="ignore"):
        z = depth.astype(np.float64) * _metres(depth, scale)
        z[~(z > 0)] = np.nan
        v, u = np.indices(depth.shape)
        return np.stack([(u - k[0, 2]) * z / k[0, 0], (v - k[1, 2]) * z / k[1, 1], z], axis=-1)


def _metres(depth: NDArray, scale: NDArray | None) -> float:
    """A unit of depth."""
    if scale is None:
        if depth.dtype.itemsize == 1:
            raise CloudError(
                f"array 'depth': {depth.dtype} has too few steps for millimetres: save these as uint16, metres as "
                "float32, or say the metres in a unit as 'depth_scale'"
            )
        return 1.0 if depth.dtype.kind == "f" else 1e-3
    value = float(scale.reshape(-1)[0]) if scale.size == 1 and scale.dtype.kind in "fiu" else float("nan")
    if not (0 < value <= _MOST_SCALE or (value == 1 and depth.dtype.kind == "f")):
        shown = f"{value:g}" if value == value else f"shape {scale.shape} of {scale.dtype}"
        raise CloudError(
            f"array 'depth_scale': {shown} is not the metres in a unit of {depth.dtype} depth: 0.001 for millimetres, "
            "0.0001 for their tenths"
        )
    return value


def checked_intrinsics(intrinsics: NDArray, shape: tuple[int, ...], name: str = "array 'K'") -> NDArray[np.float64]:
    """K (3, 3) float64. Raises CloudError, with the value and the way out, where it cannot be that of the image."""
    if intrinsics.shape != (3, 3) or intrinsics.dtype.kind not in "fiu":
        ways = {(3, 4): ": save K[:, :3]", (9,): ": save K.reshape(3, 3)", (1, 3, 3): ": save K[0]"}
        way = ways.get(intrinsics.shape, ": save [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        raise CloudError(f"{name}: shape {intrinsics.shape} of {intrinsics.dtype}, expected numbers (3, 3){way}")
    k = intrinsics.astype(np.float64)
    if not np.isfinite(k).all():
        raise CloudError(f"{name}: {_shown(k)} is not finite")
    if not (k[2] == (0, 0, 1)).all():
        transposed = (k[:, 2] == (0, 0, 1)).all()
        way = "it is transposed: save K.T" if transposed else "its last row must be 0 0 1"
        raise CloudError(f"{name}: {_shown(k)}: {way}")
    height, width = shape
    fx, fy, cx, cy = k[0, 0], k[1, 1], k[0, 2], k[1, 2]
    if not (fx > 0 and fy > 0):
        raise CloudError(f"{name}: focal lengths {fx:g} and {fy:g} must be positive")
    if abs(k[0, 1]) * height > fy or k[1, 0] != 0:
        raise CloudError(
            f"{name}: {_shown(k)}: the terms beside the focal lengths must be 0; undistort the image first"
        )
    side = max(width, height)
    if not (_FOCAL[0] * side <= min(fx, fy) and max(fx, fy) <= _FOCAL[1] * side and 0.5 <= fx / fy <= 2):
        raise CloudError(
            f"{name}: focal lengths {fx:g} and {fy:g} are not plausible for an image of {width} × {height}: they "
            "must be in pixels of this image"
        )
    # From the first pixel's middle or its corner, as calibrations differ.
    off_x, off_y = abs(cx - (width - 1) / 2), abs(cy - (height - 1) / 2)
    if off_x > max(_OFF_CENTRE * width, 1) or off_y > max(_OFF_CENTRE * height, 1):
        size = f"{2 * cx:.0f} × {2 * cy:.0f}"
        raise CloudError(
            f"{name}: the centre {cx:g}, {cy:g} is far from the middle of an image of {width} × {height}. Is it of "
            f"one of {size}? Scale K with the image; fill up a part cut out of an image with depth 0"
        )
    return k


def _shown(k: NDArray) -> str:
    return "[" + ", ".join("[" + ", ".join(f"{value:g}" for value in row) + "]" for row in k) + "]"
