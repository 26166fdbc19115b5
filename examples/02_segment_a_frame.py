"""Cut a depth frame into table and objects, and plan a grasp on each of them among the others.

    python examples/02_segment_a_frame.py [FILE]

FILE: a whole frame in the camera's frame, e.g. an .npz with `depth` (H, W), millimetres, and the intrinsics `K` (3, 3).
The frame of examples/data is a simulated D435's. Needs nothing but the package `grasping`.
"""

import sys
from pathlib import Path

import numpy as np

from grasping import ROBOTIQ_2F_140, CurvaturePlanner, Segmenter
from grasping.cloud_files import read_cloud

file = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / "data" / "frame.npz"

scene = Segmenter().segment(read_cloud(file))
if scene.plane is None:
    sys.exit(f"no table in this frame: {scene.summary()}")
print(f"table: {scene.n_table} points, {scene.plane[3]:.2f} m from the camera; {len(scene.objects)} objects")
print(f"left out: {scene.summary()}")

planner = CurvaturePlanner(ROBOTIQ_2F_140)
for i, target in enumerate(scene.objects):
    others = [cloud for j, cloud in enumerate(scene.objects) if j != i] + scene.obstacles
    plan = planner.plan(
        target,
        table=scene.plane,
        obstacles=np.vstack([*others, np.empty((0, 3))]),
        viewpoint=scene.viewpoint,
        unseen=scene.unseen[i],
    )
    if plan.best is None:
        print(f"object {i}, {len(target)} points: no grasp, {plan.reason}")
    else:
        place = plan.best.pose[:3, 3].round(3)
        print(f"object {i}, {len(target)} points: held at {place} m, {1000 * plan.best.width:.0f} mm wide")
