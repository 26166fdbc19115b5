"""The frames in which the pose network sees a cloud: about its mean, and turned to something that the cloud itself has.

sight: the z axis is the line of sight to it. What a camera sees of an object depends on the object's pose as seen along
the line of sight, and not on where in the picture it is; what is left open is the turn about that line.
principal: its principal axes, so that a cloud comes alike however it is turned; what is left open are half turns about
them, four views in all.

Training draws what is left open anew each epoch, labels and all; a view's poses are taken back by its frame.
"""

from __future__ import annotations

import torch

from pec.preprocessing.pose import principal_axes

__all__ = ["N_VIEWS", "principal_frame", "sight_frame"]

N_VIEWS = 4
"""Of a cloud in its principal frame."""


def sight_frame(points: torch.Tensor, angle: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Clouds (B, N, 3) of a camera (OpenCV frame, m) in their view frames, and these as T_camera_view (B, 4, 4).

    The turn is the shortest from the optical axis to the line of sight, for a cloud in front of the camera, and then by
    `angle` (B,) radians about it.
    """
    mean = points.mean(dim=1)
    x, y, z = torch.nn.functional.normalize(mean, dim=1).unbind(dim=1)
    # Rodrigues' formula from (0, 0, 1) to (x, y, z): the sine and cosine are in the vector already.
    k = 1 / (1 + z)
    turn = torch.stack([1 - k * x * x, -k * x * y, x, -k * x * y, 1 - k * y * y, y, -x, -y, z], dim=1)
    first, second, third = turn.unflatten(1, (3, 3)).unbind(dim=2)
    sine, cosine = angle.sin()[:, None], angle.cos()[:, None]
    turn = torch.stack([cosine * first + sine * second, cosine * second - sine * first, third], dim=2)
    return (points - mean[:, None]) @ turn, _pose(turn, mean)


def principal_frame(points: torch.Tensor, view: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """As `sight_frame`, turned to the principal axes in one of the four views (B,) int64 that differ by half turns."""
    valid = torch.ones(points.shape[:2], dtype=torch.bool, device=points.device)
    centred, axes = principal_axes(points, valid, view)
    return centred @ axes, _pose(axes, points.mean(dim=1))


def _pose(rotation: torch.Tensor, position: torch.Tensor) -> torch.Tensor:
    pose = torch.eye(4, dtype=position.dtype, device=position.device).repeat(len(position), 1, 1)
    pose[:, :3, :3], pose[:, :3, 3] = rotation, position
    return pose
