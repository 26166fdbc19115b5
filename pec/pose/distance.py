"""How far a pose is from the truth, as the model's points have it, by the nearest of the poses that look alike.

In training: the root mean square over the model's points of |T̂ x − T S x|, least over its symmetries S. With the mean c
of the points and their second moments M it is exact without any: |T̂ c − T S c|² + tr((R̂ − R_S) M (R̂ − R_S)ᵀ).

For figures: ADD, the mean of |T̂ x − T x| (Hinterstoisser et al., ACCV 2012), and ADD-S, the mean distance of each
point T x from the nearest of all T̂ x (Xiang et al., "PoseCNN", RSS 2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from pec.pose.models import PoseModels

__all__ = ["PoseDistance", "add", "add_s"]


@dataclass(frozen=True)
class PoseDistance:
    """centres (C, 3), radii (C,), moments (C, 3, 3) in squared radii, trace 1; symmetries (C, S, 4, 4), repeated where
    a model has fewer than S. All float32, metres."""

    centres: torch.Tensor
    radii: torch.Tensor
    moments: torch.Tensor
    symmetries: torch.Tensor

    @classmethod
    def of(cls, models: PoseModels, device: torch.device | str = "cpu") -> PoseDistance:
        most = max(map(len, models.symmetries))
        padded = np.stack([each[np.arange(most) % len(each)] for each in models.symmetries])
        moments = models.moments / models.radii[:, None, None] ** 2

        def tensor(values: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(np.asarray(values, np.float32)).to(device)

        return cls(tensor(models.centres), tensor(models.radii), tensor(moments), tensor(padded))

    def __call__(
        self, centre: torch.Tensor, rotation: torch.Tensor, truth: torch.Tensor, model: torch.Tensor
    ) -> torch.Tensor:
        """(B, K) in radii of the model.

        centre (B, K, 3): where each pose puts the model's centre, m. rotation (B, K, 3, 3). truth (B, 4, 4), in the
        same frame. model (B,) int64.
        """
        c, moments, radius = self.centres[model], self.moments[model], self.radii[model]
        alike = truth[:, None] @ self.symmetries[model]
        centres = (alike[..., :3, :3] @ c[:, None, :, None])[..., 0] + alike[..., :3, 3]
        shift = (centre[:, :, None] - centres[:, None]) / radius[:, None, None, None]
        # tr((R̂ − R) M (R̂ − R)ᵀ) = 2 tr M − 2 ⟨R̂ M, R⟩, to find the nearest of many cheaply …
        turned = (rotation @ moments[:, None]).flatten(2)
        nearest = (shift.square().sum(dim=3) - 2 * turned @ alike[..., :3, :3].flatten(2).transpose(1, 2)).argmin(dim=2)
        # … and as it stands for that one, where the difference of large numbers would cost digits near 0.
        row = torch.arange(len(model), device=model.device)[:, None]
        gap = rotation - alike[row, nearest][..., :3, :3]
        squared = shift.gather(2, nearest[..., None, None].expand(-1, -1, 1, 3))[:, :, 0].square().sum(dim=2)
        squared = squared + (gap * (gap @ moments[:, None])).sum(dim=(2, 3))
        return squared.clamp_min(1e-12).sqrt()


def add(pose: np.ndarray, truth: np.ndarray, points: np.ndarray, symmetries: np.ndarray) -> float:
    """ADD, m: the mean of |T̂ x − T S x| over points (P, 3), least over symmetries (S, 4, 4); poses (4, 4)."""
    estimated = points @ pose[:3, :3].T + pose[:3, 3]
    alike = truth @ symmetries
    there = points @ alike[:, :3, :3].transpose(0, 2, 1) + alike[:, None, :3, 3]
    return float(np.linalg.norm(there - estimated, axis=2).mean(axis=1).min())


def add_s(pose: np.ndarray, truth: np.ndarray, points: np.ndarray) -> float:
    """ADD-S, m: the mean distance of a point (P, 3) of the true pose (4, 4) from the nearest of the estimated one."""
    estimated, there = (torch.from_numpy(points @ each[:3, :3].T + each[:3, 3]) for each in (pose, truth))
    return float(torch.cdist(there.double(), estimated.double()).amin(dim=1).mean())
