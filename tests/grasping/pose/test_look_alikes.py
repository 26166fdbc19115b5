"""Poses in which a model looks as it does in its own: found once, tried in every cloud."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seen_stones import model_of

from grasping.pose.depth_image import depth_image
from grasping.pose.metrics import mssd
from grasping.pose.object_model import ObjectModel, object_model
from grasping.pose.pose_estimator import PoseEstimator
from grasping.pose.prepared_model import PreparedModel

CAMERA = np.array([[400.0, 0.0, 119.5], [0.0, 400.0, 89.5], [0.0, 0.0, 1.0]])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def block(size: tuple[float, float, float], at: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * np.array(size) / 2 + at
    return corners, np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))], np.int32)


@pytest.fixture(scope="module", params=[0.02, 0.012], ids=["knob", "small knob"])
def knob(request: pytest.FixtureRequest) -> ObjectModel:
    """A square block with a knob that stands on one end, towards a corner: no symmetry.

    The small one is lower than a tenth of the diameter: nearly all of the surface lies in place after a turn.
    """
    high = request.param
    (v, f), (w, g) = block((0.08, 0.08, 0.12), (0, 0, 0)), block((0.02, 0.02, high), (0.025, 0.01, 0.06 + high / 2))
    return object_model(np.concatenate([v, w]), np.concatenate([f, g + 8]), "knob", allow_open=True)


def test_much_of_a_model_lies_on_itself_in_poses_that_are_no_symmetries(knob: ObjectModel) -> None:
    prepared = PreparedModel(knob)
    for turn in (Rotation.from_euler("z", 90, degrees=True), Rotation.from_euler("x", 180, degrees=True)):
        T = np.eye(4)
        T[:3, :3] = turn.as_matrix()
        off = [np.linalg.norm(knob.points @ (M - T)[:3, :3].T + (M - T)[:3, 3], axis=1) for M in prepared.look_alikes]
        assert min(each.max() for each in off) < 0.05 * knob.diameter
    for T in prepared.look_alikes:
        moved = knob.points @ T[:3, :3].T + T[:3, 3]
        assert mssd(knob.points, T, np.eye(4), knob.symmetry) > 0.09 * knob.diameter
        assert (prepared.tree.query(moved)[0] < 0.035 * knob.diameter).mean() > 0.55


@pytest.mark.parametrize("shape", ["can", "pebble"])
def test_a_symmetry_is_no_other_pose_and_some_shapes_have_none(shape: str) -> None:
    assert PreparedModel(model_of(shape)).look_alikes.shape == (0, 4, 4)


@pytest.mark.parametrize("seed", range(4))
def test_where_the_knob_is_hidden_the_right_turn_is_among_those_left_open(knob: ObjectModel, seed: int) -> None:
    T = np.eye(4)
    tilt = np.random.default_rng(seed).uniform(20, 40, 2)
    T[:3, :3] = Rotation.from_euler("xy", tilt, degrees=True).as_matrix()
    T[2, 3] = 0.6
    depth = depth_image(knob.vertices, knob.faces, T, CAMERA, (180, 240))
    rows, columns = np.nonzero(depth)
    rays = np.stack([(columns - 119.5) / 400, (rows - 89.5) / 400, np.ones(len(rows))], axis=1)
    (found,) = PoseEstimator([knob]).estimate(rays * depth[rows, columns][:, None])
    poses = [found.T_camera_object, *found.ambiguous.others]
    assert len(poses) > 1
    assert min(mssd(knob.points, each, T, knob.symmetry) for each in poses) < 0.1 * knob.diameter
