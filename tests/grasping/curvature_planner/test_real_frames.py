"""Real Kinect and Xtion frames, cut out and planned on: no finger is inside the shell that was seen of what it holds.

A place is inside where it is behind the front of the thing and between what was seen of it, within the convex hull.
Behind the front alone is a finger beside the far side, too: over the far edge of a top a line of sight meets it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from grasping import ROBOTIQ_2F_140, CurvaturePlanner, Grasp, Segmenter

FloatArray = NDArray[np.float64]

REAL = Path(__file__).parents[4] / "shared" / "data" / "real"
KINECT = np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]])
NOISE = 0.015  # m of depth between a seen surface and what is surely behind it: noise, and pixels that hang over edges
EDGE = 0.003  # m within the hull from which a place is surely inside: noise of the outermost points
ABOVE_TIPS = 0.005  # m: what was seen lower than that is what a thing stands on, in a stack, and no finger is beside it
MOST, MEAN = 0.002, 0.0002  # share of a grasp's places, of any and of all

pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="no real frames at ../shared/data/real")


def frame(name: str, k: int) -> tuple[FloatArray, FloatArray]:
    """Depth (480, 640) m and the camera (3, 3)."""
    with np.load(REAL / f"{name}.npz") as data:
        if name == "tabletop_scenes_mosd":
            return data["depth_mm"][k] * 1e-3, KINECT
        cameras = data["K"]
        return data["depth"][k] * float(data["depth_scale_m"]), cameras if cameras.ndim == 2 else cameras[k]


def swept(grasp: Grasp) -> FloatArray:
    """Places (N, 3) in both fingers from 100 mm above the grasp down to it and while they close."""
    hand = ROBOTIQ_2F_140
    x = np.arange(0.5 * grasp.width + 0.003, 0.5 * grasp.terms["opening"] + hand.finger_thickness, 0.004)
    y, z = np.linspace(-0.5, 0.5, 7) * hand.finger_width, np.arange(-0.1, 0.5 * hand.pad_length, 0.004)
    one = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.vstack([one, one * [-1, 1, 1]]) @ grasp.pose[:3, :3].T + grasp.pose[:3, 3]


def behind(places: FloatArray, depth: FloatArray, K: FloatArray) -> FloatArray:
    """How far (m) each place lies behind what was measured in its pixel; −inf where nothing was."""
    column = np.rint(places[:, 0] / places[:, 2] * K[0, 0] + K[0, 2]).astype(np.int64)
    row = np.rint(places[:, 1] / places[:, 2] * K[1, 1] + K[1, 2]).astype(np.int64)
    inside = (column >= 0) & (column < depth.shape[1]) & (row >= 0) & (row < depth.shape[0])
    surface = depth[np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.where(inside & (surface > 0.0), places[:, 2] - surface, -np.inf)


def within(places: FloatArray, seen: FloatArray) -> NDArray[np.bool_]:
    """Whether each place (N, 3) is inside the hull of seen points (M, 3)."""
    if len(seen) < 10:
        return np.zeros(len(places), dtype=bool)
    faces = ConvexHull(seen, qhull_options="QJ").equations
    return np.array([(places @ face[:3] + face[3]) < -EDGE for face in faces]).all(axis=0)


@pytest.mark.parametrize("name", ["tabletop_scenes_mosd", "tables_xtion_hots"])
def test_no_finger_goes_into_the_shell_that_was_seen_of_the_thing_that_it_holds(name: str) -> None:
    inside = [share for k in range(0, 36, 7) for share in shares_inside(*frame(name, k), told=True)]
    assert len(inside) >= 12
    assert max(inside) <= MOST
    assert np.mean(inside) <= MEAN


def test_a_planner_that_does_not_know_where_the_camera_stood_goes_into_shells() -> None:
    """So the check sees what it is there for."""
    inside = shares_inside(*frame("tables_xtion_hots", 5), told=False)
    assert max(inside) > 5 * MOST


def shares_inside(depth: FloatArray, K: FloatArray, *, told: bool) -> list[float]:
    """Of the best grasp of each thing the share of the fingers' places that are inside it. told: of the viewpoint."""
    row, column = np.mgrid[: depth.shape[0], : depth.shape[1]]
    cloud = np.stack([(column - K[0, 2]) * depth / K[0, 0], (row - K[1, 2]) * depth / K[1, 1], depth], axis=-1)
    scene, inside = Segmenter().segment(cloud), []
    assert scene.plane is not None
    moved = np.zeros(3) if told else 3.0 * scene.plane[:3]  # below the table no camera can have stood
    table = scene.plane - [0.0, 0.0, 0.0, scene.plane[:3] @ moved]
    for i, points in enumerate(scene.objects):
        others = [each for j, each in enumerate(scene.objects) if j != i]
        seen = {"viewpoint": scene.viewpoint, "unseen": scene.unseen[i]} if told else {}
        obstacles = np.vstack([*others, *scene.obstacles, np.empty((0, 3))])
        plan = CurvaturePlanner().plan(points + moved, table=table, obstacles=obstacles + moved, **seen)
        if plan.best is None:
            continue
        own = np.zeros(depth.size)
        own[scene.indices[i]] = 1.0
        places, approach = swept(plan.best) - moved, plan.best.pose[:3, 2]
        tips = (plan.best.pose[:3, 3] - moved) @ approach + 0.5 * ROBOTIQ_2F_140.pad_length
        beside = points[points @ approach < tips - ABOVE_TIPS]
        hidden = behind(places, depth * own.reshape(depth.shape), K) > NOISE
        inside.append(float(np.mean(hidden & within(places, beside))))
    return inside
