"""The scenarios: ways to bring objects before the camera."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from pecgrasp_env.capture.config import CaptureConfig

if TYPE_CHECKING:
    from pec.data.shards import CloudSample
    from pecgrasp_env.capture.scenarios.base import Scenario

__all__ = ["open_scenario"]

_GPU_FRAMES = 64
"""Sub-scenes of ManiSkill's batch: at 848x480 half a gigabyte of frames."""


def open_scenario(config: CaptureConfig, frames_at_once: int | None = None) -> Scenario[CloudSample]:
    """What captures objects as `config` says, in this process; frames_at_once as in `generate`."""
    # Imported here, as they load Vulkan: in the process that renders only.
    if config.scenario == "surface":
        from pecgrasp_env.capture.scenarios.surface import SurfaceScenario

        return SurfaceScenario(config)
    from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer, Renderer, gpu_draws

    open_renderer: Callable[[float], Renderer] = DepthRenderer
    if frames_at_once is None:
        frames_at_once = _GPU_FRAMES if gpu_draws() else 1
    if frames_at_once > 1:
        from pecgrasp_env.capture.rendering.gpu_renderer import GpuRenderer

        open_renderer = partial(GpuRenderer, cameras=config.intrinsics, at_once=frames_at_once)
    if config.scenario == "piled":
        from pecgrasp_env.capture.scenarios.piled import PiledScenario

        return PiledScenario(config, open_renderer)
    if config.scenario == "tabletop":
        from pecgrasp_env.capture.scenarios.tabletop import TabletopScenario

        return TabletopScenario(config, open_renderer)
    from pecgrasp_env.capture.scenarios.free import FreeScenario

    return FreeScenario(config, open_renderer)
