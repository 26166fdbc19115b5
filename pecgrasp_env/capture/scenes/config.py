"""What a set of labelled frames is made of: everything that decides its bytes, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.objects import CLASSES
from pecgrasp_env.sensor import D435, CameraIntrinsics
from pecgrasp_env.sensor.structured_light_noise import STRUCTURED_LIGHT

__all__ = ["CAMERAS", "KINDS", "FramesConfig", "SceneObjectsConfig"]

CAMERAS: dict[str, CameraIntrinsics] = {
    **{f"structured_light_{size}": camera for size, camera in STRUCTURED_LIGHT.items()},
    **{f"d435_{size}": camera for size, camera in D435.items()},
}
"""The cameras that there are, by name: what is before the last _ decides the faults."""

KINDS: dict[str, float] = {
    "apart": 0.14,
    "touching": 0.13,
    "leaning": 0.13,
    "stacked": 0.18,
    "contained": 0.1,
    "piled": 0.2,
    "bin": 0.12,
}
"""How objects lie (`arrangement`), and the share of the scenes."""

_USUAL_CAMERAS = {
    "structured_light_640x480": 0.5,
    "structured_light_320x240": 0.1,
    "d435_424x240": 0.15,
    "d435_640x480": 0.1,
    "d435_848x480": 0.15,
}


@dataclass(frozen=True)
class SceneObjectsConfig:
    """Which objects: those of the catalogue and plain shapes, and those of a mesh folder where there is a path."""

    path: str | None = None
    """Mesh folder: FOLDER/<class>/<instance>.{obj,ply,stl,glb}."""
    share: float = 0.5
    """Of the objects that come from the folder."""
    scale: float = 1.0
    """Factor from the units of the folder's meshes to metres."""
    allow_open: bool = False
    """Take meshes of the folder that are not closed, as thin shells."""
    classes: tuple[str, ...] | None = None
    """Of the catalogue that come; None: all."""
    plain_share: float = 0.65
    """Of the drawn objects that are plain shapes: what has no name has more shapes than the catalogue has classes."""
    plain_instances: int = 100
    """Of each plain shape, drawn by seed."""
    catalogue_instances: int = 12
    """Of each class of the catalogue: they take a second each to make."""
    seed: int = 0
    """The first instance: sets with others, such as 0 and 1000, share no drawn object."""

    def __post_init__(self) -> None:
        if not 0 < self.share <= 1:
            raise CaptureError(f"objects.share must lie in 0 … 1 and not be 0, got {self.share}")
        for name in self.classes or ():
            if name not in CLASSES:
                raise CaptureError(f"objects.classes: {name!r} does not exist; choose of {', '.join(CLASSES)}")
        if not 0 <= self.plain_share <= 1:
            raise CaptureError(f"objects.plain_share must lie in 0 … 1, got {self.plain_share}")
        if self.scale <= 0:
            raise CaptureError(f"objects.scale must be positive, got {self.scale}")
        for name, least in (("plain_instances", 1), ("catalogue_instances", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise CaptureError(f"objects.{name} must be at least {least}, got {getattr(self, name)}")


@dataclass(frozen=True)
class FramesConfig:
    """Scenes, how often each is looked at, and by what."""

    scenes: int = 400
    frames_per_scene: int = 2
    objects: SceneObjectsConfig = field(default_factory=SceneObjectsConfig)
    fewest: int = 2
    """Objects of a scene; fewer where no more find room."""
    most: int = 15
    kinds: Mapping[str, float] = field(default_factory=lambda: dict(KINDS))
    """Weight of each kind; those that are left out do not come."""
    cameras: Mapping[str, float] = field(default_factory=lambda: dict(_USUAL_CAMERAS))
    """Weight of each of `CAMERAS`."""
    val_share: float = 0.1
    """Of the scenes, kept apart from training: evenly spread over the set."""
    seed: int = 0
    shard_size: int = 10
    """Scenes a shard."""

    def __post_init__(self) -> None:
        for name in ("scenes", "frames_per_scene", "shard_size"):
            if getattr(self, name) < 1:
                raise CaptureError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not 1 <= self.fewest <= self.most <= 100:
            raise CaptureError(f"1 ≤ fewest ≤ most ≤ 100 wanted, got {self.fewest} and {self.most}")
        if not 0 <= self.val_share < 1:
            raise CaptureError(f"val_share must lie in 0 … 1 and not be 1, got {self.val_share}")
        if self.seed < 0:
            raise CaptureError(f"seed must not be negative, got {self.seed}")
        for name, known in (("kinds", KINDS), ("cameras", CAMERAS)):
            weights = getattr(self, name)
            for key, weight in weights.items():
                if key not in known:
                    raise CaptureError(f"{name}.{key} does not exist; choose of {', '.join(known)}")
                if not weight >= 0:
                    raise CaptureError(f"{name}.{key} must not be negative, got {weight}")
            if not sum(weights.values()) > 0:
                raise CaptureError(f"{name}: one weight at least must be above 0, got {dict(weights)}")

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> FramesConfig:
        """From the mapping that conf/generate_scenes.yaml makes; keys that do not decide the data are passed over."""
        names = ("scenes", "frames_per_scene", "fewest", "most", "kinds", "cameras", "val_share", "seed", "shard_size")
        given = {name: settings[name] for name in names if name in settings}
        objects = dict(settings["objects"])
        if objects.get("classes") is not None:
            objects["classes"] = tuple(objects["classes"])
        return cls(objects=SceneObjectsConfig(**objects), **given)

    def described(self) -> dict[str, Any]:
        """What decides the data, as JSON has it."""
        return json.loads(json.dumps(asdict(self) | {"kinds": dict(self.kinds), "cameras": dict(self.cameras)}))

    def is_val(self, scene: int) -> bool:
        """Whether a scene is kept apart from training."""
        return int((scene + 1) * self.val_share + 1e-9) > int(scene * self.val_share + 1e-9)
