"""What a set of grasp labels is made of: everything that decides its bytes, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.grasps.candidates import SAMPLERS
from pecgrasp_env.capture.grasps.trials import OUTCOMES
from pecgrasp_env.common.planner_networks import network_keys

__all__ = ["GraspsConfig"]

_USUAL_SHARES = {"antipodal": 0.4, "planner": 0.3, "worsened": 0.3}


@dataclass(frozen=True)
class GraspsConfig:
    """capture: the objects, how they lie, and what sees them; its samples are scenes, each of one object alone."""

    capture: CaptureConfig
    grasps_per_scene: int = 50
    samplers: Mapping[str, float] = field(default_factory=lambda: dict(_USUAL_SHARES))
    """Weight of each of `SAMPLERS`; those that are left out do not come."""
    cells: int = 50
    """Grasps that are tried at once in one scene."""
    planners: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Where there are any, the first grasp of each is tried instead of grasps of `samplers`: Hydra-like mappings with
    ``_target_``, by names that stand for samplers in the labels."""

    def __post_init__(self) -> None:
        for name in ("grasps_per_scene", "cells"):
            if getattr(self, name) < 1:
                raise CaptureError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name, weight in self.samplers.items():
            if name not in SAMPLERS:
                raise CaptureError(f"samplers.{name} does not exist; choose of {', '.join(SAMPLERS)}")
            if not weight >= 0:
                raise CaptureError(f"samplers.{name} must not be negative, got {weight}")
        if not sum(self.samplers.get(name, 0.0) for name in SAMPLERS if name != "worsened") > 0:
            raise CaptureError("samplers: antipodal or planner must be above 0: others are copies of theirs")
        if self.capture.scenario != "tabletop" or self.capture.tabletop.objects_per_frame != 1:
            raise CaptureError("grasps are tried on objects that lie alone: tabletop with objects_per_frame=1")
        if self.capture.objects.source == "modelnet10":
            raise CaptureError("objects.source must not be modelnet10, whose meshes have no size in metres")

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> GraspsConfig:
        """From the mapping that conf/generate_grasps.yaml makes; keys that do not decide the data are passed over."""
        planners = dict(settings.get("planners", {}))
        scenes, per_scene = settings["scenes_per_instance"], len(planners) or settings["grasps_per_scene"]
        if per_scene < 1:
            raise CaptureError(f"grasps_per_scene must be at least 1, got {per_scene}")
        lying = {"objects_per_frame": 1, "free_views": settings["free_views"]}
        of_capture = {
            "scenario": "tabletop",
            "tabletop": lying,
            "samples_per_instance": scenes,
            "shard_size": max(1, settings["shard_size"] // per_scene),
        }
        capture = CaptureConfig.from_settings({**settings, **of_capture})
        return cls(capture, per_scene, dict(settings["samplers"]), settings["cells"], planners)

    def described(self) -> dict[str, Any]:
        """What decides the data, as JSON has it, and what the labels' codes mean."""
        own = {"grasps_per_scene": self.grasps_per_scene, "cells": self.cells, "sampler_weights": dict(self.samplers)}
        if self.planners:
            networks = {name: network_keys(settings) for name, settings in self.planners.items()}
            own |= {"planners": dict(self.planners), "networks": networks}
        codes = {"samplers": list(self.planners or SAMPLERS), "outcomes": list(OUTCOMES)}
        return json.loads(json.dumps({**self.capture.described(), **own, **codes}))
