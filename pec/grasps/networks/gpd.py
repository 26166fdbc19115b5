"""GPD: pictures of what is between the fingers, along the hand's three axes, through a small convolutional network.

Source: ten Pas, Gualtieri, Saenko, Platt, "Grasp Pose Detection in Point Clouds", IJRR 2017: 60 × 60 pixels; for each
of three orthogonal projections an averaged height map of the points and their averaged normals, three channels, so 12
in all (its other form has three more, of what the camera did not see, and 15); LeNet: convolutions of 20 and 50 maps,
5 × 5, each followed by pooling 2 × 2, and dense layers of 500 and 2.

Left open or other here: one logit stands for two classes; normals come either way round, so their components' absolute
values count; pooling takes the maximum, and ReLU follows each layer but the last; 32 pixels by default, 12 channels.

At 60 pixels: 3.63 M parameters, 36.8 M multiply-adds; at 32 pixels: 0.66 M, 7.8 M.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.errors import ConfigError
from pec.grasps.hand import Hand
from pec.grasps.views import GraspViews, between_fingers, in_grasp_frame, unless_nothing

__all__ = ["GPD", "projected_images"]

CHANNELS = 12
_SMALLEST_IMAGE = 16  # pixels that the two convolutions leave something of


class GPD(nn.Module):
    """LeNet on `image_size` × `image_size` pixels of 12 channels."""

    uses_normals = True

    def __init__(self, hand: Hand, image_size: int = 32) -> None:
        super().__init__()
        if image_size < _SMALLEST_IMAGE:
            raise ConfigError(f"network.image_size must be {_SMALLEST_IMAGE} at least, got {image_size}")
        self.hand, self.image_size = hand, image_size
        left = ((image_size - 4) // 2 - 4) // 2
        self.images = nn.Sequential(
            nn.Conv2d(CHANNELS, 20, 5), nn.MaxPool2d(2), nn.ReLU(), nn.Conv2d(20, 50, 5), nn.MaxPool2d(2), nn.ReLU()
        )
        self.dense = nn.Sequential(nn.Linear(50 * left * left, 500), nn.ReLU(), nn.Linear(500, 1))

    def forward(self, views: GraspViews) -> torch.Tensor:
        """B views → (B,) logits of being held."""
        local = in_grasp_frame(views.points, views.T_cloud_grasp)
        normals = views.normals @ views.T_cloud_grasp[:, :3, :3]
        inside = between_fingers(local, self.hand)
        images = projected_images(local, normals, inside, self.hand, self.image_size)
        return unless_nothing(self.dense(self.images(images).flatten(1))[:, 0], inside)


def projected_images(
    local: torch.Tensor, normals: torch.Tensor, inside: torch.Tensor, hand: Hand, size: int
) -> torch.Tensor:
    """(B, 12, size, size) float32, 0 where no point falls; each pixel holds means over its points.

    local, normals (B, N, 3), grasp frames; inside (B, N). Along each of z, y and x, in this order: the height in the
    volume between the fingers, over 0 to 1, and the normals' components, without signs.
    """
    b = len(local)
    low, high = hand.low.to(local), hand.high.to(local)
    place = ((local - low) / (high - low)).clamp(0.0, 1.0)
    pixel = (place * size).long().clamp_max(size - 1)
    # What is outside goes to a pixel of its own, the last, which is cut off.
    grasp = torch.arange(b, device=local.device)[:, None] * (size * size)
    images = []
    for along, row, column in ((2, 0, 1), (1, 0, 2), (0, 1, 2)):
        index = grasp + pixel[..., row] * size + pixel[..., column]
        index = torch.where(inside, index, b * size * size).flatten()
        values = torch.cat([torch.ones_like(place[..., :1]), place[..., along, None], normals.abs()], dim=2)
        sums = local.new_zeros(b * size * size + 1, 5).index_add_(0, index, values.flatten(0, 1))[:-1]
        images.append((sums[:, 1:] / sums[:, :1].clamp_min(1.0)).view(b, size, size, 4))
    return torch.cat(images, dim=3).permute(0, 3, 1, 2).contiguous()
