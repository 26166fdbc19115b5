"""The simulated wrist camera as ManiSkill sees it: float depth from the renderer, then the sensor model on top.

SAPIEN's "trivial" shader computes no light: it is the fastest, and its positions are floats, where those of ManiSkill's
own shader configurations are whole millimetres. Lit images come from ManiSkill's "minimal" shader, whose depth buffer
is float too; normals and albedo from its "default" one. Whatever the shader, depth is float metres here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from mani_skill.render.shaders import PREBUILT_SHADER_CONFIGS, ShaderConfig
from mani_skill.sensors.camera import Camera

from pecgrasp_env.sensor.d435_noise import apply_d435, apply_ideal
from pecgrasp_env.sensor.intrinsics import (
    BASELINE,
    D435,
    FAR,
    LARGEST_FOCAL_LENGTH,
    NEAR,
    CameraIntrinsics,
    SensorError,
)

_LARGEST_DISPARITY = 126  # pixels that the D435's stereo processor searches
CAMERA = "wrist_camera"
_SETTABLE = ("width", "height", "fov", "intrinsic", "near", "far", "pose", "shader_pack")


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


def _lit(near: float, far: float) -> ShaderConfig:
    def undo_projection(buffer: torch.Tensor) -> dict[str, torch.Tensor]:
        """Vulkan's depth buffer in [0, 1] → metres along the optical axis, 0 where nothing was drawn."""
        return {"depth": ((buffer < 1) * (near * far) / (far - buffer * (far - near)))[..., None]}

    return ShaderConfig(
        shader_pack="minimal",
        texture_names={
            "Color": ["rgb"],
            "PositionSegmentation": ["position", "segmentation"],
            "GbufferDepth": ["depth"],
        },
        texture_transforms={
            "Color": lambda data: {"rgb": data[..., :3]},
            "PositionSegmentation": lambda data: {"position": data[..., :3], "segmentation": data[..., 3:]},
            "GbufferDepth": undo_projection,
        },
    )


def _full(shader_pack: str) -> ShaderConfig:
    """One of ManiSkill's shaders that give every texture, with depth and positions as those of the others."""
    theirs = PREBUILT_SHADER_CONFIGS[shader_pack]
    return ShaderConfig(
        theirs.shader_pack,
        theirs.texture_names,
        theirs.shader_pack_config,
        {
            **UNLIT.texture_transforms,
            "Color": lambda data: {"rgb": (data[..., :3].clamp(0, 1) * 255).to(torch.uint8)},
            "Normal": lambda data: {"normal": data[..., :3]},
            "Albedo": lambda data: {"albedo": (data[..., :3].clamp(0, 1) * 255).to(torch.uint8)},
        },
    )


def _shader(pack: str | None, textures: Sequence[str], near: float, far: float) -> ShaderConfig:
    """pack: by name, None: the fastest that has the textures."""
    all_textures = {"normal", "albedo"} & set(textures)
    if pack is None:
        pack = "default" if all_textures else "minimal" if "rgb" in textures else "trivial"
    known = ("trivial", "minimal", "default", *(name for name in PREBUILT_SHADER_CONFIGS if name.startswith("rt")))
    if pack not in known:
        raise SensorError(f"shader_pack={pack!r}: must be one of {', '.join(known)}")
    if all_textures and pack in ("trivial", "minimal"):
        lacks = " or ".join(sorted(all_textures))
        raise SensorError(f"shader_pack={pack!r}: has no {lacks}, leave it out or say default")
    if pack.startswith("rt") and not torch.cuda.is_available():
        raise SensorError(f"shader_pack={pack!r}: ray tracing needs an NVIDIA GPU, and there is none; say default")
    return UNLIT if pack == "trivial" else _lit(near, far) if pack == "minimal" else _full(pack)


def camera_overrides(
    standard: CameraIntrinsics, textures: Sequence[str], sensor_configs: Mapping[str, Any] | None, camera: str = CAMERA
) -> tuple[CameraIntrinsics, dict[str, Any], dict[str, Any]]:
    """The wrist camera, or the one that a task names, as ManiSkill is to build it.

    Args:
        standard: of the D435's mode. With ``width`` or ``height`` its horizontal field of view stays, pixels stay
            square and the principal point central.
        textures: that are observed.
        sensor_configs: ManiSkill's argument. What holds for all sensors and what is said of the camera alone, the
            latter first, of _SETTABLE: ``fov`` is the vertical field of view, rad, with square pixels, ``intrinsic``
            (3, 3); either takes the place of the D435's focal length. ``near``, ``far``: m. ``pose``: on its link.
            ``shader_pack``: a name.
        camera: its name.

    Returns:
        Its intrinsics, its configuration, and those of other cameras by name.

    Raises:
        SensorError: one makes no sense, or cannot be set.
    """
    given = dict(sensor_configs or {})
    others = {name: value for name, value in given.items() if isinstance(value, Mapping) and name != camera}
    own = given.pop(camera, {})
    if not isinstance(own, Mapping):
        raise SensorError(f"sensor_configs={{{camera!r}: {own!r}}}: must be a dictionary with {', '.join(_SETTABLE)}")
    given = {name: value for name, value in given.items() if name not in others} | dict(own)
    for name in given:
        if name not in _SETTABLE:
            way = "; the faults of stereo are sensor='d435'" if name == "use_stereo_depth" else ""
            raise SensorError(
                f"sensor_configs: {name}={given[name]!r} cannot be set, but {', '.join(_SETTABLE)} can, for all "
                f"sensors or under {camera!r}{way}"
            )
    near, far = (float(given.get(name, value)) for name, value in (("near", NEAR), ("far", FAR)))
    if not 0 < near < far <= FAR:
        raise SensorError(f"sensor_configs: near={near}, far={far}: must be 0 < near < far <= {FAR} m")
    intrinsics = _intrinsics(standard, given)
    config = {
        "width": intrinsics.width,
        "height": intrinsics.height,
        "fov": None,
        "intrinsic": intrinsics.matrix,
        "near": near,
        "far": far,
        "shader_config": _shader(given.get("shader_pack"), textures, near, far),
    }
    return intrinsics, config | ({"pose": given["pose"]} if "pose" in given else {}), others


def _intrinsics(standard: CameraIntrinsics, given: Mapping[str, Any]) -> CameraIntrinsics:
    width, height = (given.get(name, getattr(standard, name)) for name in ("width", "height"))
    for name, value in (("width", width), ("height", height)):
        if not isinstance(value, (int, np.integer)) or not 1 <= value <= 8192:
            raise SensorError(f"sensor_configs: {name}={value!r}: must be a number of pixels, 1 to 8192")
    fov, matrix = given.get("fov"), given.get("intrinsic")
    if matrix is not None:
        if fov is not None:
            raise SensorError("sensor_configs: fov and intrinsic both say the focal length, give one of them")
        K = np.asarray(matrix, float)
        if K.shape != (3, 3) or not np.array_equal(K[2], [0, 0, 1]) or K[0, 1] != 0 or K[1, 0] != 0:
            raise SensorError(f"sensor_configs: intrinsic={K.tolist()}: must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    else:
        if fov is None:
            fx = standard.fx * width / standard.width
        elif np.ndim(fov) == 0 and 0 < fov < np.pi:
            fx = height / 2 / np.tan(fov / 2)
        else:
            raise SensorError(f"sensor_configs: fov={fov!r}: must be an angle in radians between 0 and pi")
        fy, cx, cy = fx, width / 2, height / 2
    if not all(0 < f <= LARGEST_FOCAL_LENGTH for f in (fx, fy)) or not (0 <= cx <= width and 0 <= cy <= height):
        raise SensorError(
            f"sensor_configs: focal lengths {fx:.6g} and {fy:.6g} px, principal point ({cx:.6g}, {cy:.6g}): must be up "
            f"to {LARGEST_FOCAL_LENGTH:.0f} px, and within the image of {width} x {height}"
        )
    return CameraIntrinsics(int(width), int(height), float(fx), float(fy), float(cx), float(cy))


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
    is_mode = known is not None and abs(known.fx - fx) < 0.5
    nearest = known.min_depth if known is not None and is_mode else fx * BASELINE / _LARGEST_DISPARITY
    return CameraIntrinsics(width, height, fx, fy, cx, cy, nearest)
