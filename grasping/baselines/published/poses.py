"""Poses of the dissertation's planner, of all its regions at once: their own axes, hands and widths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Parts:
    """R parts of a cloud: their points one after the other, m, their means (R, 3) and offsets (M, 3) from those."""

    def __init__(self, parts: Sequence[FloatArray]) -> None:
        self.points = np.concatenate(parts)
        self.sizes: IntArray = np.array([len(part) for part in parts])
        self.starts: IntArray = np.concatenate([[0], np.cumsum(self.sizes)[:-1]])
        self.means: FloatArray = np.add.reduceat(self.points, self.starts) / self.sizes[:, None]
        self.offsets: FloatArray = self.points - self.spread(self.means)

    def spread(self, values: FloatArray) -> FloatArray:
        """(R, …) → (M, …): the value of its part for each point."""
        return np.repeat(values, self.sizes, axis=0)

    def total(self, values: FloatArray) -> FloatArray:
        """(M, …) → (R, …) sums."""
        return np.add.reduceat(values, self.starts)

    def along(self, rotations: FloatArray) -> FloatArray:
        """Offsets (M, 3) along the columns of their parts' (R, 3, 3)."""
        return (self.offsets[:, None, :] @ self.spread(rotations))[:, 0]


@dataclass(frozen=True)
class GraspPoses:
    """Poses (R, 4, 4) and widths (R,), m."""

    poses: FloatArray
    widths: FloatArray


def own_axes(parts: Parts, axes: FloatArray) -> FloatArray:
    """PCA of each part, named after the object's `axes`: right-handed (R, 3, 3), columns nearest to its x, y, z."""
    offsets = parts.offsets
    _, own = np.linalg.eigh(parts.total(offsets[:, :, None] * offsets[:, None, :]))
    skew = parts.total(parts.along(own) ** 3)
    own = own * np.where(skew < 0.0, -1.0, 1.0)[:, None, :]
    likeness = axes.T @ own  # (R, object's axis, own axis)
    part = np.arange(len(own))
    y = np.abs(likeness[:, 1]).argmax(axis=1)
    sideways = np.abs(likeness[:, 0])
    sideways[part, y] = -1.0
    x = sideways.argmax(axis=1)
    long = own[part, :, y] * np.where(likeness[part, 1, y] < 0.0, -1.0, 1.0)[:, None]
    across = own[part, :, x] * np.where(likeness[part, 0, x] < 0.0, -1.0, 1.0)[:, None]
    return np.stack([across, long, np.cross(across, long)], axis=2)


def grasp_poses(parts: Parts, axes: FloatArray, up: FloatArray | None, *, midway: bool) -> GraspPoses:
    """Hold parts with axes (R, 3, 3) at their means or `midway` between their sides; rules: `PublishedPlanner`."""
    rotations = _hands(parts, axes, up)
    x = parts.along(rotations)[:, 0]
    low, high = np.minimum.reduceat(x, parts.starts), np.maximum.reduceat(x, parts.starts)
    poses = np.zeros((len(rotations), 4, 4))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = parts.means
    poses[:, 3, 3] = 1.0
    if midway:
        poses[:, :3, 3] += (0.5 * (low + high))[:, None] * rotations[:, :, 0]
    return GraspPoses(poses, high - low)


def _hands(parts: Parts, axes: FloatArray, up: FloatArray | None) -> FloatArray:
    """Grasp frames (R, 3, 3)."""
    if up is None:
        closing, approach = axes[:, :, 0], axes[:, :, 2]
        # Away from whoever saw the points: what is farther out across the axis lies farther behind along it.
        depth = (parts.offsets * parts.spread(approach)).sum(axis=1)
        outward = (parts.offsets * parts.offsets).sum(axis=1) - depth * depth
        approach = approach * np.where(parts.total(depth * outward) < 0.0, -1.0, 1.0)[:, None]
    else:
        upright = np.abs(up @ axes)  # (R, own axis)
        by_x = upright[:, 0] <= np.maximum(upright[:, 2], 0.7)
        closing = np.where(by_x[:, None], axes[:, :, 0], axes[:, :, 2])
        closing = closing - (closing @ up)[:, None] * up
        closing /= np.linalg.norm(closing, axis=1)[:, None]
        approach = np.broadcast_to(-up, closing.shape)
    return np.stack([closing, np.cross(approach, closing), approach], axis=2)
