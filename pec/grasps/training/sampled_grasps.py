"""How well grasps that a sampler draws cover those that held."""

from __future__ import annotations

from typing import Any

import torch

from pec.grasps.networks.graspnet_sampler import LATENT, GraspNetSampler
from pec.grasps.training.data import GraspTensors

__all__ = ["coverage"]

_DRAWN = 100  # grasps a scene
_NEAR_M, _NEAR_RAD = 0.02, 0.35


@torch.no_grad()
def coverage(network: GraspNetSampler, grasps: GraspTensors) -> dict[str, Any]:
    """Of 100 grasps drawn on each scene where some held: "covered", the share of those that held with a drawn one
    within 20 mm and 20°, up to a half turn about the approach; "distance_mm", the mean over them of the distance of the
    nearest drawn one's origin; "scenes", "held".
    """
    latents = torch.randn(_DRAWN, LATENT, generator=torch.Generator().manual_seed(0)).to(grasps.points.device)
    covered, distances, scenes = [], [], 0
    for scene in range(len(grasps.instances)):
        truth = grasps.T_world_grasp[(grasps.scene_of == scene) & grasps.held]
        if not len(truth):
            continue
        scenes += 1
        drawn = network.propose(grasps.points[scene], latents)
        apart = torch.cdist(truth[:, :3, 3], drawn[:, :3, 3])
        covered.append(((apart <= _NEAR_M) & (_turn(truth, drawn) <= _NEAR_RAD)).any(dim=1))
        distances.append(apart.amin(dim=1))
    n = sum(map(len, covered))
    return {
        "scenes": scenes,
        "held": n,
        "covered": float(torch.cat(covered).double().mean()) if n else float("nan"),
        "distance_mm": 1e3 * float(torch.cat(distances).double().mean()) if n else float("nan"),
    }


def _turn(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """(A, B) rad between rotations of (A, 4, 4) and (B, 4, 4), the least over a half turn about the approach."""
    along = [one[:, :3, k] @ other[:, :3, k].T for k in range(3)]
    traces = torch.maximum(along[0] + along[1] + along[2], along[2] - along[0] - along[1])
    return (0.5 * (traces - 1.0)).clamp(-1.0, 1.0).arccos()
