"""Where a camera on a stand may look at a table from: near or far, from high up or from low down."""

from __future__ import annotations

import numpy as np

__all__ = ["FROM_A_STAND", "FROM_A_WRIST", "draw_view"]

_FARTHEST_M = 1.4
FROM_A_STAND, FROM_A_WRIST = (25.0, 80.0), (60.0, 89.9)  # degrees above the table
_ROLL = np.radians(4.0)


def draw_view(
    target: np.ndarray,
    azimuths: tuple[float, float],
    nearest: float,
    rng: np.random.Generator,
    elevations: tuple[float, float] = FROM_A_STAND,
) -> np.ndarray:
    """T_world_camera (4, 4), OpenCV's axes, of a camera that looks at about the target (3,), m.

    ``nearest`` to 1.4 m from it, nearly level. azimuths: between which it stands, rad. elevations: between which it
    looks down, degrees, less than 90.
    """
    distance = nearest + (_FARTHEST_M - nearest) * rng.uniform() ** 2  # more often near than far
    sines = np.sin(np.radians(elevations))
    elevation = np.arcsin(rng.uniform(*sines))  # as even over the half sphere as the limits allow
    azimuth = rng.uniform(*azimuths)
    away = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    eye = target + distance * away
    forward = target + rng.normal(0, 0.06, 3) * distance - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    roll = rng.normal(0, _ROLL)
    T = np.eye(4)
    T[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    T[:3, 1] = -np.sin(roll) * right + np.cos(roll) * down
    T[:3, 2] = forward
    T[:3, 3] = eye
    return T
