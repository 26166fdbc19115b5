"""Universal Robots' arms as data: lengths, limits and the kind of controller; conf/robot has a file for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from pecgrasp_env.robot import arm_lengths
from pecgrasp_env.robot.arm_lengths import ArmLengths

_SERIES = ("CB3", "e-Series")


@dataclass(frozen=True)
class URModel:
    """One type of arm.

    name: as the dashboard calls it. series: of its controller, "CB3" or "e-Series". dh: (6, 3) a, d [m] and alpha [rad]
    of each joint, standard Denavit-Hartenberg, from Universal Robots' public tables. limits: (6, 2) rad. max_speed:
    (6,) rad/s. max_payload: kg, gripper included. footprint: m, diameter of its base.
    """

    name: str
    series: str
    dh: np.ndarray
    limits: np.ndarray
    max_speed: np.ndarray
    max_payload: float
    footprint: float

    def __post_init__(self) -> None:
        if self.series not in _SERIES:
            raise ValueError(f"robot.series={self.series!r}: must be one of {', '.join(_SERIES)}")
        for name, shape in (("dh", (6, 3)), ("limits", (6, 2)), ("max_speed", (6,))):
            value = np.array(getattr(self, name), float)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"robot.{name}: must be {shape} finite numbers, got {value.tolist()}")
            object.__setattr__(self, name, value)
        _ = self.lengths  # an error about them comes now

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> URModel:
        """From its fields by name, as conf/robot/*.yaml have them. Raises ValueError that names a field."""
        names = {field.name for field in fields(cls)}
        if missing := names - mapping.keys():
            raise ValueError(f"robot.{sorted(missing)[0]} is missing")
        return cls(**{name: mapping[name] for name in names})

    @cached_property
    def lengths(self) -> ArmLengths:
        """With which it is planned and moved."""
        try:
            return ArmLengths(self.dh, self.limits, self.footprint)
        except ValueError as error:
            raise ValueError(f"robot.{error}") from error


UR5 = URModel(
    "UR5",
    "CB3",
    arm_lengths.DH,
    arm_lengths.JOINT_LIMITS,
    np.full(6, np.pi),
    max_payload=5.0,
    footprint=arm_lengths.UR5.footprint,
)
