"""What may happen to a cloud between its generation and the day it is classified, drawn anew each epoch.

Everything works on candidates (B, K, 3), centred, metres, with `valid` (B, K) telling which of them exist.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from pec.errors import ConfigError

__all__ = ["Augment", "augment"]

_LEAST_SUBSET = 64
_MOST_HOLES = 4
_REACH = 6.0  # of a point's neighbourhood, squared, in mean squared distances to the nearest point
_STEEPEST = 10.0  # slope of a surface: beyond, its few points say nothing more


@dataclass(frozen=True)
class Augment:
    """Strengths; all zero does nothing.

    subset: share of the candidates that are kept, the same ones throughout a batch; 1 keeps all. 64 are always kept, so
    that an order that needs every candidate gets them.
    remove: greatest fraction missing around a random point (occlusion, dark or shiny spots).
    crop: greatest fraction missing beyond a random plane (a strip that the segmenter gave to the table).
    holes: greatest fraction missing in one to four patches of unequal size (dark prints, reflections of lamps); small
    fractions are likelier than great ones.
    facing: greatest fraction missing of what faces one way, as a random point's surface does, seen along z, the axis of
    the camera: flanks at grazing incidence, sides that mirror the light away. Small fractions are likelier, too.
    jitter: standard deviation of each coordinate, metres. scale: relative range of the size, ±.
    stretch: relative range of the size along each axis by itself, ±.
    yaw: range of a rotation about the z axis, ± degrees. mirror: probability of mirroring x.
    """

    subset: float = 1.0
    remove: float = 0.0
    crop: float = 0.0
    holes: float = 0.0
    facing: float = 0.0
    jitter: float = 0.0
    scale: float = 0.0
    stretch: float = 0.0
    yaw: float = 0.0
    mirror: float = 0.0

    def __post_init__(self) -> None:
        for name in ("remove", "crop", "holes", "facing", "mirror", "scale", "stretch"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"augment.{name} must be in [0, 1], got {getattr(self, name)}")
        if not 0 < self.subset <= 1:
            raise ConfigError(f"augment.subset must be in (0, 1], got {self.subset}")
        if self.jitter < 0:
            raise ConfigError(f"augment.jitter must not be negative, got {self.jitter}")

    @property
    def is_identity(self) -> bool:
        return self == Augment()


def augment(
    points: torch.Tensor, valid: torch.Tensor, settings: Augment, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Changed `points` (B, K, 3) and `valid` (B, K), K less where a subset is kept; each cloud keeps a point at least.

    All draws come from `generator`, whatever the settings leave unused: equal seeds, equal clouds.
    """
    batch = len(points)
    device = points.device

    def uniform(*shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=generator, device=generator.device).to(device)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=generator, device=generator.device).to(device)

    if settings.subset < 1:
        # The first column is always kept: in it no cloud is padded.
        rest = 1 + torch.rand(points.shape[1] - 1, generator=generator, device=generator.device).argsort().to(device)
        n_kept = max(round(settings.subset * points.shape[1]), _LEAST_SUBSET)
        index = torch.cat([rest.new_zeros(1), rest[: n_kept - 1]]).sort().values
        points, valid = points[:, index], valid[:, index]
    if settings.remove:
        centre = points.gather(1, _some(valid, uniform(*valid.shape), 1)[..., None].expand(-1, -1, 3))
        valid = _without_smallest((points - centre).square().sum(dim=2), valid, settings.remove * uniform(batch))
    if settings.crop:
        direction = torch.nn.functional.normalize(normal(batch, 3), dim=1)
        valid = _without_smallest((points @ direction[..., None])[..., 0], valid, settings.crop * uniform(batch))
    if settings.holes:
        centres = points.gather(1, _some(valid, uniform(*valid.shape), _MOST_HOLES)[..., None].expand(-1, -1, 3))
        # A hole that is a tenth as wide as another is none.
        away = torch.cdist(points, centres) / uniform(batch, 1, _MOST_HOLES).clamp_min(0.1)
        valid = _without_smallest(away.amin(dim=2), valid, settings.holes * uniform(batch).square())
    if settings.facing:
        slopes = _slopes(points, valid)
        one = slopes.gather(1, _some(valid, uniform(*valid.shape), 1)[..., None].expand(-1, -1, 2))
        unlike = (slopes - one).square().sum(dim=2) + 0.05 * normal(*valid.shape).square()
        valid = _without_smallest(unlike, valid, settings.facing * uniform(batch).square())
    if settings.scale:
        points = points * (1 + settings.scale * (2 * uniform(batch, 1, 1) - 1))
    if settings.stretch:
        points = points * (1 + settings.stretch * (2 * uniform(batch, 1, 3) - 1))
    if settings.yaw:
        angle = torch.deg2rad(settings.yaw * (2 * uniform(batch) - 1))
        c, s = angle.cos(), angle.sin()
        x, y, z = points.unbind(dim=2)
        points = torch.stack([c[:, None] * x - s[:, None] * y, s[:, None] * x + c[:, None] * y, z], dim=2)
    if settings.mirror:
        sign = torch.where(uniform(batch) < settings.mirror, -1.0, 1.0)
        points = torch.cat([points[..., :1] * sign[:, None, None], points[..., 1:]], dim=2)
    if settings.jitter:
        points = points + settings.jitter * normal(*points.shape)
    return points, valid


def _without_smallest(value: torch.Tensor, valid: torch.Tensor, fraction: torch.Tensor) -> torch.Tensor:
    """`valid` without the `fraction` (B,) of valid entries whose `value` (B, K) is smallest."""
    rank = value.masked_fill(~valid, torch.inf).argsort(dim=1).argsort(dim=1)
    return valid & (rank >= (fraction * valid.sum(dim=1))[:, None].floor())


def _some(valid: torch.Tensor, chance: torch.Tensor, n: int) -> torch.Tensor:
    """Indices (B, n) of valid points, those of the largest `chance` (B, K); of fewer, some that are not."""
    return chance.masked_fill(~valid, -1.0).topk(n, dim=1).indices


def _slopes(points: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """(B, K, 2): angles, rad, at which the surface about each point rises in z along x and y: of the plane that fits
    its neighbours best, the nearer the more."""
    lengths = points.square().sum(dim=2)
    squared = lengths[:, :, None] + torch.baddbmm(lengths[:, None], points, points.transpose(1, 2), alpha=-2)
    squared = squared.masked_fill_(~valid[:, None], torch.inf)
    squared.diagonal(dim1=1, dim2=2).fill_(torch.inf)
    nearest = squared.amin(dim=2).nan_to_num(posinf=0.0)  # of a single point none
    reach = _REACH * (nearest * valid).sum(dim=1) / valid.sum(dim=1)
    squared.diagonal(dim1=1, dim2=2).fill_(0.0)
    weight = (1 - squared / reach.clamp_min(1e-12)[:, None, None]).clamp_min_(0.0)
    x, y, z = points.unbind(dim=2)
    moments = torch.stack([torch.ones_like(x), x, y, z, x * x, x * y, y * y, x * z, y * z], dim=2)
    total, x, y, z, xx, xy, yy, xz, yz = (weight @ moments).unbind(dim=2)
    total = total.clamp_min(1e-12)
    x, y, z = x / total, y / total, z / total
    xx, xy, yy = xx / total - x * x, xy / total - x * y, yy / total - y * y
    xz, yz = xz / total - x * z, yz / total - y * z
    ridge = 1e-2 * (xx + yy) + 1e-12  # of a surface seen edge-on x and y are one
    xx, yy = xx + ridge, yy + ridge
    rise = torch.stack([yy * xz - xy * yz, xx * yz - xy * xz], dim=2) / (xx * yy - xy * xy)[..., None]
    return rise.clamp(-_STEEPEST, _STEEPEST).atan()
