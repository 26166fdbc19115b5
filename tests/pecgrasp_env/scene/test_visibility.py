"""What hides what: against areas known by hand, and against rays."""

import numpy as np
import pytest
import sapien
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pecgrasp_env.scene.visibility import box_mesh, lying_on, visible_shares
from pecgrasp_env.sensor import intrinsics_of

CAMERA = intrinsics_of("424x240")
FROM_ABOVE = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.6], [0, 0, 0, 1]])


def box(size, at):
    return box_mesh(np.array(size) / 2, sapien.Pose(at))


def test_a_lid_hides_the_part_below_it_and_nothing_hides_the_lid():
    lower, lid = box((0.10, 0.10, 1e-4), (0, 0, 0)), box((0.05, 0.20, 1e-4), (0.025, 0, 1e-3))
    assert visible_shares([lower, lid], FROM_ABOVE, CAMERA) == pytest.approx([0.5, 1.0], abs=0.02)


def test_a_wall_between_hides_and_what_the_image_cuts_off_does_not_count():
    wall, behind, outside = box((0.2, 0.2, 0.01), (0, 0, 0.3)), box((0.05,) * 3, (0, 0, 0)), box((0.1,) * 3, (9, 0, 0))
    at_the_border = box((0.2, 0.05, 0.02), (0.42, 0, 0))
    shares = visible_shares([wall, behind, outside, at_the_border], FROM_ABOVE, CAMERA)
    assert shares.tolist() == [1.0, 0.0, 0.0, 1.0]


@settings(max_examples=10)
@given(st.integers(0, 10**6))
def test_balls_are_seen_where_the_rays_meet_them_first(seed):
    rng = np.random.default_rng(seed)
    radii, centres = rng.uniform(0.02, 0.06, 4), rng.uniform([-0.08, -0.08, 0.0], [0.08, 0.08, 0.1], (4, 3))
    ball = trimesh.creation.icosphere(4, 1.0)
    meshes = [(radius * ball.vertices + centre, ball.faces) for radius, centre in zip(radii, centres, strict=True)]
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack([(u + 0.5 - CAMERA.cx) / CAMERA.fx, (v + 0.5 - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    rays = rays.reshape(-1, 3) @ FROM_ABOVE[:3, :3].T
    to_centre = centres - FROM_ABOVE[:3, 3]
    along, square = rays @ to_centre.T, (rays * rays).sum(axis=1)[:, None]
    root = along**2 - square * ((to_centre**2).sum(axis=1) - radii**2)
    distance = np.where(root > 0, along - np.sqrt(np.maximum(root, 0)), np.inf)
    seen = np.isfinite(distance) & (distance == distance.min(axis=1, keepdims=True))
    shares = visible_shares(meshes, FROM_ABOVE, CAMERA)
    assert shares == pytest.approx(seen.sum(axis=0) / np.isfinite(distance).sum(axis=0), abs=0.03)


def test_what_is_above_lies_on_it_also_through_another_and_what_is_beside_does_not():
    lowest, middle, top = (box((0.04, 0.04, 0.02), (x, 0, z)) for x, z in ((0, 0.01), (0.03, 0.03), (0.06, 0.05)))
    beside = box((0.04, 0.04, 0.06), (0, 0.05, 0.03))
    upon = lying_on([lowest, beside, top, middle])
    assert np.argwhere(upon).tolist() == [[2, 0], [2, 3], [3, 0]]


def test_what_lies_in_a_bowl_lies_on_it_though_the_rim_is_higher():
    rim = trimesh.creation.annulus(0.05, 0.06, 0.08)
    bowl = trimesh.util.concatenate([rim, trimesh.creation.cylinder(0.05, 0.01).apply_translation([0, 0, -0.035])])
    ball = trimesh.creation.icosphere(2, 0.02).apply_translation([0, 0, -0.01])
    upon = lying_on([(bowl.vertices, bowl.faces), (ball.vertices, ball.faces)])
    assert np.argwhere(upon).tolist() == [[1, 0]]
