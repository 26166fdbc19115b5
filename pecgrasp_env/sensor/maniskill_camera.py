"""The simulated wrist camera as ManiSkill sees it: float depth from the renderer, then the sensor model on top.

SAPIEN's "trivial" shader computes no light: it is the fastest, and its positions are floats, where those of ManiSkill's
own shader configurations are whole millimetres. Lit images come from ManiSkill's "minimal" shader, whose depth buffer
is float too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from mani_skill.render.shaders import ShaderConfig
from mani_skill.sensors.camera import Camera

from pecgrasp_env.sensor.d435_noise import apply_d435, apply_ideal
from pecgrasp_env.sensor.intrinsics import BASELINE, D435, CameraIntrinsics
from pecgrasp_env.sensor.sapien_depth import FAR, NEAR

_LARGEST_DISPARITY = 126  # pixels that the D435's stereo processor searches


def _split_position(data: torch.Tensor) -> dict[str, torch.Tensor]:
    """Depth in metres; positions in millimetres, OpenGL axes, as ManiSkill's point clouds expect them."""
    return {"depth": -data[..., 2:3], "position": data[..., :3] * 1000}


UNLIT = ShaderConfig(
    shader_pack="trivial",
    texture_names={"Color": ["rgb"], "Position": ["position", "depth"], "Segmentation": ["segmentation"]},
    texture_transforms={
        "Color": lambda data: {"rgb": (data[..., :3].clamp(0, 1) * 255).to(torch.uint8)},
        "Position": _split_position,
        "Segmentation": lambda data: {"segmentation": data[..., 1:2].to(torch.int16)},
    },
)


def _undo_projection(buffer: torch.Tensor) -> dict[str, torch.Tensor]:
    """Vulkan's depth buffer in [0, 1] → metres along the optical axis, 0 where nothing was drawn."""
    return {"depth": ((buffer < 1) * (NEAR * FAR) / (FAR - buffer * (FAR - NEAR)))[..., None]}


LIT = ShaderConfig(
    shader_pack="minimal",
    texture_names={
        "Color": ["rgb"],
        "PositionSegmentation": ["position", "segmentation"],
        "GbufferDepth": ["depth"],
    },
    texture_transforms={
        "Color": lambda data: {"rgb": data[..., :3]},
        "PositionSegmentation": lambda data: {"position": data[..., :3], "segmentation": data[..., 3:]},
        "GbufferDepth": _undo_projection,
    },
)


def sense(
    images: dict[str, torch.Tensor], camera: Camera, mode: str, generators: Sequence[np.random.Generator]
) -> dict[str, torch.Tensor]:
    """Replaces exact depth by what the sensor measures.

    Args:
        images: of one camera, first axis the sub-environments: ``depth`` (N, H, W, 1) m and/or ``position``
            (N, H, W, 3) mm, OpenGL axes; others pass through, but where a point is missing beside ``position`` its
            ``segmentation`` is 0, which is how ManiSkill's point clouds mark points that are none.
        camera: the camera that took them, for its intrinsics.
        mode: "ideal" or "d435".
        generators: N, one for each sub-environment.

    Returns:
        The same keys; depth 0 and position 0 where nothing was measured.
    """
    key = "depth" if "depth" in images else "position"
    exact = images["depth"][..., 0] if key == "depth" else -images["position"][..., 2] / 1000
    intrinsics = intrinsics_of_camera(camera)
    exact_frames = exact.cpu().numpy()
    if mode == "ideal":
        frames = [apply_ideal(frame, intrinsics) for frame in exact_frames]
    else:
        frames = [apply_d435(frame, intrinsics, rng) for frame, rng in zip(exact_frames, generators, strict=True)]
    depth = torch.from_numpy(np.stack(frames)).to(exact.device)
    result = dict(images)
    if "depth" in images:
        result["depth"] = depth[..., None]
    if "position" in images:
        # Noise moves a point along its ray.
        ratio = torch.where(exact > 0, depth / exact, torch.zeros_like(depth))
        result["position"] = images["position"] * ratio[..., None]
        if "segmentation" in images:
            result["segmentation"] = images["segmentation"] * (depth > 0)[..., None]
    return result


def intrinsics_of_camera(camera: Camera) -> CameraIntrinsics:
    """The intrinsics of a ManiSkill camera, with the least depth that a D435 of this focal length could measure."""
    width, height = camera.config.width, camera.config.height
    matrix = camera.camera.get_intrinsic_matrix()[0].cpu().numpy()
    fx, fy, cx, cy = (float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    known = D435.get(f"{width}x{height}")
    nearest = known.min_depth if known else fx * BASELINE / _LARGEST_DISPARITY
    return CameraIntrinsics(width, height, fx, fy, cx, cy, nearest)
