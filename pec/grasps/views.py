"""What the networks are given: an object's points with a grasp, and those of them that are between its fingers."""

from __future__ import annotations

from typing import NamedTuple

import torch

from pec.grasps.hand import Hand

__all__ = ["FEWEST_BETWEEN", "NOTHING", "GraspViews", "between_fingers", "first_of", "in_grasp_frame", "unless_nothing"]

FEWEST_BETWEEN = 8
"""Points between the fingers; with fewer a network that sees only those has nothing to judge by."""

NOTHING = -4.0
"""Its logit then."""


class GraspViews(NamedTuple):
    """B grasps, each with the cloud that it is on.

    points: (B, N, 3) float32, m, in a frame whose z is up. normals: (B, N, 3), either way round; (B, N, 3) of zeros
    where the network does not look at them. T_cloud_grasp: (B, 4, 4).
    """

    points: torch.Tensor
    normals: torch.Tensor
    T_cloud_grasp: torch.Tensor


def in_grasp_frame(points: torch.Tensor, T_cloud_grasp: torch.Tensor) -> torch.Tensor:
    """(B, N, 3) points of the cloud's frame in those of the grasps (B, 4, 4)."""
    return (points - T_cloud_grasp[:, None, :3, 3]) @ T_cloud_grasp[:, :3, :3]


def between_fingers(local: torch.Tensor, hand: Hand) -> torch.Tensor:
    """(B, N) bool: which of the points (B, N, 3), grasp frames, lie between the open fingers, from palm to tips."""
    return ((local >= hand.low.to(local)) & (local <= hand.high.to(local))).all(dim=2)


def first_of(local: torch.Tensor, inside: torch.Tensor, n: int) -> torch.Tensor:
    """(B, n, 3): the first n of the points (B, N, 3) that are inside (B, N), some twice where there are fewer.

    Where there is none, zeros.
    """
    order = inside.to(torch.uint8).argsort(dim=1, descending=True, stable=True)
    there = inside.sum(dim=1, keepdim=True)
    index = order.gather(1, torch.arange(n, device=local.device)[None] % there.clamp(1, n))
    taken = local.gather(1, index[..., None].expand(-1, -1, 3))
    return torch.where(there[..., None] > 0, taken, torch.zeros_like(taken))


def unless_nothing(logits: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Logits (B,), but NOTHING of the grasps with hardly a point inside (B, N)."""
    return torch.where(inside.sum(dim=1) >= FEWEST_BETWEEN, logits, torch.full_like(logits, NOTHING))
