"""The robot in view: cut out before anything else, counted, and what it hides is unseen."""

import numpy as np
import pytest
from rendered_scenes import BOXES, look_down, owners_of, render, share_found, up_in

from grasping import CloudError, Segmenter
from grasping.segmentation.robot_body import BEYOND_POINTS, BEYOND_SPHERES, RobotBody

ARM = (0.0, -0.20, 0.05, 0.46, 0.05, 0.10)  # a bar that comes in 10 cm above the table and ends over the first box


def covered(spheres: bool, T: np.ndarray) -> np.ndarray:
    """The bar in the camera's frame: spheres (K, 4), or points (K, 3) of its surface."""
    x, y, length, width, height, z0 = ARM
    if spheres:
        along = np.arange(y - width / 2, y + width / 2 + 0.01, 0.02)
        centre = np.column_stack([np.full(len(along), x), along, np.full(len(along), z0 + height / 2)])
    else:
        sides = [np.linspace(-size / 2, size / 2, round(size / 0.02) + 1) for size in (length, width, height)]
        grid = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 3)
        centre = grid[(np.abs(grid) > np.array([length, width, height]) / 2 - 1e-9).any(axis=1)] + [
            x,
            y,
            z0 + height / 2,
        ]
    own = (centre - T[:3, 3]) @ T[:3, :3]
    return np.column_stack([own, np.full(len(own), 0.037)]) if spheres else own


@pytest.mark.parametrize("spheres", [True, False])
@pytest.mark.parametrize("segmenter", [Segmenter(), Segmenter.published()])
def test_an_arm_over_the_table_is_no_object_and_those_beside_it_stay(spheres: bool, segmenter) -> None:
    T = look_down()
    frame, owner = render([*BOXES, ARM], T)
    before, owner_before = render(BOXES, T)
    alone = segmenter.segment(before, up=up_in(T))
    scene = segmenter.segment(frame, up=up_in(T), robot=covered(spheres, T))
    assert all(shares.get(3, 0.0) == 0.0 for shares in owners_of(scene, owner))
    assert len(scene.objects) == len(alone.objects) == 3
    for box in (1, 2):
        assert share_found(scene, owner, box) > share_found(alone, owner_before, box) - 0.02
    counted = {entry.why: entry.n_points for entry in scene.rejected}
    assert (owner == 3).sum() <= counted["the robot itself"] < 1.3 * (owner == 3).sum()
    known = np.concatenate([*scene.indices, *(entry.indices for entry in scene.rejected)])
    assert len(np.unique(known)) == len(known) == owner.size - scene.n_table
    assert all(len(entry.indices) == entry.n_points for entry in scene.rejected)


def test_without_it_the_arm_joins_or_stands_as_an_object() -> None:
    T = look_down()
    frame, owner = render([*BOXES, ARM], T)
    scene = Segmenter().segment(frame, up=up_in(T))
    taken = sum(shares.get(3, 0.0) > 0 for shares in owners_of(scene, owner))
    assert taken > 0 or any(entry.what == "cluster" for entry in scene.rejected)


def test_what_the_arm_hides_of_an_object_is_unseen() -> None:
    T = look_down(0.0)
    frame, _ = render([(0.0, 0.0, 0.10, 0.10, 0.05), ARM], T)
    scene = Segmenter().segment(frame, up=up_in(T), robot=covered(True, T))
    (far,) = scene.unseen
    in_world = far @ T[:3, :3].T + T[:3, 3]
    assert len(far) > 100
    assert np.abs(in_world[:, 2]).max() < 0.004
    assert (np.abs(in_world[:, 0]) < 0.06).all()
    assert (in_world[:, 1] < 0.06).all()


def test_an_object_that_the_robot_touches_is_flagged() -> None:
    T = look_down()
    frame, owner = render(BOXES, T)
    finger = (np.array([0.0, 0.03, 0.05]) - T[:3, 3]) @ T[:3, :3]
    scene = Segmenter().segment(frame, up=up_in(T), robot=finger[None])
    touched = [
        max(s, key=s.get) for s, flag in zip(owners_of(scene, owner), scene.touches_gripper, strict=True) if flag
    ]
    assert touched == [0]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_reach_is_exact_for_spheres_of_any_size(dtype) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (20_000, 3)).astype(dtype)
    points[::50] = np.nan
    points[1::50] = 0.0
    centre, radius = rng.uniform(-0.4, 0.4, (30, 3)), rng.uniform(0.0, 0.1, 30)
    apart = np.linalg.norm(points[:, None].astype(np.float64) - centre, axis=2)
    for beyond in (0.0, 0.01):
        expected = np.flatnonzero((apart < radius + BEYOND_SPHERES + beyond).any(axis=1))
        np.testing.assert_array_equal(RobotBody(np.column_stack([centre, radius])).within(points, beyond), expected)
        expected = np.flatnonzero((apart < BEYOND_POINTS + beyond).any(axis=1))
        np.testing.assert_array_equal(RobotBody(centre).within(points, beyond), expected)


def test_a_robot_far_away_or_of_no_points_changes_nothing() -> None:
    T = look_down()
    frame, _ = render(BOXES, T)
    alone = Segmenter().segment(frame, up=up_in(T))
    for robot in (
        np.empty((0, 3)),
        np.empty((0, 4)),
        [[0.0, 0.0, -5.0]],
        [[100.0, -2000.0, 50.0, 0.1], [0, 0, -3, 0.1]],
    ):
        scene = Segmenter().segment(frame, up=up_in(T), robot=robot)
        for own, other in zip(scene.indices, alone.indices, strict=True):
            np.testing.assert_array_equal(own, other)
        assert scene.rejected == alone.rejected


@pytest.mark.parametrize(
    ("robot", "match"),
    [
        (np.zeros(3), r"robot: shape \(3,\), expected points \(K, 3\) or spheres \(K, 4\)"),
        (np.zeros((5, 2)), r"robot: shape \(5, 2\)"),
        ([[0.0, np.nan, 0.0]], "robot: 1 of 1 points not finite"),
        ([[0.0, 0.0, 0.5, -0.1]], "robot: radii from -0.1 to -0.1, expected 0 to 2 m"),
        ([[0.0, 0.0, 0.5, 60.0]], "robot: radii from 60 to 60"),
        ([["a", "b", "c"]], "robot: not an array of numbers"),
    ],
)
def test_what_is_no_robot_is_refused(robot, match: str) -> None:
    with pytest.raises(CloudError, match=match):
        Segmenter().segment(np.ones((10, 3)), robot=robot)


def test_a_frame_of_the_robot_alone_says_so() -> None:
    points = np.random.default_rng(0).normal(size=(200, 3)) * 0.01 + [0, 0, 0.5]
    with pytest.raises(CloudError, match="without 200 of the robot itself"):
        Segmenter().segment(points, robot=[[0, 0, 0.5, 0.2]])
