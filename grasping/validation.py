"""The boundary of the package: what may come in as a cloud, a direction or a plane."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import CloudError, ConfigError

# An object for one hand is never this large: such a cloud is in millimetres, or is a whole scene.
LARGEST_OBJECT = 2.0
# Beyond this a float32 coordinate is coarser than a millimetre.
FARTHEST = 1.0e4


def object_cloud(points: ArrayLike, *, at_least: int = 10, name: str = "points") -> NDArray[np.float64]:
    """Return the cloud of one object as (N, 3) float64, m. Raises CloudError where it is no such thing."""
    cloud = as_cloud(points, name=name)
    _require_object(np.ascontiguousarray(cloud.T), at_least, name)  # extremes over long rows are fast
    return cloud


def object_rows(points: ArrayLike, *, at_least: int = 10, name: str = "points") -> NDArray[np.float64]:
    """As `object_cloud`, but as rows (3, N), which may be the points' own."""
    rows = np.ascontiguousarray(_as_numbers(points, name).T)
    _require_finite(rows.T, name)
    _require_object(rows, at_least, name)
    return rows


def _require_object(rows: NDArray[np.float64], at_least: int, name: str) -> None:
    if rows.shape[1] < at_least:
        raise CloudError(f"{name}: {rows.shape[1]} points, at least {at_least} are needed")
    span = max(map(float.__sub__, rows.max(axis=1).tolist(), rows.min(axis=1).tolist()))
    if span > LARGEST_OBJECT:
        raise CloudError(f"{name}: spans {span:.6g} m, more than {LARGEST_OBJECT} m; are these millimetres or a scene?")


def as_cloud(points: ArrayLike, *, name: str) -> NDArray[np.float64]:
    """Return (N, 3) float64, N may be 0. Raises CloudError for another shape, text, NaN, infinity or huge values."""
    cloud = np.array(_as_numbers(points, name))
    _require_finite(cloud, name)
    return cloud


def _as_numbers(points: ArrayLike, name: str) -> NDArray[np.float64]:
    """(N, 3) float64, which may be the array that came in."""
    try:
        cloud = np.asarray(points)
        if cloud.dtype.kind == "c":
            raise TypeError("complex numbers")
        cloud = np.asarray(cloud, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CloudError(f"{name}: not an array of numbers ({error})") from error
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise CloudError(f"{name}: shape {cloud.shape}, expected (N, 3)")
    return cloud


def _require_finite(cloud: NDArray[np.float64], name: str) -> None:
    if cloud.size and not (cloud.max() <= FARTHEST and cloud.min() >= -FARTHEST):  # NaN is neither
        bad = np.flatnonzero(~(np.abs(cloud).max(axis=1) <= FARTHEST))
        raise CloudError(
            f"{name}: {len(bad)} of {len(cloud)} points not finite or beyond {FARTHEST:g} m, first {bad[0]}"
        )


def unit_vector(vector: ArrayLike, *, name: str) -> NDArray[np.float64]:
    """Return a (3,) vector scaled to length one. Raises ConfigError where it has no direction."""
    try:
        value = np.asarray(vector, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{name} = {vector!r} is not a vector of three numbers") from error
    length = math.hypot(*value.tolist()) if value.shape == (3,) else 0.0
    if not (math.isfinite(length) and length > 1e-9):
        raise ConfigError(f"{name} = {vector!r} is not a direction (3,)")
    return value / length


def position(point: ArrayLike, *, name: str) -> NDArray[np.float64]:
    """Return a place (3,), m. Raises ConfigError where it is none."""
    try:
        value = np.asarray(point, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{name} = {point!r} is not a position of three numbers") from error
    if value.shape != (3,) or not np.abs(value).max() <= FARTHEST:
        raise ConfigError(f"{name} = {point!r} is not a position (3,) in metres")
    return value


def plane_equation(plane: ArrayLike, *, name: str = "table") -> NDArray[np.float64]:
    """Return a plane (4,), n·p + d = 0, with n of length one. Raises ConfigError where it is none."""
    try:
        value = np.asarray(plane, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{name} = {plane!r} is not a plane (4,)") from error
    length = math.hypot(*value[:3].tolist()) if value.shape == (4,) else 0.0
    if not (length > 1e-9 and math.isfinite(length) and math.isfinite(value[3])):
        raise ConfigError(f"{name} = {plane!r} is not a plane (4,), n·p + d = 0")
    return value / length


def require_near(rows: NDArray[np.float64], table: NDArray[np.float64]) -> None:
    """Raises ConfigError where an object (3, N) is too far from a plane (4,) for that to be its table."""
    height = table[:3] @ rows
    low, high = float(height.min() + table[3]), float(height.max() + table[3])
    if low > LARGEST_OBJECT or high < -LARGEST_OBJECT:
        raise ConfigError(
            f"table = {table.tolist()}: the object is {low:.4g} m to {high:.4g} m above it; another frame or unit?"
        )


def workspace(
    up: ArrayLike | None, table: ArrayLike | None, obstacles: ArrayLike | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None, NDArray[np.float64]]:
    """Check what a planner is told of the scene: (up (3,) | None, table (4,) | None, obstacles (K, 3)).

    A table alone also says where up is. Raises ConfigError where the two contradict each other by more than 45°.
    """
    neighbours = np.empty((0, 3)) if obstacles is None else as_cloud(obstacles, name="obstacles")
    plane = None if table is None else plane_equation(table)
    if up is None:
        return (None if plane is None else plane[:3]), plane, neighbours
    direction = unit_vector(up, name="up")
    if plane is None:
        return direction, None, neighbours
    cosine = float(direction @ plane[:3])
    if abs(cosine) < math.sqrt(0.5):
        raise ConfigError(f"up = {up!r} is more than 45° off the normal of table = {table!r}")
    plane = plane * math.copysign(1.0, cosine)
    return plane[:3], plane, neighbours


def sight(
    viewpoint: ArrayLike | None, unseen: ArrayLike | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64]]:
    """Check what a planner is told of the cameras: (viewpoints (V, 3) | None, far ends of unmeasured lines (U, 3))."""
    rays = np.empty((0, 3)) if unseen is None else as_cloud(unseen, name="unseen")
    if viewpoint is None:
        return None, rays
    try:
        places = np.asarray(viewpoint, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"viewpoint = {viewpoint!r} is not a place (3,) or places (V, 3)") from error
    if places.ndim not in (1, 2) or places.shape[-1] != 3 or not places.size:
        raise ConfigError(f"viewpoint = {viewpoint!r} is not a place (3,) or places (V, 3)")
    if not np.abs(places).max() <= FARTHEST:
        raise ConfigError(f"viewpoint = {viewpoint!r} is not finite, or beyond {FARTHEST:g} m")
    return places.reshape(-1, 3), rays
