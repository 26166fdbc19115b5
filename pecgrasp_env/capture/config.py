"""What a generated data set is made of: everything that decides its bytes, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pecgrasp_env.objects import LARS_CLASSES
from pecgrasp_env.objects.deform import MOST
from pecgrasp_env.objects.procedural.catalogue import FAMILIES
from pecgrasp_env.objects.ycb import LOOK_ALIKES
from pecgrasp_env.policy.viewpoints import N_VIEWPOINTS
from pecgrasp_env.sensor import SENSOR_MODES, CameraIntrinsics, D435Noise, SensorError, intrinsics_of
from pecgrasp_env.sensor.structured_light_noise import STRUCTURED_LIGHT, StructuredLightNoise

__all__ = ["SCENARIOS", "CaptureConfig", "CaptureError", "ObjectsConfig", "TabletopConfig"]

SENSORS = (*SENSOR_MODES, "structured_light")
_FAULTS = {"d435": D435Noise, "structured_light": StructuredLightNoise}
SCENARIOS = ("free", "tabletop", "piled", "surface")
SOURCES = ("catalogue", "folder", "ycb", "modelnet10")


class CaptureError(ValueError):
    """A generation that cannot be done as configured; the message names the field or the object."""


@dataclass(frozen=True)
class ObjectsConfig:
    """Which objects: those of a mesh folder, where there is a path, else those of a source."""

    source: str = "catalogue"
    """"catalogue": procedural. "folder": the meshes of path. "ycb": its five classes. "modelnet10": the archive that
    path names."""
    path: str | None = None
    classes: tuple[str, ...] | None = None
    """None: the five LARS classes of the catalogue, or every class of the folder or of the source."""
    instances_per_class: int | None = None
    """None: twenty of the catalogue, one of YCB, or every instance of the folder."""
    scale: float = 1.0
    """Factor from the units of the folder's meshes to metres."""
    allow_open: bool = False
    """Take meshes of the folder that are not closed, as thin shells."""
    seed: int = 0
    """The first instance that the catalogue draws."""
    families: str = "narrow"
    """How wide the catalogue draws: "narrow", as the published sets have it, or "wide", in those of many products."""
    deformations: int = 0
    """Deformed copies of each instance, besides itself."""
    deformation: float = 0.15
    """How strongly: the standard deviation of the logarithm of their sizes; bend, twist and the rest go with it."""
    download: bool = False
    """Of "ycb": ManiSkill's download instead of look-alikes out of the catalogue."""
    strangers: int | None = 0
    """Things of none of the classes that are drawn besides, as a last class "unknown"; None: so many that they make a
    third of the clouds."""
    strangers_samples: int = 10
    """Clouds of each of them, at most samples_per_instance: few, so that as many things as possible are seen."""

    def __post_init__(self) -> None:
        if self.source not in SOURCES:
            raise CaptureError(f"objects.source {self.source!r} does not exist; choose one of {', '.join(SOURCES)}")
        if self.source == "folder" and self.path is None:
            raise CaptureError("objects.path must name a folder of meshes: FOLDER/<class>/<instance>.{obj,ply,stl,glb}")
        if self.source == "modelnet10" and self.path is None:
            raise CaptureError("objects.path must name ModelNet10.zip or the folder that was unpacked from it")
        if self.instances_per_class is not None and self.instances_per_class < 1:
            raise CaptureError(f"objects.instances_per_class must be at least 1, got {self.instances_per_class}")
        if self.classes is not None and (not self.classes or len(set(self.classes)) != len(self.classes)):
            raise CaptureError(f"objects.classes must name at least one class and none twice, got {list(self.classes)}")
        if self.strangers is not None and self.strangers < 0:
            raise CaptureError(f"objects.strangers must not be negative, got {self.strangers}; null: as many as pays")
        if self.strangers_samples < 1:
            raise CaptureError(f"objects.strangers_samples must be at least 1, got {self.strangers_samples}")
        if self.strangers != 0 and self.source == "modelnet10":
            raise CaptureError("objects.strangers must be 0 with modelnet10: strangers are things that a gripper holds")
        if self.families not in FAMILIES:
            raise CaptureError(
                f"objects.families {self.families!r} does not exist; choose one of {', '.join(FAMILIES)}"
            )
        if self.families != "narrow" and (self.source != "catalogue" or self.path is not None):
            raise CaptureError(f"objects.families={self.families} is of the catalogue; other objects have none: narrow")
        if self.deformations < 0:
            raise CaptureError(f"objects.deformations must not be negative, got {self.deformations}")
        if not 0 < self.deformation <= MOST:
            raise CaptureError(
                f"objects.deformation must be above 0 and at most {MOST}, got {self.deformation}; "
                "objects.deformations=0 for none"
            )
        if self.deformations and self.source == "modelnet10":
            raise CaptureError("objects.deformations must be 0 with modelnet10, whose split is by mesh")
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
    free_views: float = 0.0
    """Share of the frames that a camera on a stand takes, 0.45 to 1.4 m away from about the table, not the robot's."""
    min_purity: float = 0.95
    """Of a cut-out's points on objects, the least share that lies on the labelled one; 0 keeps all, marked so."""
    losses: bool = False
    """Some surfaces lose regions of their depth, as dark and shiny ones do: one object in six about half of it."""
    drops: int = 32
    """Falls of an instance, from which its resting poses are drawn."""

    def __post_init__(self) -> None:
        for name, least, most in (
            ("objects_per_frame", 1, 15),
            ("distractors", 0, 8),
            ("clearance", 0, 0.2),
            ("joint_noise", 0, 0.1),  # beyond, the camera turns away from the objects
            ("free_views", 0, 1),
            ("min_purity", 0, 1),
            ("drops", 1, 1000),
        ):
            if not least <= getattr(self, name) <= most:
                raise CaptureError(f"tabletop.{name} must lie in {least} … {most}, got {getattr(self, name)}")


@dataclass(frozen=True)
class CaptureConfig:
    """A scenario, its objects and its camera."""

    scenario: str = "free"
    """"free": the published protocol, any pose in the air. "tabletop": at rest, seen and cut out as by the robot.
    "piled": the same, but fallen onto each other. "surface": points from all over the mesh, without a camera."""
    objects: ObjectsConfig = field(default_factory=ObjectsConfig)
    samples_per_instance: int = 1000
    sensor: str = "ideal"
    """"ideal" and "d435": a D435 without and with its faults. "structured_light": a Kinect of 2010, Xtion or Carmine,
    of `tabletop` and `piled`."""
    resolutions: tuple[str, ...] = ("424x240",)
    """Depth modes of the camera; of several, each frame draws one."""
    noise: D435Noise | StructuredLightNoise = field(default_factory=D435Noise)
    """The sensor's, where it has faults."""
    max_depth: float = 2.0
    """Of `free`, metres along the optical axis: objects are drawn from the camera's minimum depth up to it."""
    tabletop: TabletopConfig = field(default_factory=TabletopConfig)
    """Of `tabletop` and `piled`; the latter has no use for clearance and drops."""
    min_points: int = 64
    """A cloud with fewer points is thrown away and its pose drawn anew."""
    max_occlusion: float = 0.5
    """Of `tabletop`: an object of which others hide a larger share gives no sample of that frame."""
    surface_points: int = 1024
    """Of `surface`: points of a cloud."""
    seed: int = 0
    shard_size: int = 250
    """Samples a shard, of one instance in `free`, of those that share a table in `tabletop`."""

    def __post_init__(self) -> None:
        for name in ("samples_per_instance", "min_points", "surface_points", "shard_size"):
            if getattr(self, name) < 1:
                raise CaptureError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.scenario not in SCENARIOS:
            raise CaptureError(f"scenario {self.scenario!r} does not exist; choose one of {', '.join(SCENARIOS)}")
        if self.seed < 0:
            raise CaptureError(f"seed must not be negative, got {self.seed}")
        if self.sensor not in SENSORS:
            raise SensorError(f"sensor.mode {self.sensor!r} does not exist; choose one of {', '.join(SENSORS)}")
        if self.sensor == "structured_light" and self.scenario not in ("tabletop", "piled"):
            raise SensorError(
                f"sensor.mode 'structured_light' sees whole tables, so scenario={self.scenario} has none; choose "
                "scenario=tabletop or piled, or sensor=d435"
            )
        if self.sensor != "ideal" and not isinstance(self.noise, _FAULTS[self.sensor]):
            raise SensorError(f"noise of {self.sensor} is a {_FAULTS[self.sensor].__name__}, not {self.noise!r}")
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
            tabletop=_tabletop(settings),
            objects=ObjectsConfig(
                classes=None if classes is None else tuple(classes),
                instances_per_class=settings["instances_per_class"],
                strangers=0 if settings.get("scenario") == "surface" else objects.get("strangers", 0),
                families=objects.get("families") or _usual_families(objects),
                deformations=objects.get("deformations", ObjectsConfig.deformations),
                deformation=objects.get("deformation", ObjectsConfig.deformation),
                strangers_samples=objects.get("strangers_samples", ObjectsConfig.strangers_samples),
                **{name: objects[name] for name in ("source", "path", "scale", "allow_open", "seed", "download")},
            ),
            sensor=sensor["mode"],
            resolutions=(resolution,) if isinstance(resolution, str) else tuple(resolution),
            noise=_FAULTS[sensor["mode"]](**noise) if sensor["mode"] in _FAULTS else D435Noise(),
            **{
                name: settings[name]
                for name in (
                    "samples_per_instance",
                    "max_depth",
                    "min_points",
                    "max_occlusion",
                    "surface_points",
                    "seed",
                    "shard_size",
                )
                if name in settings
            },
        )

    def described(self) -> dict[str, Any]:
        """What decides the data, as JSON has it: without the numbers of a scenario or a sensor that is not used."""
        unused = {
            "free": {"tabletop", "max_occlusion", "surface_points"},
            "tabletop": {"max_depth", "surface_points"},
            "piled": {"max_depth", "surface_points"},
            "surface": {"tabletop", "max_occlusion", "max_depth", "min_points", "sensor", "resolutions", "noise"},
        }[self.scenario]
        if self.sensor == "ideal":
            unused.add("noise")
        described = {name: value for name, value in asdict(self).items() if name not in unused}
        if self.objects.strangers == 0:
            del described["objects"]["strangers"], described["objects"]["strangers_samples"]
        if self.objects.families == "narrow":
            del described["objects"]["families"]
        if self.objects.deformations == 0:
            del described["objects"]["deformations"], described["objects"]["deformation"]
        if "tabletop" in described and not self.tabletop.losses:
            del described["tabletop"]["losses"]
        return json.loads(json.dumps(described))

    @property
    def samples_of_stranger(self) -> int:
        """Clouds of each stranger that is drawn; in heaps, where they lie among known things, as many as of those."""
        if self.scenario == "piled":
            return self.samples_per_instance
        return min(self.objects.strangers_samples, self.samples_per_instance)

    @property
    def intrinsics(self) -> tuple[CameraIntrinsics, ...]:
        """The cameras of `resolutions`. Raises SensorError where there is none."""
        if self.sensor != "structured_light":
            return tuple(map(intrinsics_of, self.resolutions))
        for resolution in self.resolutions:
            if resolution not in STRUCTURED_LIGHT:
                choice = ", ".join(STRUCTURED_LIGHT)
                raise SensorError(
                    f"sensor.resolution {resolution!r} is none of structured light; choose one of {choice}"
                )
        return tuple(STRUCTURED_LIGHT[resolution] for resolution in self.resolutions)

    @property
    def cameras(self) -> list[dict[str, Any]]:
        """What a sample's `camera` counts: the resolutions, in `tabletop` each from all of the policy's postures."""
        if self.scenario == "surface":
            return [{"name": "none"}]
        known = list(zip(self.resolutions, map(asdict, self.intrinsics), strict=True))
        if self.scenario == "free":
            return [{"name": name, **camera} for name, camera in known]
        views = [f"the policy's view {view}" for view in range(1, N_VIEWPOINTS + 1)]
        cameras = [{"name": f"{name}, {view}", **camera} for name, camera in known for view in views]
        if self.tabletop.free_views:
            cameras += [{"name": f"{name}, on a stand", **camera} for name, camera in known]
        return cameras

    @property
    def labelled_classes(self) -> tuple[str, ...]:
        """Classes of the catalogue that the data set labels."""
        if self.objects.path is not None:
            return ()
        if self.objects.source == "ycb":
            return tuple(LOOK_ALIKES.values())
        return self.objects.classes or LARS_CLASSES


def _usual_families(objects: Mapping[str, Any]) -> str:
    """What lies on real tables is as wide as what is sold; other sources than the catalogue have no families."""
    return "wide" if objects["source"] == "catalogue" and objects["path"] is None else "narrow"


_OF_PILED = {"objects_per_frame": 6, "min_purity": 0.5}
"""Where nothing is said: a heap, and cut-outs of which half lies on the labelled object."""


def _tabletop(settings: Mapping[str, Any]) -> TabletopConfig:
    """As set; what is null is as usual in the scenario."""
    usual = _OF_PILED if settings.get("scenario") == "piled" else {}
    given = {name: value for name, value in (settings.get("tabletop") or {}).items() if value is not None}
    return TabletopConfig(**(usual | given))
