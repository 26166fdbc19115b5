"""What may happen to a cloud between its generation and the day it is classified, drawn anew each epoch.

Everything works on candidates (B, K, 3), centred, metres, with `valid` (B, K) telling which of them exist.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from pec.errors import ConfigError

__all__ = ["Augment", "augment"]

_LEAST_SUBSET = 64


@dataclass(frozen=True)
class Augment:
    """Strengths; all zero does nothing.

    subset: share of the candidates that are kept, the same ones throughout a batch; 1 keeps all. 64 are always kept, so
    that an order that needs every candidate gets them.
    remove: greatest fraction missing around a random point (occlusion, dark or shiny spots).
    crop: greatest fraction missing beyond a random plane (a strip that the segmenter gave to the table).
    jitter: standard deviation of each coordinate, metres. scale: relative range of the size, ±.
    stretch: relative range of the size along each axis by itself, ±.
    yaw: range of a rotation about the z axis, ± degrees. mirror: probability of mirroring x.
    """

    subset: float = 1.0
    remove: float = 0.0
    crop: float = 0.0
    jitter: float = 0.0
    scale: float = 0.0
    stretch: float = 0.0
    yaw: float = 0.0
    mirror: float = 0.0

    def __post_init__(self) -> None:
        for name in ("remove", "crop", "mirror", "scale", "stretch"):
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
        centre_score = uniform(*valid.shape).masked_fill(~valid, -1.0)
        centre = points[torch.arange(batch, device=device), centre_score.argmax(dim=1), None]
        valid = _without_smallest((points - centre).square().sum(dim=2), valid, settings.remove * uniform(batch))
    if settings.crop:
        direction = torch.nn.functional.normalize(normal(batch, 3), dim=1)
        valid = _without_smallest((points @ direction[..., None])[..., 0], valid, settings.crop * uniform(batch))
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
