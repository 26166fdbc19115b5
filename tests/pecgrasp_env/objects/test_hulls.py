"""Convex pieces: simplification, runs of sections, carving."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pecgrasp_env.objects.meshing.convex_hulls import (
    MAX_HULL_FACES,
    MAX_HULL_VERTICES,
    THINNEST,
    carve,
    convex_hull,
    depth_below,
    group_sections,
    hull_volume,
    left_outside,
    simplify_hull,
    split_round,
    thickness,
)
from pecgrasp_env.objects.meshing.shapes import rings
from pecgrasp_env.objects.model import centre_of_mass


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(8, 300), flatness=st.floats(0.05, 1.0))
def test_a_simplified_hull_stays_inside_and_within_its_limits(seed, n, flatness):
    points = np.random.default_rng(seed).normal(size=(n, 3)) * [30, 20, 20 * flatness]
    kept = simplify_hull(points, tolerance=0.5)
    assert len(kept) <= MAX_HULL_VERTICES
    hull = convex_hull(kept)
    assert len(np.unique(np.round(hull.equations[:, :3], 3), axis=0)) <= MAX_HULL_FACES
    assert left_outside(kept, points) < 1e-9
    full = len(kept) == MAX_HULL_VERTICES or len(hull.simplices) > MAX_HULL_FACES - 4
    assert left_outside(points, kept) <= 0.5 or full


def test_a_straight_stretch_is_one_hull_and_a_waist_is_cut():
    cylinder = rings(np.array([(20.0, z) for z in range(0, 60, 5)]), n=24)
    assert len(group_sections(cylinder, tolerance=0.5)) == 1
    z = np.linspace(-30, 30, 25)
    waisted = rings(np.column_stack([10 + 10 * (z / 30) ** 2, z]), n=24)
    hulls = group_sections(waisted, tolerance=0.5)
    assert len(hulls) >= 2
    true = np.pi * np.trapezoid((10 + 10 * (z / 30) ** 2) ** 2, z)
    assert sum(map(hull_volume, hulls)) == pytest.approx(true, rel=0.05)
    assert hull_volume(waisted.reshape(-1, 3)) > 1.5 * true


def test_the_flat_rim_of_a_can_is_no_hull_of_its_own():
    """A disc without thickness would be cooked into a square whose corners stick out of the can."""
    can = rings(np.array([(41.0, 0.0), (44.0, 0.0), (44.0, 2.2), (43.0, 3.2), (43.0, 38.0)]), n=40)
    hulls = group_sections(can, tolerance=0.5)
    assert min(map(thickness, hulls)) >= THINNEST
    assert min(hull[:, 2].min() for hull in hulls) == 0
    foil = rings(np.array([(20.0, 0.0), (20.0, 0.1)]), n=24)
    assert len(group_sections(foil, tolerance=0.5)) == 1  # there is nothing else


def test_thickness_is_the_least_extent_across_a_face():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 3) for z in (0, 0.25)])
    assert thickness(corners) == pytest.approx(0.25)
    assert thickness(corners * [1, 1, 0]) == pytest.approx(0, abs=1e-9)
    assert thickness(np.eye(3, 4).T) == pytest.approx(3**-0.5)


def test_carving_an_l_shape_gives_its_volume():
    outline = np.array([(0, 0), (60, 0), (60, 20), (20, 20), (20, 60), (0, 60)], float)
    lower, upper = (np.column_stack([outline, np.full(6, z)]) for z in (0.0, 15.0))
    cap = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    sides = [(i, (i + 1) % 6, (i + 1) % 6 + 6) for i in range(6)] + [(i, (i + 1) % 6 + 6, i + 6) for i in range(6)]
    mesh = trimesh.Trimesh(np.concatenate([lower, upper]), np.concatenate([cap[:, ::-1], cap + 6, sides]))
    assert mesh.is_watertight
    parts = carve(mesh.vertices, mesh.faces, tolerance=0.5, thinnest=4.0)
    assert 2 <= len(parts) <= 12
    assert sum(map(hull_volume, parts)) == pytest.approx(mesh.volume, rel=0.1)


def test_a_round_body_is_split_until_few_faces_fit_it():
    ball = trimesh.creation.icosphere(4, 60.0)
    assert left_outside(ball.vertices, simplify_hull(ball.vertices)) > 2.0
    pieces = split_round(ball.vertices, thinnest=10.0)
    assert sum(map(hull_volume, pieces)) == pytest.approx(ball.volume, rel=0.03)
    nearest = np.min([-depth_below(ball.vertices, convex_hull(p)) for p in pieces], axis=0)
    assert nearest.max() < 1.0


def test_centre_of_mass_of_two_boxes():
    small = trimesh.creation.box((2, 2, 2)).vertices
    large = trimesh.creation.box((4, 2, 2)).vertices + np.array([9, 0, 0])
    np.testing.assert_allclose(centre_of_mass([small, large]), [6, 0, 0], atol=1e-9)
