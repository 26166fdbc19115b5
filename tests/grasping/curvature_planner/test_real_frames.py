"""Real Kinect and Xtion frames, cut out and planned on: hardly any finger is behind the front of what it holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from grasping import ROBOTIQ_2F_140, CurvaturePlanner, Grasp, Segmenter

FloatArray = NDArray[np.float64]

REAL = Path(__file__).parents[4] / "shared" / "data" / "real"
KINECT = np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]])
NOISE = 0.015  # m of depth between a seen surface and what is surely behind it: noise, and pixels that hang over edges
SHELL = 0.030  # m behind the front of a thing that is no sheet, which is taken for its inside
# Pixels, some 15 mm, from the outline of a thing in the image to what is surely in front of its inside: nearer to it a
# line of sight may pass over the far edge of a top and meet a finger that stands behind the thing, and rightly so.
OUTLINE = 8
MOST, MEAN = 0.03, 0.003  # share of a grasp's places, of any and of all: a screen is thin, a stack has steps behind

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


@pytest.mark.parametrize("name", ["tabletop_scenes_mosd", "tables_xtion_hots"])
def test_hardly_any_finger_goes_down_behind_the_front_of_the_thing_that_it_holds(name: str) -> None:
    inside = [share for k in range(0, 36, 7) for share in shares_inside(*frame(name, k))]
    assert len(inside) >= 12
    assert max(inside) <= MOST
    assert np.mean(inside) <= MEAN


def shares_inside(depth: FloatArray, K: FloatArray) -> list[float]:
    """Of the best grasp of each thing the share of the fingers' places that are inside it."""
    row, column = np.mgrid[: depth.shape[0], : depth.shape[1]]
    cloud = np.stack([(column - K[0, 2]) * depth / K[0, 0], (row - K[1, 2]) * depth / K[1, 1], depth], axis=-1)
    scene, inside = Segmenter().segment(cloud), []
    for i, points in enumerate(scene.objects):
        others = [each for j, each in enumerate(scene.objects) if j != i]
        plan = CurvaturePlanner().plan(
            points,
            table=scene.plane,
            obstacles=np.vstack([*others, *scene.obstacles, np.empty((0, 3))]),
            viewpoint=scene.viewpoint,
            unseen=scene.unseen[i],
        )
        if plan.best is None:
            continue
        own = np.zeros(depth.shape, dtype=bool)
        own.reshape(-1)[scene.indices[i]] = True
        front = ndimage.binary_erosion(ndimage.binary_closing(own, iterations=2), iterations=OUTLINE) & own
        deep = behind(swept(plan.best), np.where(front, depth, 0.0), K)
        inside.append(float(np.mean((deep > NOISE) & (deep < NOISE + SHELL))))
    return inside
