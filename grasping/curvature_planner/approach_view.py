"""The cloud as the gripper sees it along one approach: heights against it, and what is known below the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.line_of_sight import Sight

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ApproachView:
    """A frame with its third axis against the approach; `origin` in the middle of the object, seen so.

    axes: (3, 3) right-handed columns in the cloud's frame, the first two along the footprint's short and long axis.
    points: (3, N) x, y and height of the object in the frame, in rising height. obstacles: (3, K) likewise of what else
        is in the way.
    floor: height of the table, or of the lowest point seen. centre: (2,) estimate of the centre of mass. tilt: rad.
    sight: what the camera saw, in the cloud's frame. measured: (3, M) those of the object's points, in the cloud's
        frame, that were measured and not assumed; None where all were.
    farthest: m of the footprint from the centre of mass. volume: m³, filled down to the floor.
    """

    origin: FloatArray
    axes: FloatArray
    points: FloatArray
    obstacles: FloatArray
    floor: float
    centre: FloatArray
    tilt: float
    sight: Sight
    measured: FloatArray | None
    farthest: float
    volume: float
