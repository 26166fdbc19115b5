"""Your own grasp planner in one file: any class with the method `plan` below, evaluated in simulation.

    python examples/07_own_planner.py

evaluates it on three scenes. On as many as you like, and beside another planner on the same scenes, each a command:

    export PYTHONPATH=examples            # the folder of your file
    pecgrasp evaluate planner._target_=07_own_planner.TopPlanner planner_name=top checkpoint=null \
        env.n_objects=1 'env.classes=[can]' episodes=20
    pecgrasp evaluate checkpoint=null env.n_objects=1 'env.classes=[can]' episodes=20

Finished episodes are kept, even where this file has changed: after an edit give a new folder=, or delete the old one.
"""

import tempfile
from pathlib import Path

import numpy as np

from grasping import ROBOTIQ_2F_140, Grasp, GraspPlan, Gripper


class TopPlanner:
    """Straight down on the middle of what is seen, closing along x or y, whichever is narrower."""

    def __init__(self, gripper: Gripper = ROBOTIQ_2F_140, depth: float = 0.02) -> None:
        self.gripper = gripper
        self.depth = depth  # m, of the pads' centre below the top; a setting: +planner.depth=0.03

    def plan(self, points, *, up=None, table=None, obstacles=None, viewpoint=None, unseen=None) -> GraspPlan:
        """points (N, 3), m; up (3,) away from the table; table (4,), n·p + d = 0; obstacles (K, 3): of other things;
        viewpoint (3,): where the camera stood; unseen (U, 3): far ends of lines of sight without a measurement."""
        low, high = points.min(axis=0), points.max(axis=0)
        narrow = int((high - low)[:2].argmin())
        width = float((high - low)[narrow])
        if width > self.gripper.stroke:
            return GraspPlan(None, [], [], f"{1000 * width:.0f} mm wide; the gripper opens {self.gripper.stroke} m")
        pose = np.eye(4)
        # Columns: +x closes along x or along y, +z approaches downwards.
        pose[:3, :3] = [[[1, 0, 0], [0, -1, 0], [0, 0, -1]], [[0, 1, 0], [1, 0, 0], [0, 0, -1]]][narrow]
        pose[:3, 3] = (low + high) / 2
        pose[2, 3] = max(high[2] - self.depth, 0.04)  # the fingertips reach 33 mm beyond the pads' centre
        grasp = Grasp(pose, width, score=1.0, kind="region")
        return GraspPlan(grasp, [grasp], [], None)


if __name__ == "__main__":
    from pecgrasp_env.evaluation.run import Protocol, run_episodes

    planner = {"_target_": "07_own_planner.TopPlanner"}
    protocol = Protocol({"n_objects": 1, "classes": ["can"]}, checkpoint=None, planner=planner, policy={})
    with tempfile.TemporaryDirectory() as folder:
        for episode in run_episodes(protocol, seeds=range(3), out=Path(folder)):
            print(f"{episode.objects[0]}: {episode.outcome} {episode.reason or ''}")
