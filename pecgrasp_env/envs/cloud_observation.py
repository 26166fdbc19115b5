"""A cloud of a fixed number of points for learning agents, sampled from a depth frame.

Which points are taken is a hash of the episode's seed, the step and the pixel: the same on every device, for every
number of sub-environments, and without a generator's state to carry along.
"""

from __future__ import annotations

import numpy as np
import torch

from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

# What is kept, base frame, m: what stands on the table in front of the robot, and what the camera sees of the hand. The
# tabletop itself would take four points of five.
CLOUD_LOW = (0.10, -0.50, 0.005)
CLOUD_HIGH = (0.95, 0.50, 0.60)
_32_BITS = 0xFFFFFFFF


def sample_cloud(
    depth: torch.Tensor,
    intrinsics: torch.Tensor,
    T_base_camera: torch.Tensor,
    seeds: torch.Tensor,
    steps: torch.Tensor,
    n_points: int,
) -> torch.Tensor:
    """Points (N, n_points, 3) float32, m, in the base frame, in random order.

    Where fewer are seen than asked for they are repeated; where none is seen all are zero.

    Args:
        depth: (N, H, W) m along the optical axis, 0 where nothing was measured; H · W >= n_points.
        intrinsics: (N, 3, 3).
        T_base_camera: (N, 4, 4), OpenCV axes.
        seeds, steps: (N,) integers.
    """
    n, height, width = depth.shape
    device = depth.device
    u = torch.arange(width, device=device) + 0.5
    v = torch.arange(height, device=device) + 0.5
    fx, fy, cx, cy = (intrinsics[:, i, j, None] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    x = ((u - cx) / fx)[:, None] * depth
    y = ((v - cy) / fy)[:, :, None] * depth
    camera = torch.stack([x, y, depth], dim=3).reshape(n, height * width, 3)
    points = camera @ T_base_camera[:, :3, :3].transpose(1, 2) + T_base_camera[:, None, :3, 3]
    low, high = (torch.tensor(limit, device=device) for limit in (CLOUD_LOW, CLOUD_HIGH))
    seen = ((points >= low) & (points <= high)).all(dim=2) & (camera[..., 2] > 0)

    keys = _hash(seeds, steps, height * width).masked_fill(~seen, _32_BITS + 1)
    chosen = torch.topk(keys, n_points, dim=1, largest=False).indices
    count = seen.sum(dim=1, keepdim=True)
    turn = torch.arange(n_points, device=device) % count.clamp(min=1)
    chosen = torch.where(count >= n_points, chosen, chosen.gather(1, turn))
    cloud = points.gather(1, chosen[..., None].expand(-1, -1, 3))
    return torch.where(count[..., None] > 0, cloud, torch.zeros_like(cloud)).float()


def sample_cloud_of_frame(
    depth: np.ndarray, intrinsics: CameraIntrinsics, T_base_camera: np.ndarray, seed: int, step: int, n_points: int
) -> np.ndarray:
    """`sample_cloud` of one depth frame (H, W), m: (n_points, 3) float32, base frame."""
    seen = (depth, intrinsics.matrix, T_base_camera)
    image, K, T = (torch.from_numpy(np.array(each, np.float32))[None] for each in seen)
    return sample_cloud(image, K, T, torch.tensor([seed]), torch.tensor([step]), n_points)[0].numpy()


def _hash(seeds: torch.Tensor, steps: torch.Tensor, n: int) -> torch.Tensor:
    """(N, n) integers below 2^32, as good as random."""
    x = _mix(_mix(seeds.long()) ^ steps.long())[:, None] ^ torch.arange(n, device=seeds.device)
    return _mix(x)


def _mix(x: torch.Tensor) -> torch.Tensor:
    # A bijection of 32-bit words whose every output bit depends on every input bit (xor-shift, multiply; twice).
    x = ((x ^ (x >> 16)) * 0x7FEB352D) & _32_BITS
    x = ((x ^ (x >> 15)) * 0x846CA68B) & _32_BITS
    return x ^ (x >> 16)
