"""What the configured sensor makes of a laid table."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pecgrasp_env.capture.rendering.tabletop_depth import Table
from pecgrasp_env.capture.scenarios.base import measure
from pecgrasp_env.sensor.structured_light_noise import StructuredLightNoise, apply_structured_light
from pecgrasp_env.sensor.surface_losses import draw_losses, lost_regions

if TYPE_CHECKING:
    from pecgrasp_env.capture.config import CaptureConfig
    from pecgrasp_env.sensor import CameraIntrinsics

__all__ = ["measured_table"]


def measured_table(config: CaptureConfig, exact: Table, camera: CameraIntrinsics, rng: np.random.Generator) -> Table:
    """The same table, its depth (H, W), m, as measured, 0 for holes, and its owners where their surfaces are seen now:
    structured light moves borders. With `tabletop.losses` surfaces are drawn darker or shinier than others.
    """
    lost = None
    if config.tabletop.losses:
        of_owner = np.concatenate([np.zeros(1, np.float32), draw_losses(len(exact.occlusion), rng)])
        lost = of_owner[exact.owner]
    if config.sensor == "structured_light":
        assert isinstance(config.noise, StructuredLightNoise)
        depth, source = apply_structured_light(exact.depth, camera, rng, config.noise, lost)
        return replace(exact, depth=depth, owner=exact.owner.reshape(-1)[source])
    depth = measure(config, exact.depth, camera, rng)
    if lost is not None:
        depth = np.where(lost_regions(lost, rng), 0, depth)
    return replace(exact, depth=depth)
