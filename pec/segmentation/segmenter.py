"""The use of a trained network: the points of a table in, a class for each of them out."""

from __future__ import annotations

import os

import numpy as np
import torch

from pec.common.threads import torch_threads
from pec.errors import CloudError
from pec.preprocessing.preprocess import check_cloud
from pec.segmentation.checkpoint import PointCheckpoint, read_point_checkpoint
from pec.segmentation.scores import predicted

__all__ = ["FEWEST_POINTS", "PointSegmenter", "centred", "drawn_points"]

FEWEST_POINTS = 64
"""Of a table's cloud."""


class PointSegmenter:
    """Gives every point of a table's cloud a class: `PointSegmenter.load(directory).label(points)`."""

    def __init__(self, checkpoint: PointCheckpoint, n_points: int | None = None, seed: int = 0) -> None:
        """n_points: that the network sees of a cloud; None: as many as in training. seed: of their draw."""
        self._checkpoint, self._seed = checkpoint, seed
        self.n_points = checkpoint.n_points if n_points is None else n_points

    @classmethod
    def load(cls, directory: str | os.PathLike[str], n_points: int | None = None, seed: int = 0) -> PointSegmenter:
        """Raises CheckpointError where the checkpoint is missing, broken or of another kind."""
        return cls(read_point_checkpoint(directory), n_points, seed)

    @property
    def classes(self) -> list[str]:
        """By number; the last is what is none of the others."""
        return list(self._checkpoint.classes)

    def label(self, points: np.ndarray) -> np.ndarray:
        """(N,) int64 into `classes`, of points (N, 3): what stands on a table, m, z up from the table's plane.

        The network sees `n_points` of them, drawn by chance, some twice where there are fewer; each other point gets
        the class of the nearest of those. Raises CloudError where they are not finite (N, 3) with N ≥ 64.
        """
        from scipy.spatial import cKDTree  # slow to import, and training does without

        points = check_cloud(points, FEWEST_POINTS)
        if not (finite := np.isfinite(points).all(axis=1)).all():
            raise CloudError(f"{np.count_nonzero(~finite)} of {len(points)} points are not finite; drop them first")
        cloud = drawn_points(points, self.n_points, np.random.default_rng(self._seed))
        with torch_threads(1):
            said = predicted(self._checkpoint.network, torch.from_numpy(centred(points[cloud]))[None])[0].numpy()
        return said[cKDTree(points[cloud]).query(points)[1]].astype(np.int64)


def drawn_points(points: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Indices (n,) of points (N, 3) in random order; where there are fewer than n they repeat from the first on."""
    return rng.permutation(len(points))[np.arange(n) % len(points)]


def centred(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) as float32 with x and y about their mean; z stays the height above the table."""
    mean = points.mean(axis=0, dtype=np.float64) * (1.0, 1.0, 0.0)
    return (points - mean).astype(np.float32)
