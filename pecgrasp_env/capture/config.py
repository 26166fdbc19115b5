"""What a generated data set is made of: everything that decides its bytes, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pecgrasp_env.sensor import SENSOR_MODES, CameraIntrinsics, D435Noise, SensorError, SensorMode, intrinsics_of

__all__ = ["SCENARIOS", "CaptureConfig", "CaptureError", "ObjectsConfig", "TabletopConfig"]

SCENARIOS = ("free", "tabletop")


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
    """Where the camera stands above the table, and what segmentation takes from the object."""

    distance: tuple[float, float] = (0.4, 0.7)
    """Metres from the camera to the table along the optical axis, smallest and largest."""
    max_tilt: float = 0.6
    """Largest angle between the optical axis and the vertical, radians."""
    cut: tuple[float, float] = (0.003, 0.008)
    """Points up to this height above the table are lost with it, metres, smallest and largest."""
    drops: int = 32
    """Falls of an instance, from which its resting poses are drawn."""

    def __post_init__(self) -> None:
        for name in ("distance", "cut"):
            low, high = getattr(self, name)
            if not 0 <= low <= high:
                raise CaptureError(f"tabletop.{name} must be (smallest, largest) and not negative, got {(low, high)}")
        if self.distance[0] <= 0:
            raise CaptureError(f"tabletop.distance must be positive, got {self.distance}")
        # Rays at the image's corner are 50 degrees off the axis: beyond 0.7 rad they pass over the table's edge.
        if not 0 <= self.max_tilt <= 0.7:
            raise CaptureError(f"tabletop.max_tilt must lie in 0 … 0.7 rad, got {self.max_tilt}")
        if self.drops < 1:
            raise CaptureError(f"tabletop.drops must be at least 1, got {self.drops}")


@dataclass(frozen=True)
class CaptureConfig:
    """A scenario, its objects and its camera."""

    scenario: str = "free"
    """"free": the published protocol, any pose in the air. "tabletop": at rest, seen from above."""
    objects: ObjectsConfig = field(default_factory=ObjectsConfig)
    samples_per_instance: int = 1000
    sensor: SensorMode = "ideal"
    resolution: str = "424x240"
    noise: D435Noise = field(default_factory=D435Noise)
    """Used where sensor is "d435"."""
    max_depth: float = 2.0
    """Of `free`, metres along the optical axis: objects are drawn from the resolution's minimum depth up to it."""
    tabletop: TabletopConfig = field(default_factory=TabletopConfig)
    """Of `tabletop`."""
    min_points: int = 64
    """A cloud with fewer points is thrown away and its pose drawn anew."""
    seed: int = 0
    shard_size: int = 250
    """Samples a shard; a shard holds samples of one instance."""

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
        if self.max_depth <= self.intrinsics.min_depth:
            raise CaptureError(
                f"max_depth {self.max_depth} m must exceed the minimum depth at {self.resolution}, "
                f"{self.intrinsics.min_depth} m"
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> CaptureConfig:
        """From the mapping that conf/generate.yaml makes; keys that do not decide the data are passed over."""
        objects, sensor = settings["objects"], settings["sensor"]
        noise = dict(sensor.get("noise") or {})
        if "patch_radius" in noise:
            noise["patch_radius"] = tuple(noise["patch_radius"])
        tabletop = dict(settings.get("tabletop") or {})
        for name in {"distance", "cut"} & tabletop.keys():
            tabletop[name] = tuple(tabletop[name])
        classes = objects["classes"]
        return cls(
            scenario=settings.get("scenario", "free"),
            tabletop=TabletopConfig(**tabletop),
            objects=ObjectsConfig(
                path=objects["path"],
                classes=None if classes is None else tuple(classes),
                instances_per_class=settings["instances_per_class"],
                scale=objects["scale"],
                seed=objects["seed"],
            ),
            sensor=sensor["mode"],
            resolution=sensor["resolution"],
            noise=D435Noise(**noise),
            **{
                name: settings[name]
                for name in ("samples_per_instance", "max_depth", "min_points", "seed", "shard_size")
            },
        )

    def described(self) -> dict[str, Any]:
        """What decides the data, as JSON has it: without the numbers of a scenario or a sensor that is not used."""
        unused = {"max_depth"} if self.scenario == "tabletop" else {"tabletop"}
        if self.sensor == "ideal":
            unused.add("noise")
        whole = {**asdict(self), "camera": asdict(self.intrinsics)}
        return json.loads(json.dumps({name: value for name, value in whole.items() if name not in unused}))

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera of `resolution`. Raises SensorError where there is none."""
        return intrinsics_of(self.resolution)
