"""Universal Robots' arms as data: lengths, limits and the kind of controller; conf/robot has a file for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from pecgrasp_env.robot.kinematics import DH, JOINT_LIMITS

_SERIES = ("CB3", "e-Series")


@dataclass(frozen=True)
class URModel:
    """One type of arm.

    name: as the dashboard calls it. series: of its controller, "CB3" or "e-Series". dh: (6, 3) a, d [m] and alpha [rad]
    of each joint, standard Denavit-Hartenberg, from Universal Robots' public tables. limits: (6, 2) rad. max_speed:
    (6,) rad/s. max_payload: kg, gripper included.
    """

    name: str
    series: str
    dh: np.ndarray
    limits: np.ndarray
    max_speed: np.ndarray
    max_payload: float

    def __post_init__(self) -> None:
        if self.series not in _SERIES:
            raise ValueError(f"robot.series={self.series!r}: must be one of {', '.join(_SERIES)}")
        for name, shape in (("dh", (6, 3)), ("limits", (6, 2)), ("max_speed", (6,))):
            value = np.array(getattr(self, name), float)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"robot.{name}: must be {shape} finite numbers, got {value.tolist()}")
            object.__setattr__(self, name, value)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> URModel:
        """From its fields by name, as conf/robot/*.yaml have them. Raises ValueError that names a field."""
        names = {field.name for field in fields(cls)}
        if missing := names - mapping.keys():
            raise ValueError(f"robot.{sorted(missing)[0]} is missing")
        return cls(**{name: mapping[name] for name in names})

    @property
    def plans(self) -> bool:
        """Whether this project's inverse kinematics and collision check are for this arm's lengths."""
        return np.allclose(self.dh, DH, atol=1e-9)

    def forward_kinematics(self, q: np.ndarray) -> np.ndarray:
        """T_base_tool0 (4, 4) at joint angles (6,), rad; the base frame is that of `robot.kinematics`."""
        T = np.diag([-1.0, -1.0, 1.0, 1.0])
        for angle, (a, d, alpha) in zip(np.asarray(q, float), self.dh, strict=True):
            c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
            T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1.0]])
        return T


UR5 = URModel("UR5", "CB3", DH, JOINT_LIMITS, np.full(6, np.pi), 5.0)
