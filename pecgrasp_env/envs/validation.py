"""The arguments of the task in groups, checked when they are built; one that makes no sense is named."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from inspect import signature
from typing import Any, TypeVar

import numpy as np

from pecgrasp_env.objects import LARS_CLASSES, open_objects
from pecgrasp_env.objects.open_strangers import open_strangers
from pecgrasp_env.objects.strangers import UNKNOWN, Strangers
from pecgrasp_env.scene.clutter import CLUTTERS, MOST_OBJECTS
from pecgrasp_env.sensor import SENSOR_MODES, CameraIntrinsics, intrinsics_of

LIGHTS = ("fixed", "random")
TEXTURES = ("rgb", "depth", "segmentation", "position", "normal", "albedo")
_WHOLE_MODES = ("state", "state_dict", "none", "sensor_data", "rgbd", "pointcloud", "cloud")
_JOINED = ("state", "state_dict", "none", "pointcloud")  # what ManiSkill takes beside textures
OBS_MODES = (
    f"{', '.join(_WHOLE_MODES)}, or one or more of {', '.join(TEXTURES)} joined by +, "
    "to which state or state_dict may be added"
)
VECTORISED = (
    'gymnasium.make_vec("SelectiveGraspSingle-v1", num_envs={n}, vectorization_mode="async", '
    'vector_kwargs={{"context": "spawn"}})'
)
_SIM_BACKENDS = ("auto", "physx_cpu", "cpu", "physx_cuda", "cuda", "gpu")
_started_in: int | None = None  # the process in which the simulator and its renderer were started

_Options = TypeVar("_Options")


class TaskError(ValueError):
    """An argument of the environment makes no sense; the message names it."""


class ForkError(TaskError):
    """The process was forked from one in which an environment was made."""


@dataclass(frozen=True)
class SceneOptions:
    """What lies on the table and how, what may be done to it, and where the arm starts; the card of `SelectiveGraspEnv`
    has the meanings.

    Raises TaskError.
    """

    n_objects: int = 3
    classes: Sequence[str] | None = None
    objects: Any = None
    clutter: str = "apart"
    same_class_twins: bool = False
    clear: bool = False
    clearance: float = 0.03
    joint_noise: float = 0.02
    n_strangers: int = 0
    strangers: Any = None
    absent: bool | float = False

    def __post_init__(self) -> None:
        fewest = 2 if self.same_class_twins else 1
        if self.clutter not in CLUTTERS:
            raise TaskError(f"clutter={self.clutter!r}: must be one of {CLUTTERS}")
        most = MOST_OBJECTS[self.clutter]
        if not 0 <= self.n_strangers <= most - fewest:
            raise TaskError(
                f"n_strangers={self.n_strangers}: must be between 0 and {most - fewest} with clutter={self.clutter!r}"
            )
        most -= self.n_strangers
        if not fewest <= self.n_objects <= most:
            more = [
                f"{name!r} {each - self.n_strangers}"
                for name, each in MOST_OBJECTS.items()
                if each > MOST_OBJECTS[self.clutter]
            ]
            raise TaskError(
                f"n_objects={self.n_objects}: must be between {fewest} and {most} with clutter={self.clutter!r}"
                + (f" and n_strangers={self.n_strangers}" if self.n_strangers else "")
                + (f"; there is room for more with {', '.join(more)}" if more else "")
            )
        if not 0 <= self.absent <= 1:
            raise TaskError(f"absent={self.absent}: must be False, True, or a probability in [0, 1]")
        if self.classes is not None:
            self._check_classes(tuple(self.classes))
        for name, value in (("clearance", self.clearance), ("joint_noise", self.joint_noise)):
            if not 0 <= value < float("inf"):
                raise TaskError(f"{name}={value}: must be a number and not negative")

    def open(self) -> tuple[Any, tuple[str, ...]]:
        """As `open_source`, with classes enough for what is to lie on the table."""
        source, classes = open_source(self.objects, self.classes)
        self._check_classes(classes)
        return source, classes

    def open_strangers(self, classes: Sequence[str]) -> Strangers | None:
        """Where strangers come from; None without them. Raises ObjectError as `open_strangers` does."""
        return open_strangers(self.strangers, classes) if self.n_strangers else None

    @property
    def answers(self) -> bool:
        """Whether the actions have the number that says that the asked-for class is not there."""
        return self.absent is not False

    def _check_classes(self, classes: tuple[str, ...]) -> None:
        if len(set(classes)) != len(classes) or not classes:
            raise TaskError(f"classes={classes}: must name at least one class, each once")
        if UNKNOWN in classes and self.n_strangers:
            raise TaskError(f"classes={classes}: strangers are called {UNKNOWN!r}, so no class can be")
        fewest = 2 if self.same_class_twins else 1
        away = "" if not self.answers else f", and absent={self.absent} one that stays away"
        if len(classes) - self.answers < 1:
            raise TaskError(f"absent={self.absent}: needs another class than the absent one in classes, now {classes}")
        if len(classes) - self.answers == 1 and self.n_objects > fewest:
            raise TaskError(
                f"n_objects={self.n_objects}: others than the asked-for one need another class in classes{away}; they "
                f"are {classes}; or set n_objects={fewest}"
            )


def open_source(objects: Any, classes: Sequence[str] | None) -> tuple[Any, tuple[str, ...]]:
    """Where objects come from, and the classes that may lie on the table.

    Args:
        objects: None, a mesh folder's path, arguments of `open_objects`, or a source that is open already.
        classes: None: the five LARS classes of the catalogue; of a mesh folder, and of an open source, all.

    Raises:
        TaskError: the source lacks a class. ObjectError: as `open_objects` does.
    """
    if hasattr(objects, "load"):
        source = objects
    else:
        arguments = dict(objects) if isinstance(objects, Mapping) else {"path": objects}
        if "classes" in arguments:
            raise TaskError(f"objects={objects}: classes are said beside it, as classes={arguments['classes']}")
        if classes is None and arguments.get("path") is None:
            classes = LARS_CLASSES
        source = open_objects(**arguments, classes=classes)
    names = tuple(source.classes if classes is None else classes)
    missing = [name for name in names if name not in source.classes]
    if missing:
        has = ", ".join(source.classes)
        raise TaskError(f"classes={names}: the objects have no class {', '.join(missing)}, they have {has}")
    return source, names


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
        intrinsics_of(self.resolution)  # raises for an unknown one

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
    return take(SceneOptions, arguments), take(SensingOptions, arguments), take(Randomisation, arguments)


def take(options: type[_Options], arguments: dict[str, Any]) -> _Options:
    """One group of options out of keyword arguments by name. Raises what the group raises."""
    names = [each.name for each in fields(options) if each.name in arguments]  # type: ignore[arg-type]
    return options(**{name: arguments.pop(name) for name in names})


def check_base_arguments(
    base: type,
    arguments: Mapping[str, Any],
    task: str = "SelectiveGrasp",
    groups: Sequence[type] = (SceneOptions, SensingOptions, Randomisation),
) -> None:
    """What is left for ManiSkill's ``base``: its arguments, with values that the task can do something with.

    task: its name. groups: of the options that are its own.

    Raises:
        TaskError: a value makes no sense here. TypeError: there is no such argument; it names the nearest.
    """
    own = [each.name for options in groups for each in fields(options)]
    known = [*own, *(name for name in signature(base).parameters if name not in ("args", "kwargs"))]
    for name in arguments:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1) or difflib.get_close_matches(name.split("_")[-1], known, 1)
            hint = "sim_config={...}" if name in ("control_freq", "sim_freq") else near[0] if near else None
            raise TypeError(
                f"{name}={arguments[name]!r}: {task} has no such argument"
                + (f"; did you mean {hint}?" if hint else f". It has {', '.join(known)}")
            )
    modes = {
        "reward_mode": (*base.SUPPORTED_REWARD_MODES, None),  # type: ignore[attr-defined]
        "render_mode": (*base.SUPPORTED_RENDER_MODES, None),  # type: ignore[attr-defined]
    }
    for name, values in modes.items():
        if name in arguments and arguments[name] not in values:
            raise TaskError(f"{name}={arguments[name]!r}: must be one of {values}")


def check_obs_mode(obs_mode: str | None, render_backend: str | None) -> None:
    """Raises TaskError, which names the modes that there are; or nothing renders what is to be seen."""
    parts = [] if obs_mode is None or obs_mode in _WHOLE_MODES else str(obs_mode).split("+")
    if any(part not in (*TEXTURES, *_JOINED) for part in parts) or len(set(parts)) != len(parts):
        raise TaskError(f"obs_mode={obs_mode!r}: must be one of {OBS_MODES}")
    if render_backend in (None, "none") and obs_mode not in (None, "state", "state_dict", "none"):
        raise TaskError(
            f"obs_mode={obs_mode!r}: needs a renderer, render_backend={render_backend!r} is none; say 'gpu' or 'cpu', "
            "or observe state or state_dict"
        )


def check_robot(robot_uids: Any, own: type) -> str:
    """The robot's name. Raises TaskError where another one is asked for."""
    asked = robot_uids
    if isinstance(asked, (tuple, list)) and len(asked) == 1:
        asked = asked[0]
    uid: str = own.uid  # type: ignore[attr-defined]
    if asked not in (None, uid, own):
        raise TaskError(
            f"robot_uids={robot_uids!r}: the task is for {uid!r} alone, a UR5 with a Robotiq 2F-140 and a camera; "
            "leave the argument out, or derive an environment of your own for another robot"
        )
    return uid


def check_simulator(num_envs: int, sim_backend: str, one_scene: bool) -> None:
    """Raises TaskError where so many environments cannot be simulated there; it says how they can.

    one_scene: ManiSkill's ``parallel_in_single_scene``.
    """
    if not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
        raise TaskError(f"num_envs={num_envs!r}: must be an integer of at least 1")
    if str(sim_backend).split(":")[0] not in _SIM_BACKENDS:
        raise TaskError(f"sim_backend={sim_backend!r}: must be one of {', '.join(_SIM_BACKENDS)}")
    on_gpu = (sim_backend == "auto" and num_envs > 1) or any(name in sim_backend for name in ("cuda", "gpu"))
    if on_gpu:
        import torch

        if torch.cuda.is_available():
            return
        lacks = f"sim_backend={sim_backend!r} needs a CUDA device, and there is none"
    elif num_envs > 1:
        lacks = f"sim_backend={sim_backend!r} simulates one environment in a process"
    elif one_scene:
        raise TaskError("parallel_in_single_scene=True: is for several environments on a GPU")
    else:
        return
    way = f"On a CPU {VECTORISED.format(n=num_envs)} runs as many, each in a process of its own"
    raise TaskError(f"num_envs={num_envs}: {lacks}. " + (way if num_envs > 1 else "Leave it out, or say 'physx_cpu'"))


def claim_process() -> None:
    """Raises ForkError in a process forked from one in which an environment was made: the renderer does not live on."""
    global _started_in
    if _started_in not in (None, os.getpid()):
        raise ForkError(
            "this process was forked from one in which the renderer runs already, and it does not survive that. Start "
            f"processes anew: {VECTORISED.format(n=8)}, or AsyncVectorEnv(…, context='spawn')"
        )
    _started_in = os.getpid()
