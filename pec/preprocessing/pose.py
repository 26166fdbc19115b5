"""A canonical pose for a cloud of unknown orientation: its principal axes, with signs from third moments."""

from __future__ import annotations

import torch

__all__ = ["FLIPS", "principal_axes", "principal_pose"]

# The proper rotations that only flip axes: what is left open where the third moments do not settle the signs.
FLIPS = ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0))


def principal_pose(points: torch.Tensor, valid: torch.Tensor, view: torch.Tensor | None = None) -> torch.Tensor:
    """`points` (B, K, 3) centred and turned to their principal axes, largest spread along x, smallest along z.

    Only `valid` (B, K) points count. x and y point to the side of the heavier tail (third moment ≥ 0), z completes a
    right-handed frame. `view` (B,) in 0..3 picks one of the four frames that differ by half turns; 0 where not given.
    """
    centred, axes = principal_axes(points, valid, view)
    return centred @ axes


def principal_axes(
    points: torch.Tensor, valid: torch.Tensor, view: torch.Tensor | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """The centred points (B, K, 3) and, as columns of (B, 3, 3), the axes that `principal_pose` turns them to."""
    weight = valid.to(points.dtype)[..., None]
    weight = weight / weight.sum(dim=1, keepdim=True)
    centred = points - (points * weight).sum(dim=1, keepdim=True)
    covariance = (centred * weight).transpose(1, 2) @ centred
    # In double on the CPU: 3 × 3 matrices are too small for a GPU, and nearly equal axes must not depend on rounding.
    axes = torch.linalg.eigh(covariance.double().cpu()).eigenvectors.flip(2).to(points)
    skew = ((centred @ axes).pow(3) * weight).sum(dim=1)
    sign = torch.where(skew < 0, -1.0, 1.0).to(points)
    handedness = torch.linalg.det(axes) * sign[:, 0] * sign[:, 1]
    sign = torch.stack([sign[:, 0], sign[:, 1], handedness.sign()], dim=1)
    if view is not None:
        sign = sign * torch.tensor(FLIPS).to(points)[view]
    return centred, axes * sign[:, None]
