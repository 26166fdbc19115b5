"""Arguments of the environment that make sense; the others are named."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.scene.clutter import CLUTTERS
from pecgrasp_env.scene.draw_objects import MOST_OBJECTS
from pecgrasp_env.sensor import SENSOR_MODES

LIGHTS = ("fixed", "random")


class TaskError(ValueError):
    """An argument of the environment makes no sense; the message names it."""


def check_scene(
    classes: tuple[str, ...], n_objects: int, twins: bool, clutter: str, clearance: float, joint_noise: float
) -> None:
    """What lies on the table and how. Raises TaskError."""
    if len(set(classes)) != len(classes) or not classes:
        raise TaskError(f"classes={classes}: must name at least one class, each once")
    fewest = 2 if twins else 1
    if not fewest <= n_objects <= MOST_OBJECTS:
        raise TaskError(f"n_objects={n_objects}: must be between {fewest} and {MOST_OBJECTS}")
    if len(classes) == 1 and n_objects > fewest:
        raise TaskError(f"n_objects={n_objects}: others than the asked-for one need another class in classes")
    if clutter not in CLUTTERS:
        raise TaskError(f"clutter={clutter!r}: must be one of {CLUTTERS}")
    for name, value in (("clearance", clearance), ("joint_noise", joint_noise)):
        if not 0 <= value < float("inf"):
            raise TaskError(f"{name}={value}: must be a number and not negative")


def check_sensing(
    sensor: str,
    light: str,
    cloud_points: int,
    friction: tuple[float, float] | None,
    mass_scale: tuple[float, float] | None,
) -> None:
    """What the camera sees and what things weigh and how they slide. Raises TaskError."""
    if sensor not in SENSOR_MODES:
        raise TaskError(f"sensor={sensor!r}: must be one of {SENSOR_MODES}")
    if light not in LIGHTS:
        raise TaskError(f"light={light!r}: must be one of {LIGHTS}")
    if cloud_points < 1:
        raise TaskError(f"cloud_points={cloud_points}: must be at least 1")
    for name, limits in (("friction", friction), ("mass_scale", mass_scale)):
        if limits is not None and not (np.shape(limits) == (2,) and 0 < limits[0] <= limits[1] < float("inf")):
            raise TaskError(f"{name}={limits}: must be None or two numbers 0 < least <= greatest")
