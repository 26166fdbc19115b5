"""From a cloud in its view frame and its model to hypotheses of where the model's centre is, and how it is turned.

Several come out, since one side of a thing may fit several poses. CloudPose's own form (Gao et al., ICRA 2020) is an
option: encoder=pointnet, two_branches=true, rotation=axis_angle, hypotheses=1.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

from pec.errors import ConfigError
from pec.pose.encoders import ENCODERS
from pec.pose.rotations import ROTATIONS

__all__ = ["NetworkConfig", "PoseNetwork"]


@dataclass(frozen=True)
class NetworkConfig:
    """n_points: of a cloud. encoder: of `pec.pose.encoders.ENCODERS`. rotation: of `pec.pose.rotations.ROTATIONS`.
    hypotheses: poses that come out of a view. two_branches: a network for the position and one for the rotation, as
    CloudPose, instead of one for both."""

    n_points: int = 64
    encoder: str = "ordered"
    rotation: str = "6d"
    hypotheses: int = 4
    two_branches: bool = False

    def __post_init__(self) -> None:
        for name, known in (("encoder", ENCODERS), ("rotation", ROTATIONS)):
            if getattr(self, name) not in known:
                raise ConfigError(f"network.{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")
        if self.n_points < 16:
            raise ConfigError(f"network.n_points must be 16 at least, got {self.n_points}")
        if self.hypotheses < 1:
            raise ConfigError(f"network.hypotheses must be 1 at least, got {self.hypotheses}")


class PoseNetwork(nn.Module):
    """`PoseNetwork(config, n_models)`; forward takes points in radii of their model."""

    def __init__(self, config: NetworkConfig, n_models: int) -> None:
        super().__init__()
        self.config = config
        encoder, k = ENCODERS[config.encoder], config.hypotheses
        self.frame = encoder.frame
        width, self._to_matrix = ROTATIONS[config.rotation]
        self._sizes = [3 * k, width * k, k]
        outputs = [3 * k, (width + 1) * k] if config.two_branches else [sum(self._sizes)]
        self.encoders = nn.ModuleList(encoder(config.n_points, n_models) for _ in outputs)
        heads = [nn.Linear(encoder.width, n) for n in outputs]
        self.heads = nn.ModuleList(heads)
        with torch.no_grad():  # hypotheses begin all over the rotations, so that each finds its own
            heads[-1].bias[-k * (width + 1) : -k] = torch.randn(k * width)

    def forward(
        self, points: torch.Tensor, sight: torch.Tensor, model: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """points (B, N, 3), view frame, in radii of the model; sight (B, 3), the direction to the cloud, view frame;
        model (B,) int64.

        Returns the model's centre (B, K, 3) in radii and its rotation (B, K, 3, 3), view frame, and how far from the
        truth each is expected to be (B, K), radii, ≥ 0.
        """
        branches = zip(self.encoders, self.heads, strict=True)
        out = torch.cat([head(encoder(points, sight, model)) for encoder, head in branches], dim=1)
        centre, turn, expected = out.split(self._sizes, dim=1)
        rotation = self._to_matrix(turn.unflatten(1, (self.config.hypotheses, -1)))
        return centre.unflatten(1, (-1, 3)), rotation, nn.functional.softplus(expected)
