"""What the sensor makes of an exact depth image: `apply_ideal` keeps it, `apply_d435` gives it a real D435's faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pecgrasp_env.sensor.intrinsics import BASELINE, CameraIntrinsics, SensorError

__all__ = ["SENSOR_MODES", "D435Noise", "SensorMode", "apply_d435", "apply_ideal"]

SensorMode = Literal["ideal", "d435"]
SENSOR_MODES: tuple[SensorMode, ...] = ("ideal", "d435")


def apply_ideal(depth: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """The perfect sensor: (H, W) float32 depth, exact, with holes (0) below the minimum depth only."""
    return np.where(depth >= intrinsics.min_depth, depth, 0).astype(np.float32)


@dataclass(frozen=True)
class D435Noise:
    """Sizes of the D435's faults.

    `subpixel_error` lies in the range that is known of the device (0.05 to 0.1 pixels); the numbers for edges, grazing
    surfaces and patches are plausible assumptions, not measurements.
    """

    subpixel_error: float = 0.08
    """Standard deviation of the disparity, pixels: depth RMS = z² · subpixel_error / (fx · BASELINE)."""
    disparity_step: float = 1 / 32
    """The stereo processor's resolution of disparity, pixels."""
    depth_unit: float = 0.001
    """Metres; depth is a whole multiple of it."""
    edge_step: float = 1.0
    """Two neighbours whose disparities differ by more than this many pixels have an edge between them."""
    edge_hole: float = 0.35
    """Probability that a pixel at an edge is a hole."""
    edge_flying: float = 0.15
    """Probability that a pixel at an edge between two surfaces lies in the air between them."""
    grazing_start: float = 1.22
    """Angle, radians, between ray and surface normal from which holes begin (70 degrees) …"""
    grazing_end: float = 1.48
    """… and from which nothing is measured (85 degrees); the probability is linear in the cosine between them."""
    patch_density: float = 8.0
    """Missing patches per steradian of measured surface, on average."""
    patch_radius: tuple[float, float] = (0.008, 0.03)
    """Smallest and largest radius of a missing patch, radians as seen from the camera."""

    def __post_init__(self) -> None:
        for name in ("disparity_step", "depth_unit", "edge_step"):
            if getattr(self, name) <= 0:
                raise SensorError(f"noise.{name} must be positive, got {getattr(self, name)}")
        for name in ("subpixel_error", "patch_density"):
            if getattr(self, name) < 0:
                raise SensorError(f"noise.{name} must not be negative, got {getattr(self, name)}")
        if self.edge_hole < 0 or self.edge_flying < 0 or self.edge_hole + self.edge_flying > 1:
            raise SensorError(
                f"noise.edge_hole and edge_flying are probabilities, got {self.edge_hole}, {self.edge_flying}"
            )
        if not 0 < self.grazing_start < self.grazing_end <= np.pi / 2:
            raise SensorError(
                f"noise.grazing_start < grazing_end ≤ π/2 wanted, got {self.grazing_start}, {self.grazing_end}"
            )
        if not 0 < self.patch_radius[0] <= self.patch_radius[1]:
            raise SensorError(f"noise.patch_radius must be (smallest, largest) and positive, got {self.patch_radius}")


_DEFAULT_NOISE = D435Noise()


def apply_d435(
    depth: np.ndarray,
    intrinsics: CameraIntrinsics,
    rng: np.random.Generator,
    params: D435Noise = _DEFAULT_NOISE,
) -> np.ndarray:
    """What a D435 would measure of a scene whose exact depth is `depth`.

    Args: depth (H, W) metres, 0 or not finite where there is nothing; intrinsics of that image (a `window` is fine);
    rng draws everything, so one seed gives one frame. Returns (H, W) float32 metres, 0 where there is a hole.

    In this order: the stereo shadow, i.e. what the right imager cannot see; edges (holes, flying pixels); grazing
    surfaces; missing patches; sub-pixel error of the disparity, correlated over about three pixels as block matching
    makes it; resolution of the disparity; depth in millimetres; the minimum depth.
    """
    depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    surface = depth > 0
    scale = np.float32(intrinsics.fx * BASELINE)
    disparity = np.divide(scale, depth, out=np.zeros_like(depth), where=surface)

    hole = ~surface | (depth < intrinsics.min_depth) | stereo_shadow(disparity, intrinsics.first_column)
    flat = disparity.copy()
    steps = np.diff(disparity, axis=0), np.diff(disparity, axis=1)
    _break_edges(flat, hole, disparity, steps, rng, params)
    _drop_grazing(hole, disparity, steps, intrinsics, rng, params)
    _drop_patches(hole, intrinsics, rng, params)

    flat += np.float32(params.subpixel_error) * correlated_normal(depth.shape, rng)
    step = np.float32(params.disparity_step)
    flat = np.rint(flat / step) * step
    hole |= flat < step  # the noise pushed it beyond what the disparity can express
    measured = np.divide(scale, flat, out=np.zeros_like(depth), where=~hole)
    unit = np.float32(params.depth_unit)
    measured = np.rint(measured / unit) * unit
    measured[measured < intrinsics.min_depth] = 0
    return measured


def stereo_shadow(disparity: np.ndarray, first_column: int = 0) -> np.ndarray:
    """Pixels of the left image whose surface the right imager does not see.

    disparity (H, W) float32 pixels, 0 where there is no surface. Returns (H, W) bool: surfaces that lie outside the
    right image, or behind a nearer surface there. Beside the left border of an object this is a band of
    fx · BASELINE · (1 / z_object − 1 / z_background) pixels.
    """
    height, width = disparity.shape
    surface = disparity > 0
    # Relative to the window, whose surfaces land left of it: pad by the largest disparity, and by one for `covered`.
    right = (
        np.arange(width, dtype=np.float32) + np.float32(0.5) - disparity
    )  # the column where the right imager sees it
    pad = int(disparity.max(initial=0.0)) + 2
    stride = width + pad + 1
    at = (right + pad).astype(np.int32)
    at += (np.arange(height, dtype=np.int32) * stride)[:, None]
    # Of two pixels on one row that meet in a bin the one farther right in the left image has the larger disparity, and
    # pixels without surface (disparity 0) come before both. Rows are written from left to right and the last write
    # stands, so each bin keeps its nearest surface: a z-buffer without sorting.
    nearest = np.zeros(height * stride, np.float32)
    nearest[at] = disparity
    covered = np.zeros_like(nearest)
    covered[1:][at] = disparity  # a surface that slopes away spreads over more bins than it has pixels: close the gaps
    np.maximum(nearest, covered, out=nearest)
    shadow = nearest.take(at) > disparity + np.float32(1.0)
    shadow |= right < -first_column  # outside the right image
    return shadow & surface


def correlated_normal(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """(H, W) float32 of standard normal values that are correlated over about three pixels in each direction."""
    height, width = shape
    coarse = rng.standard_normal((height // 2 + 3, width // 2 + 3), np.float32)
    # Twice as fine by bilinear interpolation: weights 3/4 and 1/4 along each axis at every pixel, so the variance is
    # (9/16 + 1/16)² everywhere and dividing by 5/8 brings it back to one.
    for _ in range(2):
        near, before, after = 0.75 * coarse[1:-1], coarse[:-2], coarse[2:]
        fine = np.empty((2 * len(near), coarse.shape[1]), np.float32)
        fine[0::2] = near + 0.25 * before
        fine[1::2] = near + 0.25 * after
        coarse = fine.T
    return coarse[:height, :width] / np.float32(0.625)


Steps = tuple[np.ndarray, np.ndarray]
"""Differences of neighbours, (H - 1, W) down the rows and (H, W - 1) along them."""


def _break_edges(
    flat: np.ndarray,
    hole: np.ndarray,
    disparity: np.ndarray,
    steps: Steps,
    rng: np.random.Generator,
    params: D435Noise,
) -> None:
    """Marks holes and moves flying pixels, in place, where neighbouring disparities jump."""
    jumps = [np.abs(step) > params.edge_step for step in steps]
    at_edge = np.zeros(disparity.shape, bool)
    at_edge[:-1] |= jumps[0]
    at_edge[1:] |= jumps[0]
    at_edge[:, :-1] |= jumps[1]
    at_edge[:, 1:] |= jumps[1]
    edge = np.flatnonzero(at_edge & ~hole)
    height, width = disparity.shape
    row, column = np.divmod(edge, width)
    # Beyond the image's border a pixel is its own neighbour.
    around = np.stack(
        [
            disparity[np.maximum(row - 1, 0), column],
            disparity[np.minimum(row + 1, height - 1), column],
            disparity[row, np.maximum(column - 1, 0)],
            disparity[row, np.minimum(column + 1, width - 1)],
        ]
    )
    here = disparity.reshape(-1)[edge]
    high, low = np.maximum(around.max(axis=0), here), np.minimum(around.min(axis=0), here)
    other = np.where(high - here > here - low, high, low)
    fate, share = rng.random(len(edge), np.float32), rng.random(len(edge), np.float32)
    hole.reshape(-1)[edge] |= fate < params.edge_hole
    # Where the other side is empty there is nothing to mix with.
    flying = (fate > 1 - params.edge_flying) & (other > 0)
    flat.reshape(-1)[edge[flying]] += (share * (other - here))[flying]


def _drop_grazing(
    hole: np.ndarray,
    disparity: np.ndarray,
    steps: Steps,
    intrinsics: CameraIntrinsics,
    rng: np.random.Generator,
    params: D435Noise,
) -> None:
    """Marks holes, in place, where the surface is seen at a grazing angle."""
    squared_cosine = squared_incidence(disparity, intrinsics, steps)
    start, end = np.cos(params.grazing_start), np.cos(params.grazing_end)
    grazing = np.flatnonzero((squared_cosine < start**2) & ~hole)
    cosine = np.sqrt(squared_cosine.ravel()[grazing])
    hole.reshape(-1)[grazing] = rng.random(len(grazing), np.float32) < (start - cosine) / (start - end)


def squared_incidence(disparity: np.ndarray, intrinsics: CameraIntrinsics, steps: Steps | None = None) -> np.ndarray:
    """(H, W) float32: squared cosine of the angle between each pixel's ray and its surface's normal.

    Disparity (H, W), of any baseline, is linear in the pixel over a plane, so its slopes give the plane's normal
    exactly: with q = a·x + b·y + c over the normalised coordinates x, y the normal n is (a, b, c), and its cosine to
    the ray (x, y, 1) is q / (|n| |ray|). steps: differences of neighbours, where they are at hand.
    """
    steps = (np.diff(disparity, axis=0), np.diff(disparity, axis=1)) if steps is None else steps
    height, width = disparity.shape
    x = (np.arange(width, dtype=np.float32) + np.float32(0.5 - intrinsics.cx)) / np.float32(intrinsics.fx)
    y = (np.arange(height, dtype=np.float32) + np.float32(0.5 - intrinsics.cy)) / np.float32(intrinsics.fy)
    y = y[:, None]
    a = _gentler_slope(steps[1], 1) * np.float32(intrinsics.fx)
    b = _gentler_slope(steps[0], 0) * np.float32(intrinsics.fy)
    c = disparity - a * x - b * y
    return disparity * disparity / np.maximum((a * a + b * b + c * c) * (x * x + y * y + 1), 1e-12)


def _gentler_slope(step: np.ndarray, axis: int) -> np.ndarray:
    """(H, W): of the steps to both neighbours along an axis the smaller: an edge beside a surface is no slope of it.

    step: the differences along that axis; at the image's borders there is but one.
    """
    every: tuple[slice, ...] = (slice(None),) * axis
    first, last, inner = (*every, slice(None, -1)), (*every, slice(1, None)), (*every, slice(1, -1))
    steepness = np.abs(step)
    gentler = np.empty([size + (along == axis) for along, size in enumerate(step.shape)], step.dtype)
    gentler[inner] = np.where(steepness[first] < steepness[last], step[first], step[last])
    for border in (slice(0, 1), slice(-1, None)):
        at = (*every, border)
        gentler[at] = step[at]
    return gentler


def _drop_patches(hole: np.ndarray, intrinsics: CameraIntrinsics, rng: np.random.Generator, params: D435Noise) -> None:
    """Cuts ellipses, in place, around random measured pixels: what matching lost to gloss, darkness or sameness."""
    measured = np.flatnonzero(~hole)
    steradians = len(measured) / (intrinsics.fx * intrinsics.fy)
    width = hole.shape[1]
    for _ in range(rng.poisson(params.patch_density * steradians)):
        row, column = divmod(int(measured[rng.integers(len(measured))]), width)
        radii = rng.uniform(*params.patch_radius, size=2) * intrinsics.fx
        top, left = max(row - int(radii[0]) - 1, 0), max(column - int(radii[1]) - 1, 0)
        area = hole[top : row + int(radii[0]) + 2, left : column + int(radii[1]) + 2]
        v = (np.arange(area.shape[0]) + (top - row)) / radii[0]
        u = (np.arange(area.shape[1]) + (left - column)) / radii[1]
        area |= v[:, None] ** 2 + u**2 < 1
