"""How a network says a rotation: what its last layer gives, as rotation matrices.

axis_angle: the axis times the angle in radians, as CloudPose has it (Gao et al., ICRA 2020). Every rotation by half a
turn has two of them, so what a network learns jumps there. quaternion: the same jump, at none in particular, since q
and −q turn alike. 6d: two columns of the matrix, made orthonormal (Zhou et al., "On the Continuity of Rotation
Representations in Neural Networks", CVPR 2019): no jump.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

__all__ = ["ROTATIONS", "from_6d", "from_axis_angle", "from_quaternion"]

_TINY = 1e-8


def from_axis_angle(vector: torch.Tensor) -> torch.Tensor:
    """(…, 3) radians → (…, 3, 3); Rodrigues' formula, smooth at 0."""
    squared = vector.square().sum(dim=-1)
    # Of a clamped square, since the square root has no slope at 0.
    angle = squared.clamp_min(_TINY).sqrt()
    small = squared < _TINY
    a = torch.where(small, 1 - squared / 6, angle.sin() / angle)[..., None, None]
    b = torch.where(small, 0.5 - squared / 24, (1 - angle.cos()) / angle.square())[..., None, None]
    x, y, z = vector.unbind(dim=-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).unflatten(-1, (3, 3))
    return torch.eye(3, dtype=vector.dtype, device=vector.device) + a * cross + b * (cross @ cross)


def from_quaternion(vector: torch.Tensor) -> torch.Tensor:
    """(…, 4) w, x, y, z of any length but 0 → (…, 3, 3)."""
    w, x, y, z = torch.nn.functional.normalize(vector, dim=-1, eps=_TINY).unbind(dim=-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def from_6d(vector: torch.Tensor) -> torch.Tensor:
    """(…, 6) the first two columns, not parallel → (…, 3, 3) by Gram and Schmidt."""
    first = torch.nn.functional.normalize(vector[..., :3], dim=-1, eps=_TINY)
    second = vector[..., 3:]
    second = second - (first * second).sum(dim=-1, keepdim=True) * first
    second = torch.nn.functional.normalize(second, dim=-1, eps=_TINY)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-1)


ROTATIONS: dict[str, tuple[int, Callable[[torch.Tensor], torch.Tensor]]] = {
    "axis_angle": (3, from_axis_angle),
    "quaternion": (4, from_quaternion),
    "6d": (6, from_6d),
}
"""By name: how many numbers it takes, and what makes matrices of them."""
