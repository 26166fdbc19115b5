"""What the estimator needs of a model, made once when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.pose.look_alikes import look_alikes
from grasping.pose.object_model import ObjectModel
from grasping.pose.point_pairs import PairTable
from grasping.pose.scene_surface import thinner
from grasping.pose.surface_grid import SurfaceGrid

FloatArray = NDArray[np.float64]

STEP = 0.05  # of the diameter: the bins of distances
SPACING = 0.07  # of the diameter: the sample whose pairs vote


@dataclass(frozen=True, eq=False)
class PreparedModel:
    """A model with its pairs, its grid of nearest points, and its corners."""

    model: ObjectModel

    @cached_property
    def table(self) -> PairTable:
        """Pairs of a coarse sample."""
        sample = thinner(self.model.points, self.model.normals, self.sampled)
        return PairTable.of(*sample, STEP * self.model.diameter)

    @cached_property
    def grid(self) -> SurfaceGrid:
        """The nearest point of the surface to any place."""
        return SurfaceGrid.of(self.model.points, self.model.normals, self.model.diameter)

    @cached_property
    def tree(self) -> cKDTree:
        """Of the model's points."""
        return cKDTree(self.model.points)

    @cached_property
    def look_alikes(self) -> FloatArray:
        """(A, 4, 4) motions after which much of the surface lies where some of it was."""
        return look_alikes(self.model, self.grid, self.table, self.corners)

    @property
    def sampled(self) -> float:
        """How far apart the points are that vote, m."""
        return SPACING * self.model.diameter

    @cached_property
    def spacing(self) -> float:
        """How far apart the model's points are, m."""
        return float(np.median(self.tree.query(self.model.points, k=2)[0][:, 1]))

    @cached_property
    def corners(self) -> FloatArray:
        """(8, 3) of the box round the model, object frame, m."""
        ends = np.stack([self.model.points.min(axis=0), self.model.points.max(axis=0)])
        return np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)
