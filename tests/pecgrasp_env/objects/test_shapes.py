"""Shape builders against solids whose volume is known, and the normals that are written."""

import numpy as np
import pytest
import trimesh

from pecgrasp_env.objects.meshing.convex_hulls import hull_volume
from pecgrasp_env.objects.meshing.implicit import blend, ellipsoid, round_cone, rounded_box, surface_net, top_of
from pecgrasp_env.objects.meshing.mesh_cache import with_normals
from pecgrasp_env.objects.meshing.shapes import (
    Shape,
    block,
    disc,
    inset,
    join,
    lathe,
    rings,
    rounded_rectangle,
    sleeve,
    smooth_path,
    superellipse,
    tube,
    wall_hulls,
)


def solid(shape: Shape) -> trimesh.Trimesh:
    return trimesh.Trimesh(shape.vertices, shape.faces)


HALF_CIRCLE = [(20 * np.sin(t), -20 * np.cos(t)) for t in np.linspace(0, np.pi, 24)]
KNOWN = {
    "box": (block(40, 30, 20, radius=0.5, bevel=0.3), 40 * 30 * 20),
    "cylinder": (disc(15, 40), np.pi * 15**2 * 40),
    "ball": (lathe(HALF_CIRCLE, n=48), 4 / 3 * np.pi * 20**3),
    "straight bar": (tube(np.linspace([0, 0, 0], [80, 0, 0], 5), 12, 8), np.pi * 6 * 4 * 80),
    "quarter ring": (
        tube(np.array([(50 * np.cos(t), 50 * np.sin(t), 0) for t in np.linspace(0, np.pi / 2, 40)]), 10, 10, fit=0.3),
        np.pi * 25 * 25 * np.pi,
    ),
}


@pytest.mark.parametrize("name", KNOWN)
def test_builders_make_closed_outward_solids_of_the_right_volume(name):
    shape, volume = KNOWN[name]
    mesh = solid(shape)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.02)
    assert sum(map(hull_volume, shape.hulls)) == pytest.approx(volume, rel=0.05)


def test_moving_turning_and_mirroring_carry_faces_and_hulls_along():
    shape = block(40, 30, 20).moved(5, 6, 7)
    for other in (shape.rotated("z", 90), shape.scaled(y=-1), join([shape, shape.moved(x=100)])):
        assert solid(other).volume == pytest.approx(solid(shape).volume * len(other.hulls), rel=1e-6)
        assert sum(map(hull_volume, other.hulls)) == pytest.approx(hull_volume(shape.hulls[0]) * len(other.hulls))
    turned = shape.rotated("z", 90)
    np.testing.assert_allclose(turned.vertices[:, 0], -shape.vertices[:, 1], atol=1e-9)
    assert shape.without_hulls().hulls == ()


def test_round_ends_keep_the_length():
    bar = tube(np.linspace([0, 0, 0], [80, 0, 0], 9), 12, 12, round_ends=6)
    assert np.ptp(bar.vertices[:, 0]) == pytest.approx(80, abs=0.2)
    assert solid(bar).volume < np.pi * 36 * 80


def test_curves():
    rectangle = rounded_rectangle(40, 20, 3)
    np.testing.assert_allclose(np.ptp(rectangle, axis=0), [40, 20])
    np.testing.assert_allclose(np.ptp(inset(rectangle, 1.0), axis=0), [38, 18], atol=1e-6)
    oval = superellipse(10, 5, 3)
    np.testing.assert_allclose(np.abs(oval[:, 0] / 10) ** 3 + np.abs(oval[:, 1] / 5) ** 3, 1)
    path = smooth_path([(0, 0, 0), (10, 5, 0), (20, 0, 0)], 11)
    np.testing.assert_allclose(path[[0, 5, 10]], [(0, 0, 0), (10, 5, 0), (20, 0, 0)], atol=1e-9)


def test_a_wall_leaves_its_inside_free():
    outer, inner = (rings(np.array([(r, 0.0), (r, 50.0)]), n=48) for r in (40.0, 36.0))
    pieces = wall_hulls(outer, inner, sectors=12)
    assert len(pieces) == 12
    assert min(np.linalg.norm(p[:, :2], axis=1).min() for p in pieces) == pytest.approx(36, abs=0.01)
    true = np.pi * (40**2 - 36**2) * 50
    assert sum(map(hull_volume, pieces)) == pytest.approx(true, rel=0.25)
    assert hull_volume(outer.reshape(-1, 3)) > 5 * true


def test_a_sleeve_is_open_in_the_middle():
    band = solid(sleeve(rings(np.array([(30.0, 0.0), (30.0, 10.0)]), n=48), thickness=0.4))
    assert band.is_watertight
    assert band.volume == pytest.approx(2 * np.pi * 30 * 0.4 * 10, rel=0.02)


def test_surface_net_of_a_ball():
    ball = ellipsoid((1, 2, 3), (20, 20, 20))
    vertices, faces = surface_net(ball, (-25, -25, -25), (28, 28, 28), 3.0)
    mesh = trimesh.Trimesh(vertices, faces)
    assert mesh.is_watertight
    np.testing.assert_allclose(np.linalg.norm(vertices - [1, 2, 3], axis=1), 20, atol=0.01)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 20**3, rel=0.02)
    assert top_of(ball, 1, 2, 40) == pytest.approx(23, abs=0.3)


def test_fields_are_zero_on_their_surfaces_and_blends_only_add():
    cone = round_cone((0, 0, 0), (30, 0, 0), 10, 5)
    box = rounded_box((0, 0, 0), (20, 10, 5), 2)
    np.testing.assert_allclose(cone(np.array([(0, 10.0, 0), (30, 0, 5.0), (35.0, 0, 0)])), 0, atol=1e-9)
    np.testing.assert_allclose(box(np.array([(20.0, 0, 0), (0, 10.0, 0), (0, 0, -5.0)])), 0, atol=1e-9)
    points = np.random.default_rng(0).uniform(-40, 40, (500, 3))
    union = np.minimum(cone(points), box(points))
    blended = blend([cone, box], 8)(points)
    assert (blended <= union + 1e-9).all()
    assert (blended >= union - 8 / 4 * np.log(2) - 1e-9).all()


def test_normals_are_sharp_on_a_box_and_smooth_on_a_ball():
    box = trimesh.creation.box((1, 1, 1))
    vertices, faces, normals, _ = with_normals(box.vertices, box.faces)
    assert len(vertices) == 24
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1, atol=1e-6)
    ball = trimesh.creation.icosphere(3, 1.0)
    vertices, faces, normals, _ = with_normals(ball.vertices, ball.faces)
    assert len(vertices) == len(ball.vertices)
    np.testing.assert_allclose(normals, vertices, atol=0.02)
    np.testing.assert_allclose(vertices[faces].mean(axis=1), ball.triangles_center, atol=1e-6)
