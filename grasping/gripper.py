"""A two-finger gripper as data, shared by the planner, the environment and the viewer.

Grasp frame: origin midway between the pads at the pads' centre, +z the approach direction, +x the closing direction,
+y along the fingers' hinge axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields

from grasping.errors import ConfigError


@dataclass(frozen=True)
class Gripper:
    """Dimensions of a parallel two-finger gripper, in metres and newtons.

    The pads of a gripper with parallelogram fingers travel along the approach axis while they close. With cranks of
    length `crank_length` whose angle θ from the approach axis obeys sin θ = (opening + crank_gap) / (2 crank_length),
    the pads' centre is `depth_offset + crank_length · cos θ` in front of the mounting flange. A gripper with prismatic
    jaws has `crank_length = 0`: its pads stay at `depth_offset`. `palm_width` and `palm_breadth` are only drawn.

    Raises ConfigError where a value is not finite, not positive where it must be, longer than a metre, or where the
    cranks are too short for the stroke.
    """

    name: str
    stroke: float  # greatest opening between the pads
    finger_width: float  # of a pad, along y
    pad_length: float  # of a pad, along the approach
    finger_thickness: float  # of a finger outwards from its pad's face, along x
    max_force: float
    min_force: float
    palm_depth: float  # from the flange to the palm's face, along the approach
    depth_offset: float  # see above
    crank_length: float = 0.0
    crank_gap: float = 0.0  # negative where the cranks stand apart more than the pads do
    palm_width: float = 0.0  # of the palm, along x; 0: unknown, and drawn in proportion to the stroke
    palm_breadth: float = 0.0  # along y; 0: unknown

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "name":
                continue
            if not math.isfinite(value):
                raise ConfigError(f"gripper.{field.name} = {value!r} must be a finite number")
            may_be_zero = field.name.startswith(("crank_", "palm_")) or field.name == "min_force"
            if (value < 0 and field.name != "crank_gap") or (value == 0 and not may_be_zero):
                raise ConfigError(f"gripper.{field.name} = {value!r} must be positive")
            if abs(value) > 1.0 and not field.name.endswith("_force"):
                raise ConfigError(f"gripper.{field.name} = {value!r} is more than a metre; lengths are in metres")
        if self.min_force > self.max_force:
            raise ConfigError(f"gripper.min_force = {self.min_force!r} exceeds max_force = {self.max_force!r}")
        if self.crank_length and max(self.stroke + self.crank_gap, -self.crank_gap) > 2 * self.crank_length:
            raise ConfigError(
                f"gripper.crank_length = {self.crank_length!r} is too short for a stroke of {self.stroke!r}"
            )
        if self.pad_depth(self.stroke) <= self.palm_depth:
            raise ConfigError(f"gripper.palm_depth = {self.palm_depth!r} lies beyond the pads")

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, object]) -> Gripper:
        """A gripper from its fields by name, as a YAML file holds them: conf/gripper has examples.

        Raises ConfigError that names the field and its value: unknown, missing, of the wrong type, or without sense.
        """
        if not isinstance(mapping, Mapping):
            raise ConfigError(f"gripper = {mapping!r:.80} is not a mapping of fields to values")
        known = {field.name: field for field in fields(cls)}
        for key in mapping:
            if key not in known:
                raise ConfigError(f"gripper.{key} is not a field of a gripper; there are {', '.join(known)}")
        values: dict[str, str | float] = {}
        for name, field in known.items():
            if name not in mapping:
                if field.default is MISSING:
                    raise ConfigError(f"gripper.{name} is missing")
                continue
            value = mapping[name]
            if name == "name":
                if not (isinstance(value, str) and value.strip()):
                    raise ConfigError(f"gripper.name = {value!r} must be a name")
                values[name] = value
            elif isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ConfigError(f"gripper.{name} = {value!r} must be a number")
            else:
                values[name] = float(value)
        return cls(**values)  # type: ignore[arg-type]  # the loop has checked them by name

    def pad_depth(self, opening: float) -> float:
        """Distance (m) from the mounting flange along the approach to the pads' centre at this opening (m).

        The opening is clipped to [0, stroke], so that a measured value slightly outside does no harm.
        """
        if not self.crank_length:
            return self.depth_offset
        sine = (min(max(opening, 0.0), self.stroke) + self.crank_gap) / (2 * self.crank_length)
        return self.depth_offset + self.crank_length * math.sqrt(1.0 - sine * sine)


# Makers' data sheet and public linkage; the closed form of the linkage (cranks of 100 mm) is our arithmetic.
# finger_thickness: pad, inner finger and the link behind it at the tips' height.
ROBOTIQ_2F_140 = Gripper(
    name="robotiq_2f_140",
    stroke=0.140,
    finger_width=0.027,
    pad_length=0.065,
    finger_thickness=0.018,
    max_force=125.0,
    min_force=10.0,
    palm_depth=0.0665,
    depth_offset=0.10066,
    crank_length=0.100,
    crank_gap=0.00074,
    palm_width=0.075,
    palm_breadth=0.075,
)
