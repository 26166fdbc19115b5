"""GGA, the generic grasping algorithm: hold the object at its centre, perpendicular to the table, without analysis."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from grasping.errors import ConfigError
from grasping.geometry.principal_axes import principal_axes
from grasping.grasp import Grasp, GraspPlan, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.validation import object_cloud, sight, workspace


class CentroidPlanner:
    """Grasp at the cloud's centroid from straight above, closing along the shorter horizontal axis of its PCA.

    The centroid and the approach are the source's. It has no rule for the heading; a gripper needs one.
    tip_clearance: the pads' tips are kept this far above a known table, m.
    heading: a direction (3,) in the cloud's frame along which the gripper closes, as far as it is horizontal, whatever
    lies there: "no analysis" taken at its word. None: the PCA's.
    """

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        tip_clearance: float = 0.004,
        heading: Sequence[float] | None = None,
    ) -> None:
        if not (math.isfinite(tip_clearance) and tip_clearance >= 0):
            raise ConfigError(f"tip_clearance = {tip_clearance!r} must not be negative")
        self.gripper = gripper
        self.tip_clearance = tip_clearance
        self.heading = None if heading is None else np.asarray(heading, float)
        if self.heading is not None and (self.heading.shape != (3,) or not 0 < np.linalg.norm(self.heading) < np.inf):
            raise ConfigError(f"heading = {heading!r} must be a direction: three numbers, not all zero")

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
        unseen: ArrayLike | None = None,
    ) -> GraspPlan:
        """Plan on the cloud (N, 3) of one object, m. Needs `up` or `table`; obstacles are not avoided, and what was not
        seen (viewpoint, unseen) counts as free.

        Raises ConfigError without either, CloudError for a cloud that is none.
        """
        cloud = object_cloud(points)
        up_vector, plane, _ = workspace(up, table, obstacles)
        sight(viewpoint, unseen)
        if up_vector is None:
            raise ConfigError("up = None: the centre grasp is perpendicular to the table, so it needs up or table")
        centroid = cloud.mean(axis=0)
        # Two horizontal directions to see the footprint in.
        seed = np.eye(3)[int(np.abs(up_vector).argmin())]
        first = np.cross(up_vector, seed)
        first /= np.linalg.norm(first)
        level = np.column_stack([first, np.cross(up_vector, first)])
        if self.heading is None:
            closing = level @ principal_axes((cloud - centroid) @ level)[:, 1]
        else:
            closing = self.heading - (self.heading @ up_vector) * up_vector
            length = float(np.linalg.norm(closing))
            if length < 1e-6 * float(np.linalg.norm(self.heading)):
                raise ConfigError(f"heading = {self.heading.tolist()} points along up: the gripper comes from there")
            closing /= length
        rotation = np.column_stack([closing, np.cross(-up_vector, closing), -up_vector])

        local = (cloud - centroid) @ rotation
        between = local[np.abs(local[:, 1]) <= 0.5 * self.gripper.finger_width, 0]
        width = float(np.ptp(between)) if len(between) else 0.0
        if width > self.gripper.stroke:
            wide, most = width * 1e3, self.gripper.stroke * 1e3
            reason = f"the object is {wide:.0f} mm wide at its centre; the gripper opens {most:.0f} mm"
            return plan_from([], [], reason)
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = centroid
        if plane is not None:
            tips = centroid - 0.5 * self.gripper.pad_length * up_vector
            pose[:3, 3] += max(0.0, self.tip_clearance - float(plane[:3] @ tips + plane[3])) * up_vector
        return plan_from([Grasp(pose, width, 1.0, "primitive")], [], "")
