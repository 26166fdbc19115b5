"""Where a known object lies, how well the cloud bears it out, and what the view leaves open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.pose.object_model import ObjectModel
from grasping.pose.symmetry import Symmetry

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ambiguity:
    """What no cloud, or not this one, can tell; it is true where there is any of it.

    symmetry: the shape's own turns. others: (A, 4, 4) T_camera_object, poses that are none of these turns and fit the
    cloud as well, as those of a mug whose handle is hidden do. models: names of models that do.
    """

    symmetry: Symmetry
    others: FloatArray
    models: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return not self.symmetry.is_trivial or len(self.others) > 0 or len(self.models) > 0

    def __str__(self) -> str:
        parts = []
        if self.symmetry.ball is not None:
            parts.append("any turn about its centre")
        elif self.symmetry.axis is not None:
            parts.append("any turn about its axis")
        if len(self.symmetry.turns) > 1:
            parts.append(f"{len(self.symmetry.turns) - 1} turn(s) onto itself")
        if len(self.others):
            parts.append(f"{len(self.others)} other pose(s) that this view does not tell from it")
        if self.models:
            parts.append(f"it may be {' or '.join(self.models)}")
        return "; ".join(parts) or "nothing"


@dataclass(frozen=True, eq=False)
class ObjectPose:
    """A known object in the cloud, whose frame is called the camera's here, whatever it is.

    T_camera_object: (4, 4), object frame → the cloud's. inlier_share: of the cloud that it was sought in (of the part
    round it, where there are several objects) the share that lies on the model. seen_share: of the model's surface that
    the camera faces and nothing hides, the share that was measured where the model has it. contradicted: the share of
    it in front of what was measured there. residual: root mean square distance of the inliers to the model, m.
    ambiguous: what is left open. indices: of the points in the flattened input that lie on it.
    """

    T_camera_object: FloatArray
    model: ObjectModel
    inlier_share: float
    residual: float
    ambiguous: Ambiguity
    seen_share: float
    contradicted: float
    indices: NDArray[np.int64]
