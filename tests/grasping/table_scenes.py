"""Clouds of objects on a table, and how to plan on their files."""

import numpy as np
from grasping_shapes import box_top, grid, moved, standing_can

from grasping import CurvaturePlanner
from grasping.gripper import ROBOTIQ_2F_140
from grasping.plan_files.plan_file import Task


def box() -> np.ndarray:
    return box_top(0.12, 0.05, 0.06)


def on_a_table(*objects: np.ndarray) -> np.ndarray:
    """Objects on a table, in the frame of a camera 0.7 m above it that looks straight down."""
    table = np.column_stack([grid((-0.3, 0.3), (-0.3, 0.3), step=0.003), np.zeros(201 * 201)])
    for points in objects:
        low, high = points.min(axis=0)[:2] - 0.004, points.max(axis=0)[:2] + 0.004
        table = table[~((table[:, :2] > low) & (table[:, :2] < high)).all(axis=1)]
    return np.vstack([table, *objects]) * [1, -1, -1] + [0, 0, 0.7]


def table_scene() -> np.ndarray:
    """A box and a can."""
    return on_a_table(moved(box(), x=-0.1), moved(standing_can(0.03, 0.08), x=0.1))


def task(**changes: object) -> Task:
    return Task(**{"planner": CurvaturePlanner(), "gripper": ROBOTIQ_2F_140, "up": (0, 0, 1)} | changes)  # type: ignore[arg-type]
