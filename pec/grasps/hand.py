"""What a network is told of the gripper: the volume between its fingers, and points that stand for its shape.

In the grasp frame: origin midway between the pads at the pads' centre, +z the approach, +x the closing direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import torch

from pec.errors import ConfigError

__all__ = ["Hand"]

_ALONG = 4  # points on a finger, and on each half of the palm, of the hand's outline


@dataclass(frozen=True)
class Hand:
    """Metres, the Robotiq 2F-140's: stroke (along x), finger_width (y) and pad_length (z) of the pads; reach: from the
    tips back to the palm."""

    stroke: float = 0.140
    finger_width: float = 0.027
    pad_length: float = 0.065
    reach: float = 0.137

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and 0.0 < value <= 1.0):
                raise ConfigError(f"hand.{field.name} must be more than 0 and at most 1 m, got {value!r}")

    @property
    def low(self) -> torch.Tensor:
        """(3,) float32, m: the least corner of the volume between the open fingers, from the palm to the tips."""
        return torch.tensor([-0.5 * self.stroke, -0.5 * self.finger_width, 0.5 * self.pad_length - self.reach])

    @property
    def high(self) -> torch.Tensor:
        """(3,) float32, m: its greatest corner."""
        return torch.tensor([0.5 * self.stroke, 0.5 * self.finger_width, 0.5 * self.pad_length])

    def outline(self) -> torch.Tensor:
        """(16, 3) float32, m: points on the two open fingers, from the palm to the tips, and along the palm."""
        half, tips, palm = 0.5 * self.stroke, 0.5 * self.pad_length, 0.5 * self.pad_length - self.reach
        down = torch.linspace(palm, tips, _ALONG)
        along = torch.linspace(0.0, half, _ALONG + 1)[:-1]
        finger = torch.stack([torch.full((_ALONG,), half), torch.zeros(_ALONG), down], dim=1)
        beside = torch.stack([along, torch.zeros(_ALONG), torch.full((_ALONG,), palm)], dim=1)
        side = torch.cat([finger, beside])
        return torch.cat([side, side * torch.tensor([-1.0, 1.0, 1.0])])

    def control_points(self) -> torch.Tensor:
        """(5, 3) float32, m: the palm's middle and each finger's root and tip, by which poses are compared."""
        half, tips, palm = 0.5 * self.stroke, 0.5 * self.pad_length, 0.5 * self.pad_length - self.reach
        fingers = [[x, 0.0, z] for x in (-half, half) for z in (palm, tips)]
        return torch.tensor([[0.0, 0.0, palm], *fingers])
