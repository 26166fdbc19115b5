"""Plan a grasp on the cloud of one object from a file.

    python examples/01_plan_on_a_file.py [FILE]

FILE: .ply, .pcd, .npy, .npz or .xyz, in metres, with z up. Needs nothing but the package `grasping`.
"""

import sys
from pathlib import Path

from grasping import ROBOTIQ_2F_140, CurvaturePlanner
from grasping.cloud_files import read_cloud, valid_points

file = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / "data" / "object.ply"

points = valid_points(read_cloud(file))  # (N, 3)
plan = CurvaturePlanner(ROBOTIQ_2F_140).plan(points, up=(0, 0, 1))

if plan.best is None:
    sys.exit(f"no grasp: {plan.reason}")
print(f"{len(points)} points, {len(plan.candidates)} grasps; the best, score {plan.best.score:.2f}:")
print(f"pose of the grasp frame in the cloud's frame (+z approaches, +x closes):\n{plan.best.pose.round(3)}")
print(f"come in {1000 * plan.best.terms['opening']:.0f} mm open, close to {1000 * plan.best.width:.0f} mm")
