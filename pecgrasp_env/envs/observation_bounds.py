"""Bounds of the observations: what each number can be, so that a learning agent may scale it.

ManiSkill derives its spaces from one observation and leaves all floats without bounds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from pecgrasp_env.envs.cloud_observation import CLOUD_HIGH, CLOUD_LOW
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.sensor.intrinsics import FAR, LARGEST_FOCAL_LENGTH

_ROOM = 100.0  # m: nothing that slides or rolls off gets further before the episode ends
_ROUNDING = 1.001  # of unit quaternions and rotation matrices
_ARM = 2 * np.pi + 0.1  # rad: the joints' limits, and how far a knock may push one past them
_POSE = np.array([_ROOM] * 3 + [_ROUNDING] * 4)
_QPOS = np.array([[-_ARM] * 6 + [-1.1] * 4, [_ARM] * 6 + [1.3] * 4])


def bounds(path: str, shape: tuple[int, ...], control_freq: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Least and greatest values of the observation at ``path`` ("extra/opening"), each of ``shape``; None: unknown."""
    name = path.rsplit("/", 1)[-1]
    if name == "qpos":
        low, high = _QPOS
    elif name == "qvel":  # differences of two positions
        high = (_QPOS[1] - _QPOS[0]) * control_freq
        low = -high
    elif path.endswith("pose") or path.endswith("poses"):
        high = np.tile(_POSE, shape[-1] // 7)
        low = -high
    elif name in _RANGES:
        low, high = (np.asarray(limit, float) for limit in _RANGES[name])
    elif path.startswith(("sensor_data/", "pointcloud/", "sensor_param/")):
        if name not in _OF_CAMERA:
            return None
        low, high = (np.asarray(limit, float) for limit in _OF_CAMERA[name])
    else:
        return None
    return np.broadcast_to(low, shape).astype(np.float32), np.broadcast_to(high, shape).astype(np.float32)


_RANGES: dict[str, tuple[Any, Any]] = {
    "target_opening": (-0.1, linkage.STROKE + 0.1),
    "force_limit": (0.0, linkage.MAX_FORCE),
    "target": (0.0, 1.0),
    "opening": (-0.02, linkage.STROKE + 0.02),
    "openings": (-0.02, linkage.STROKE + 0.02),
    "force": (0.0, linkage.FORCE_RANGE_N),
    "forces": (0.0, linkage.FORCE_RANGE_N),
    "goal": (-1.0, 1.0),
    "cloud": (np.minimum(CLOUD_LOW, 0.0), CLOUD_HIGH),
}
_OF_CAMERA: dict[str, tuple[Any, Any]] = {
    "depth": (0.0, FAR),
    "position": (-2000 * FAR, 2000 * FAR),  # mm
    "normal": (-_ROUNDING, _ROUNDING),
    "xyzw": (-_ROOM, _ROOM),
    "intrinsic_cv": (0.0, LARGEST_FOCAL_LENGTH),
    "extrinsic_cv": (-_ROOM, _ROOM),
    "cam2world_gl": (-_ROOM, _ROOM),
}


def bounded(space: spaces.Space, control_freq: float, path: str = "") -> spaces.Space:
    """The same space with the known bounds in it."""
    if isinstance(space, spaces.Dict):
        prefix = f"{path}/" if path else ""
        return spaces.Dict({key: bounded(sub, control_freq, prefix + key) for key, sub in space.spaces.items()})
    if not isinstance(space, spaces.Box) or space.dtype != np.float32:
        return space
    known = bounds(path, space.shape, control_freq)
    return space if known is None else spaces.Box(*known, dtype=np.float32)


def flat_bounds(obs: Mapping[str, Any], control_freq: float, path: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Bounds (D,) of a nested observation of one sub-environment, flattened in its own order; unknown ones infinite.

    obs: leaves (1, d).
    """
    lows, highs = [np.zeros(0, np.float32)], [np.zeros(0, np.float32)]
    for key, value in obs.items():
        name = f"{path}/{key}" if path else key
        if isinstance(value, Mapping):
            low, high = flat_bounds(value, control_freq, name)
        else:
            shape = tuple(value.shape[1:])
            free = np.full(shape, np.inf, np.float32)
            low, high = bounds(name, shape, control_freq) or (-free, free)
        lows.append(low.reshape(-1))
        highs.append(high.reshape(-1))
    return np.concatenate(lows), np.concatenate(highs)
