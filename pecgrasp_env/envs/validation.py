"""The arguments of the task in groups, checked when they are built; one that makes no sense is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np

from pecgrasp_env.objects import LARS_CLASSES
from pecgrasp_env.scene.clutter import CLUTTERS
from pecgrasp_env.scene.draw_objects import MOST_OBJECTS
from pecgrasp_env.sensor import SENSOR_MODES, CameraIntrinsics, intrinsics_of

LIGHTS = ("fixed", "random")

_Options = TypeVar("_Options")


class TaskError(ValueError):
    """An argument of the environment makes no sense; the message names it."""


@dataclass(frozen=True)
class SceneOptions:
    """What lies on the table and how, and where the arm starts; the card of `SelectiveGraspEnv` has the meanings.

    Raises TaskError.
    """

    n_objects: int = 3
    classes: Sequence[str] = LARS_CLASSES
    objects: Any = None
    clutter: str = "apart"
    same_class_twins: bool = False
    clearance: float = 0.03
    joint_noise: float = 0.02

    def __post_init__(self) -> None:
        classes = tuple(self.classes)
        if len(set(classes)) != len(classes) or not classes:
            raise TaskError(f"classes={classes}: must name at least one class, each once")
        fewest = 2 if self.same_class_twins else 1
        if not fewest <= self.n_objects <= MOST_OBJECTS:
            raise TaskError(f"n_objects={self.n_objects}: must be between {fewest} and {MOST_OBJECTS}")
        if len(classes) == 1 and self.n_objects > fewest:
            raise TaskError(f"n_objects={self.n_objects}: others than the asked-for one need another class in classes")
        if self.clutter not in CLUTTERS:
            raise TaskError(f"clutter={self.clutter!r}: must be one of {CLUTTERS}")
        for name, value in (("clearance", self.clearance), ("joint_noise", self.joint_noise)):
            if not 0 <= value < float("inf"):
                raise TaskError(f"{name}={value}: must be a number and not negative")


@dataclass(frozen=True)
class SensingOptions:
    """What the wrist camera measures. Raises TaskError, and SensorError for an unknown resolution."""

    sensor: str = "ideal"
    resolution: str = "424x240"
    cloud_points: int = 1024

    def __post_init__(self) -> None:
        if self.sensor not in SENSOR_MODES:
            raise TaskError(f"sensor={self.sensor!r}: must be one of {SENSOR_MODES}")
        if self.cloud_points < 1:
            raise TaskError(f"cloud_points={self.cloud_points}: must be at least 1")
        if self.cloud_points > self.intrinsics.width * self.intrinsics.height:
            raise TaskError(f"cloud_points={self.cloud_points}: a picture of {self.resolution} has fewer pixels")

    @property
    def intrinsics(self) -> CameraIntrinsics:
        return intrinsics_of(self.resolution)


@dataclass(frozen=True)
class Randomisation:
    """What is drawn besides the scene: limits (2,) of uniform draws, None for the usual value. Raises TaskError."""

    friction: tuple[float, float] | None = None
    mass_scale: tuple[float, float] | None = None
    light: str = "fixed"

    def __post_init__(self) -> None:
        if self.light not in LIGHTS:
            raise TaskError(f"light={self.light!r}: must be one of {LIGHTS}")
        for name, limits in (("friction", self.friction), ("mass_scale", self.mass_scale)):
            if limits is not None and not (np.shape(limits) == (2,) and 0 < limits[0] <= limits[1] < float("inf")):
                raise TaskError(f"{name}={limits}: must be None or two numbers 0 < least <= greatest")


def take_options(arguments: dict[str, Any]) -> tuple[SceneOptions, SensingOptions, Randomisation]:
    """The task's own options out of keyword arguments by name; those left in ``arguments`` are ManiSkill's.

    Raises:
        TaskError: one makes no sense. SensorError: the camera has no such resolution.
    """

    def take(options: type[_Options]) -> _Options:
        names = [each.name for each in fields(options) if each.name in arguments]  # type: ignore[arg-type]
        return options(**{name: arguments.pop(name) for name in names})

    return take(SceneOptions), take(SensingOptions), take(Randomisation)
