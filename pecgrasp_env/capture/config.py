"""What a generated data set is made of: everything that decides its bytes, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pecgrasp_env.objects import LARS_CLASSES
from pecgrasp_env.sensor import SENSOR_MODES, CameraIntrinsics, D435Noise, SensorError, SensorMode, intrinsics_of

__all__ = ["SCENARIOS", "CaptureConfig", "CaptureError", "ObjectsConfig", "TabletopConfig"]

SCENARIOS = ("free", "tabletop")
POLICY_VIEWS = 4
"""Postures from which the policy looks."""


class CaptureError(ValueError):
    """A generation that cannot be done as configured; the message names the field or the object."""


@dataclass(frozen=True)
class ObjectsConfig:
    """Which objects: the catalogue's (path None) or those of a mesh folder."""

    path: str | None = None
    classes: tuple[str, ...] | None = None
    """None: the five LARS classes of the catalogue, or every class of the folder."""
    instances_per_class: int | None = None
    """None: two of the catalogue, as in the LARS set, or every instance of the folder."""
    scale: float = 1.0
    """Factor from the units of the folder's meshes to metres."""
    seed: int = 0
    """The first instance that the catalogue draws."""

    def __post_init__(self) -> None:
        if self.instances_per_class is not None and self.instances_per_class < 1:
            raise CaptureError(f"objects.instances_per_class must be at least 1, got {self.instances_per_class}")
        if self.classes is not None and (not self.classes or len(set(self.classes)) != len(self.classes)):
            raise CaptureError(f"objects.classes must name at least one class and none twice, got {list(self.classes)}")
        if self.scale <= 0:
            raise CaptureError(f"objects.scale must be positive, got {self.scale}")


@dataclass(frozen=True)
class TabletopConfig:
    """How the table is laid, and which cut-outs are kept."""

    objects_per_frame: int = 3
    """Objects of the data set that share a table; each of them gives a sample of each frame."""
    distractors: int = 0
    """Further objects in each frame, of classes of the catalogue that the data set does not have; never labelled."""
    clearance: float = 0.03
    """Least distance between two outlines, metres."""
    joint_noise: float = 0.02
    """Greatest deviation of each arm joint from the policy's posture, radians."""
    min_purity: float = 0.95
    """Of a cut-out's points on objects, the least share that lies on the labelled one; 0 keeps all, marked so."""
    drops: int = 32
    """Falls of an instance, from which its resting poses are drawn."""

    def __post_init__(self) -> None:
        for name, least, most in (
            ("objects_per_frame", 1, 8),
            ("distractors", 0, 8),
            ("clearance", 0, 0.2),
            ("joint_noise", 0, 0.1),  # beyond, the camera turns away from the objects
            ("min_purity", 0, 1),
            ("drops", 1, 1000),
        ):
            if not least <= getattr(self, name) <= most:
                raise CaptureError(f"tabletop.{name} must lie in {least} … {most}, got {getattr(self, name)}")


@dataclass(frozen=True)
class CaptureConfig:
    """A scenario, its objects and its camera."""

    scenario: str = "free"
    """"free": the published protocol, any pose in the air. "tabletop": at rest, seen and cut out as by the robot."""
    objects: ObjectsConfig = field(default_factory=ObjectsConfig)
    samples_per_instance: int = 1000
    sensor: SensorMode = "ideal"
    resolutions: tuple[str, ...] = ("424x240",)
    """Depth modes of the D435; of several, each frame draws one."""
    noise: D435Noise = field(default_factory=D435Noise)
    """Used where sensor is "d435"."""
    max_depth: float = 2.0
    """Of `free`, metres along the optical axis: objects are drawn from the camera's minimum depth up to it."""
    tabletop: TabletopConfig = field(default_factory=TabletopConfig)
    """Of `tabletop`."""
    min_points: int = 64
    """A cloud with fewer points is thrown away and its pose drawn anew."""
    max_occlusion: float = 0.5
    """Of `tabletop`: an object of which others hide a larger share gives no sample of that frame."""
    seed: int = 0
    shard_size: int = 250
    """Samples a shard, of one instance in `free`, of those that share a table in `tabletop`."""

    def __post_init__(self) -> None:
        for name in ("samples_per_instance", "min_points", "shard_size"):
            if getattr(self, name) < 1:
                raise CaptureError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.scenario not in SCENARIOS:
            raise CaptureError(f"scenario {self.scenario!r} does not exist; choose one of {', '.join(SCENARIOS)}")
        if self.seed < 0:
            raise CaptureError(f"seed must not be negative, got {self.seed}")
        if self.sensor not in SENSOR_MODES:
            raise SensorError(f"sensor.mode {self.sensor!r} does not exist; choose one of {', '.join(SENSOR_MODES)}")
        if not self.resolutions or len(set(self.resolutions)) != len(self.resolutions):
            raise CaptureError(f"sensor.resolution must name at least one, none twice, got {list(self.resolutions)}")
        for name, camera in zip(self.resolutions, self.intrinsics, strict=True):
            if self.max_depth <= camera.min_depth:
                raise CaptureError(
                    f"max_depth {self.max_depth} m must exceed the minimum depth at {name}, {camera.min_depth} m"
                )
        if not 0 <= self.max_occlusion <= 1:
            raise CaptureError(f"max_occlusion must lie in 0 … 1, got {self.max_occlusion}")

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> CaptureConfig:
        """From the mapping that conf/generate.yaml makes; keys that do not decide the data are passed over."""
        objects, sensor = settings["objects"], settings["sensor"]
        noise = dict(sensor.get("noise") or {})
        if "patch_radius" in noise:
            noise["patch_radius"] = tuple(noise["patch_radius"])
        resolution = sensor["resolution"]
        classes = objects["classes"]
        return cls(
            scenario=settings.get("scenario", "free"),
            tabletop=TabletopConfig(**(settings.get("tabletop") or {})),
            objects=ObjectsConfig(
                path=objects["path"],
                classes=None if classes is None else tuple(classes),
                instances_per_class=settings["instances_per_class"],
                scale=objects["scale"],
                seed=objects["seed"],
            ),
            sensor=sensor["mode"],
            resolutions=(resolution,) if isinstance(resolution, str) else tuple(resolution),
            noise=D435Noise(**noise),
            **{
                name: settings[name]
                for name in ("samples_per_instance", "max_depth", "min_points", "max_occlusion", "seed", "shard_size")
            },
        )

    def described(self) -> dict[str, Any]:
        """What decides the data, as JSON has it: without the numbers of a scenario or a sensor that is not used."""
        unused = {"max_depth"} if self.scenario == "tabletop" else {"tabletop", "max_occlusion"}
        if self.sensor == "ideal":
            unused.add("noise")
        return json.loads(json.dumps({name: value for name, value in asdict(self).items() if name not in unused}))

    @property
    def intrinsics(self) -> tuple[CameraIntrinsics, ...]:
        """The cameras of `resolutions`. Raises SensorError where there is none."""
        return tuple(map(intrinsics_of, self.resolutions))

    @property
    def cameras(self) -> list[dict[str, Any]]:
        """What a sample's `camera` counts: the resolutions, in `tabletop` each from all of the policy's postures."""
        known = list(zip(self.resolutions, map(asdict, self.intrinsics), strict=True))
        if self.scenario == "free":
            return [{"name": name, **camera} for name, camera in known]
        views = range(1, POLICY_VIEWS + 1)
        return [{"name": f"{name}, the policy's view {view}", **camera} for name, camera in known for view in views]

    @property
    def labelled_classes(self) -> tuple[str, ...]:
        """Classes of the catalogue that the data set labels."""
        if self.objects.path is not None:
            return ()
        return self.objects.classes or LARS_CLASSES
