"""Where the camera is mounted: a file that calibration writes and that takes the place of the bracket's drawing.

parent: tool0                # or base: a camera that stands beside the robot
T_tool0_camera:              # maps points of the camera's frame (x right, y down, z forward) into tool0's, metres
  - [r11, r12, r13, x]
  …
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA, forward_kinematics

PARENTS = ("tool0", "base")
_FARTHEST_M = {"tool0": 0.5, "base": 5.0}


class MountError(ValueError):
    """A file from which no camera's place can be read; the message names it and the way out."""


@dataclass(frozen=True)
class CameraMount:
    """parent: "tool0", the hand carries the camera, or "base", it stands beside the robot. T: (4, 4), maps points of
    the camera's frame into the parent's, m.
    """

    parent: str
    T: np.ndarray

    def T_base_camera(self, q: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
        """(4, 4) with the arm at joint angles (6,), rad."""
        return self.T if self.parent == "base" else forward_kinematics(q, arm) @ self.T


BRACKET = CameraMount("tool0", T_TOOL0_CAMERA)


def read_any_mount(path: str | Path) -> CameraMount:
    """Of a file that says itself what carries the camera. Raises MountError."""
    parent = _stored(path).get("parent", "tool0")
    if parent not in PARENTS:
        raise MountError(f"{path}: parent: {parent}: one of {', '.join(PARENTS)}")
    return CameraMount(parent, read_mount(path, parent))


def mount_of(setting: str | Path | Sequence[Sequence[float]] | None) -> np.ndarray:
    """T_tool0_camera (4, 4) of a setting: a file, the matrix itself, or None, the drawing's. Raises MountError."""
    if setting is None:
        return T_TOOL0_CAMERA
    if isinstance(setting, (str, Path)):
        return read_mount(setting)
    return _checked("T_tool0_camera", setting, "tool0")


def read_mount(path: str | Path, parent: str = "tool0") -> np.ndarray:
    """T_tool0_camera (4, 4), or T_base_camera with ``parent="base"``. Raises MountError."""
    key, stored = f"T_{parent}_camera", _stored(path)
    if key not in stored:
        raise MountError(f"{path}: holds {', '.join(map(str, stored))}, and no {key}: `pecgrasp calibrate` writes it")
    return _checked(f"{path}: {key}", stored[key], parent)


def _stored(path: str | Path) -> Mapping[str, Any]:
    import yaml

    try:
        stored = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise MountError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    if not isinstance(stored, Mapping):
        what = f"{type(stored).__name__}, and no T_tool0_camera"
        raise MountError(f"{path}: holds {what}: `pecgrasp calibrate` writes it")
    return stored


def _checked(name: str, value: Any, parent: str) -> np.ndarray:
    try:
        T = np.asarray(value, float)
    except (TypeError, ValueError) as error:
        raise MountError(f"{name}: {error}: four rows of four numbers") from error
    if T.shape != (4, 4) or not np.isfinite(T).all() or np.abs(T[3] - (0, 0, 0, 1)).max() > 1e-6:
        raise MountError(f"{name} of shape {T.shape} is no transform: four rows of four numbers, the last 0 0 0 1")
    R = T[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-4 or np.linalg.det(R) < 0:
        raise MountError(f"{name}: its turn is no rotation")
    if np.linalg.norm(T[:3, 3]) > _FARTHEST_M[parent]:
        raise MountError(f"{name} puts the camera {np.linalg.norm(T[:3, 3]):.3g} m away: metres are wanted")
    return T


def write_mount(path: Path, parent: str, T: np.ndarray, about: Mapping[str, Any]) -> None:
    """What `read_mount` reads; about: plain values, such as how it was found."""
    if parent not in PARENTS:
        raise MountError(f"parent={parent!r}: one of {', '.join(PARENTS)}")
    lines = [f"parent: {parent}", f"T_{parent}_camera:"]
    lines += ["  - [" + ", ".join(f"{value + 0.0:.9f}" for value in row) + "]" for row in T]
    lines += [f"{name}: {value}" for name, value in about.items()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
