"""What a structured-light camera (Kinect of 2010, Asus Xtion, PrimeSense Carmine) makes of an exact depth image.

It compares windows of a projected dot pattern with a reference image, and gives disparity in steps of 1/8 pixel. What
is known, and is modelled:

- disparity in steps of 1/8 px of a 75 mm baseline, so depth in steps that grow as z², and a random error of the
  disparity (Khoshelham and Oude Elberink, Sensors 12:1437, 2012);
- the borders of things move by about a pixel, and errors grow towards grazing angles, where depth is lost (Nguyen,
  Izadi and Lovell, 3DIMPVT 2012; Handa et al., ICRA 2014 move the pixels before they quantise);
- a shadow beside the left borders, where the projector does not reach;
- windows of pixels share their dots, so errors are correlated: on raw Xtion tables, planes fitted to 21 x 21 pixels
  leave 0.08 px (0.06 … 0.11), correlated by 0.76, 0.40 and 0.03 over 1, 3 and 6 pixels;
- dark and shiny surfaces lose whole regions, not single pixels.

The sizes of shadows, jitter and losses in `StructuredLightNoise` are plausible choices, not measurements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pecgrasp_env.sensor.d435_noise import squared_incidence, stereo_shadow
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics, SensorError
from pecgrasp_env.sensor.surface_losses import lost_regions, smooth_normal

__all__ = ["STRUCTURED_LIGHT", "StructuredLightNoise", "apply_structured_light"]

STRUCTURED_LIGHT: dict[str, CameraIntrinsics] = {
    "640x480": CameraIntrinsics(640, 480, 525.0, 525.0, 320.0, 240.0, 0.4),
    "320x240": CameraIntrinsics(320, 240, 262.5, 262.5, 160.0, 120.0, 0.4),
}
"""The nominal depth cameras, as drivers report them where nobody has calibrated."""


@dataclass(frozen=True)
class StructuredLightNoise:
    """Sizes of the faults, in pixels of an image that is 640 wide; smaller ones are made out of such."""

    baseline: float = 0.075
    """Between projector and camera, metres."""
    subpixel_error: float = 0.08
    """Standard deviation of the disparity, pixels."""
    correlation: float = 2.0
    """Of that error: standard deviation of the Gaussian that smooths it, pixels of the image itself."""
    disparity_step: float = 1 / 8
    """Resolution of the disparity, pixels."""
    depth_unit: float = 0.001
    """Metres; depth is a whole multiple of it."""
    edge_jitter: float = 0.8
    """Standard deviation of the move of borders, pixels, along each axis."""
    grazing_start: float = 1.2
    """Angle between ray and normal from which regions are lost, radians (69 degrees) …"""
    grazing_end: float = 1.48
    """… and from which nothing is measured (85 degrees)."""
    farthest: float = 5.0
    """Metres; beyond, nothing is measured."""
    border: int = 8
    """Columns on the left and on the right where windows are cut off and nothing is measured."""

    def __post_init__(self) -> None:
        for name in ("baseline", "correlation", "disparity_step", "depth_unit", "farthest"):
            if getattr(self, name) <= 0:
                raise SensorError(f"noise.{name} must be positive, got {getattr(self, name)}")
        for name in ("subpixel_error", "edge_jitter", "border"):
            if getattr(self, name) < 0:
                raise SensorError(f"noise.{name} must not be negative, got {getattr(self, name)}")
        if not 0 < self.grazing_start < self.grazing_end <= np.pi / 2:
            raise SensorError(
                f"noise.grazing_start < grazing_end ≤ π/2 wanted, got {self.grazing_start}, {self.grazing_end}"
            )


_DEFAULT_NOISE = StructuredLightNoise()


def apply_structured_light(
    depth: np.ndarray,
    intrinsics: CameraIntrinsics,
    rng: np.random.Generator,
    params: StructuredLightNoise = _DEFAULT_NOISE,
    lost: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """What the camera would measure of a scene whose exact depth is `depth`.

    Args:
        depth: (H, W) metres, 0 or not finite where there is nothing.
        intrinsics: of that image, whole (no `window`).
        rng: draws everything, so one seed gives one frame.
        params: sizes of the faults.
        lost: (H, W), of each surface the share that the camera loses for its darkness or gloss, 0 … 1; None: nothing.

    Returns:
        (H, W) float32 metres, 0 where there is a hole; and (H, W) int, index into the flat image of the pixel whose
        surface each shows now that borders have moved: a mask follows by ``mask.reshape(-1)[source]``.
    """
    height, width = depth.shape
    exact = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    share = np.float32(width / 640)
    source = _jitter((height, width), rng, params.edge_jitter * float(share))
    exact = exact.reshape(-1)[source]
    surface = exact > 0
    scale = np.float32(intrinsics.fx * params.baseline)
    disparity = np.divide(scale, exact, out=np.zeros_like(exact), where=surface)

    # The projector lights more than the image shows: nothing is dark for lying beyond its border.
    hole = ~surface | stereo_shadow(disparity, first_column=width)
    cosine = np.sqrt(squared_incidence(disparity, intrinsics))
    start, end = np.float32(np.cos(params.grazing_start)), np.float32(np.cos(params.grazing_end))
    chance = np.clip((start - cosine) / (start - end), 0, 1)
    if lost is not None:
        chance = np.maximum(chance, lost.reshape(-1)[source])
    hole |= lost_regions(chance, rng)
    border = round(params.border * share)
    hole[:, :border] = hole[:, width - border :] = True

    # Slanted windows match less well.
    error = params.subpixel_error * share / np.maximum(cosine, 0.4)
    disparity = disparity + error.astype(np.float32) * smooth_normal((height, width), rng, params.correlation)
    step = np.float32(params.disparity_step) * share
    disparity = np.rint(disparity / step) * step
    hole |= disparity < step
    measured = np.divide(scale, disparity, out=np.zeros_like(exact), where=~hole)
    unit = np.float32(params.depth_unit)
    measured = np.rint(measured / unit) * unit
    measured[(measured < intrinsics.min_depth) | (measured > params.farthest)] = 0
    return measured, source


def _jitter(shape: tuple[int, int], rng: np.random.Generator, size: float) -> np.ndarray:
    """Flat indices (H, W) of pixels some `size` away, neighbours' alike: borders become ragged, not blurred."""
    rows, columns = np.indices(shape, dtype=np.float32)
    for at, most in ((rows, shape[0] - 1), (columns, shape[1] - 1)):
        at += np.float32(size) * smooth_normal(shape, rng, 1.5)
        np.clip(np.rint(at, out=at), 0, most, out=at)
    return (rows * shape[1] + columns).astype(np.int64)
