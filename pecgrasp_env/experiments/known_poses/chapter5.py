"""What the dissertation's chapter 5.5.1 shows of its first system: final grasp poses of two objects that a Kinect above
sees, and the regions that are chosen on whole models of four (figures 5.5 to 5.8).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasping import CurvaturePlanner, GraspPlan, ModelPlanner, PublishedPlanner
from grasping.pose.depth_image import depth_image
from grasping.pose.object_model import ObjectModel

# Position, m, and roll, pitch, yaw, rad, of an object in the world, and what the table there states of the grasp.
SIMULATED = {
    "tomato_soup_can": ((-0.48, -0.07, 0.40), (3.14, 0.0, 1.57), (-0.48, -0.08, 0.43)),
    "bleach_cleanser": ((-0.50, 0.02, 0.30), (-2.5, 0.0, 0.7), (-0.51, 0.02, 0.34)),
}
CHOSEN = {
    "power_drill": "the handle",
    "bleach_cleanser": "near the bottom, where its sides are straight",
    "medium_clamp": "one handle",
    "tomato_soup_can": "the centroid, as a cylinder",
}
ABOVE = 0.8  # m of the camera over the object
_KINECT = np.array([[525.0, 0, 319.5], [0, 525.0, 239.5], [0, 0, 1]])
_UP = np.array([0.0, 0, 1])


def final_poses(models: Sequence[ObjectModel]) -> list[dict[str, Any]]:
    """For each object of the table that there is a model of: its pose found from above, and the best grasp on it."""
    rows = []
    planner = ModelPlanner(models=models)
    for name, (position, angles, stated) in SIMULATED.items():
        model = next((each for each in models if name in each.name), None)
        if model is None:
            continue
        T_world_object = np.eye(4)
        T_world_object[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        # The object's place is its middle: the origins of its scans are somewhere else.
        middle = 0.5 * (model.vertices.min(axis=0) + model.vertices.max(axis=0))
        T_world_object[:3, 3] = position - T_world_object[:3, :3] @ middle
        T_world_camera = np.diag([1.0, -1, -1, 1])
        T_world_camera[:3, 3] = np.add(position, (0, 0, ABOVE))
        T_true = np.linalg.inv(T_world_camera) @ T_world_object
        depth = depth_image(model.vertices, model.faces, T_true, _KINECT, (480, 640))
        v, u = np.nonzero(depth)
        z = depth[v, u]
        cloud = np.stack([(u - _KINECT[0, 2]) / _KINECT[0, 0] * z, (v - _KINECT[1, 2]) / _KINECT[1, 1] * z, z], axis=1)
        plan = planner.plan(cloud, up=T_world_camera[:3, :3].T @ _UP, label=model.label)
        row: dict[str, Any] = {"object": name, "place": list(position), "stated_grasp": list(stated)}
        row |= {"planned_on": plan.source, "reason": plan.reason, "grasp": None, "off_m": None}
        if plan.best is not None:
            at = (T_world_camera @ plan.best.pose)[:3, 3]
            row |= {"grasp": at.tolist(), "off_m": (at - position).tolist(), "width": plan.best.width}
            row["off_percent"] = (100 * np.abs((at - position) / np.array(position))).tolist()
            row["stated_off_percent"] = (100 * np.abs((np.array(stated) - position) / np.array(position))).tolist()
        rows.append(row)
    return rows


def chosen_regions(models: Sequence[ObjectModel]) -> list[dict[str, Any]]:
    """Where on the whole model the best grasp lies, of the default planner and the published one."""
    rows = []
    for name, chosen in CHOSEN.items():
        model = next((each for each in models if name in each.name), None)
        if model is None:
            continue
        row: dict[str, Any] = {"object": name, "published_region": chosen}
        for planner in (CurvaturePlanner(), PublishedPlanner()):
            row[type(planner).__name__] = _place(model, planner.plan(model.points))
        rows.append(row)
    return rows


def _place(model: ObjectModel, plan: GraspPlan) -> dict[str, Any]:
    """Of the best grasp its place in shares of the model's box, along the mesh's axes, and its way off the centroid."""
    if plan.best is None:
        return {"reason": plan.reason}
    low, high = model.points.min(axis=0), model.points.max(axis=0)
    at = plan.best.pose[:3, 3]
    return {
        "kind": plan.best.kind,
        "in_box": ((at - low) / (high - low)).tolist(),
        "off_centroid_m": float(np.linalg.norm(at - model.points.mean(axis=0))),
        "width": plan.best.width,
    }
