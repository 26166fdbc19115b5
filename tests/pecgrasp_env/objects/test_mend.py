"""What files do to meshes, made here one fault at a time: the body must be the one that was meant."""

import numpy as np
import pytest
import trimesh

from pecgrasp_env.objects import ObjectError
from pecgrasp_env.objects.meshing.edges import Edges
from pecgrasp_env.objects.meshing.mend import Body, mend
from pecgrasp_env.objects.meshing.volume import solid_volume


def mended(vertices, faces) -> Body:
    return mend(np.asarray(vertices, float), np.asarray(faces, np.int32), "x.ply")


def outward(body: Body) -> float:
    """Signed volume, after checking that the surface is closed and wound one way."""
    assert body.open_edges == 0
    assert not Edges(body.faces).balance().any()
    return solid_volume(body.vertices, body.faces)


def box(size=(0.1, 0.06, 0.04), at=(0, 0, 0)) -> trimesh.Trimesh:
    return trimesh.creation.box(size).apply_translation(at)


VOLUME = 0.1 * 0.06 * 0.04


def tray() -> tuple[np.ndarray, np.ndarray]:
    """An open box of ten faces."""
    mesh = box()
    return mesh.vertices, mesh.faces[mesh.face_normals[:, 2] < 0.5]


def test_every_corner_apart_is_one_surface():
    mesh = box()
    apart = mesh.vertices[mesh.faces].reshape(-1, 3)
    body = mended(apart, np.arange(36).reshape(-1, 3))
    assert (len(body.vertices), body.notes) == (8, ())
    assert outward(body) == pytest.approx(VOLUME)


def test_a_seam_with_rounded_coordinates_is_welded():
    mesh = trimesh.creation.icosphere(2, 0.04)
    front = mesh.triangles_center[:, 0] > 0
    pieces = [mesh.submesh([np.flatnonzero(side)], append=True) for side in (front, ~front)]
    pieces[0].vertices += 2e-6
    whole = trimesh.util.concatenate(pieces)
    assert outward(mended(whole.vertices, whole.faces)) == pytest.approx(mesh.volume, rel=1e-3)


@pytest.mark.parametrize("extra", [(0, 0, 1), (0, 1, 8), (0, 1, 2)])
def test_slivers_and_second_copies_are_left_out(extra):
    mesh = box()
    vertices = np.vstack([mesh.vertices, mesh.vertices[[0, 1]].mean(axis=0) + 1e-9])
    if extra == (0, 1, 2):
        extra = tuple(mesh.faces[5])
    body = mended(vertices, np.vstack([mesh.faces, extra]))
    assert len(body.faces) == len(body.drawn) == 12
    assert outward(body) == pytest.approx(VOLUME)


def test_a_sliver_that_closes_the_surface_stays():
    """One side of an edge has a vertex in its middle, the other has not: a face without area fills what is between."""
    mesh = box()
    middle = len(mesh.vertices)
    a, b = mesh.faces[0][:2]
    faces = [f for f in mesh.faces.tolist() if f != mesh.faces[0].tolist()]
    c = mesh.faces[0][2]
    faces += [[a, middle, c], [middle, b, c]]
    vertices = np.vstack([mesh.vertices, mesh.vertices[[a, b]].mean(axis=0)])
    for each in (faces, [*faces, [middle, a, b]]):
        assert outward(mended(vertices, each)) == pytest.approx(VOLUME)


def test_two_sided_tray_is_a_sheet_and_a_two_sided_box_a_solid():
    vertices, faces = tray()
    body = mended(vertices, np.vstack([faces, faces[:, ::-1]]))
    assert body.is_sheet
    assert body.open_edges == 4
    assert len(body.faces) == len(body.drawn) == 10
    assert any("thin open shell" in note for note in body.notes)
    mesh = box()
    body = mended(mesh.vertices, np.vstack([mesh.faces[:, ::-1], mesh.faces]))
    assert not body.is_sheet
    assert outward(body) == pytest.approx(VOLUME)


def test_an_open_tray_is_not_filled():
    body = mended(*tray())
    assert not body.is_sheet
    assert body.open_edges == 4
    assert len(body.faces) == 10


def test_small_holes_are_closed_and_named():
    mesh = trimesh.creation.icosphere(3, 0.04)
    around = np.flatnonzero((mesh.faces == 20).any(axis=1))  # five or six faces
    kept = np.setdiff1d(np.arange(len(mesh.faces)), [*around, 700])
    body = mended(mesh.vertices, mesh.faces[kept])
    assert body.notes == ("small holes are closed",)
    assert outward(body) == pytest.approx(mesh.volume, rel=2e-3)
    assert len(body.drawn) == len(kept)


def test_a_wall_between_two_rooms_is_no_fault():
    left, right = box((0.05, 0.06, 0.04), (-0.025, 0, 0)), box((0.05, 0.06, 0.04), (0.025, 0, 0))
    whole = trimesh.util.concatenate([left, right])
    assert outward(mended(whole.vertices, whole.faces)) == pytest.approx(VOLUME)


def test_inside_out_is_turned_and_said():
    mesh = box()
    body = mended(mesh.vertices, mesh.faces[:, ::-1])
    assert body.notes == ("it was inside out and is turned",)
    assert body.turned.all()
    assert outward(body) == pytest.approx(VOLUME)


def test_mixed_winding_is_made_to_agree_and_said():
    mesh = trimesh.creation.icosphere(2, 0.04)
    faces = mesh.faces.copy()
    wrong = np.random.default_rng(0).choice(len(faces), 100, replace=False)
    faces[wrong] = faces[wrong, ::-1]
    body = mended(mesh.vertices, faces)
    assert body.notes == ("100 of 320 faces were wound against their neighbours and are turned",)
    np.testing.assert_array_equal(np.flatnonzero(body.turned), np.sort(wrong))
    assert outward(body) == pytest.approx(mesh.volume)


def test_patches_between_edges_of_four_faces_are_made_to_agree():
    pair = trimesh.util.concatenate([box(), box(at=(0.1, 0.06, 0))])
    pair.merge_vertices()
    faces = pair.faces.copy()
    faces[:12] = faces[:12, ::-1]
    assert outward(mended(pair.vertices, faces)) == pytest.approx(2 * VOLUME)


def test_a_surface_with_one_side_is_refused():
    """A Klein bottle: closed, and no winding agrees."""
    n, m = 24, 12
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n, endpoint=False), np.linspace(0, 2 * np.pi, m, endpoint=False))
    r = 0.1 + 0.03 * (np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v))
    z = 0.03 * (np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v))
    vertices = np.stack([r * np.cos(u), r * np.sin(u), z], axis=-1).transpose(1, 0, 2).reshape(-1, 3)

    def at(i: int, j: int) -> int:
        return (i % n) * m + (j % m if i < n else -j % m)

    faces = []
    for i in range(n):
        for j in range(m):
            a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            faces += [(a, b, c), (a, c, d)]
    with pytest.raises(ObjectError, match=r"x\.ply has faces wound both ways.*Recalculate"):
        mended(vertices, faces)


def test_cavities_count_less_and_overlaps_once():
    outer, inner = box(), box((0.08, 0.04, 0.02))
    inner.invert()
    hollow = trimesh.util.concatenate([outer, inner])
    assert outward(mended(hollow.vertices, hollow.faces)) == pytest.approx(VOLUME - 0.08 * 0.04 * 0.02)
    turned = mended(hollow.vertices, hollow.faces[:, ::-1])
    assert outward(turned) == pytest.approx(VOLUME - 0.08 * 0.04 * 0.02)
    one_inside_out = trimesh.util.concatenate([box(), box(at=(0.2, 0, 0))])
    faces = one_inside_out.faces.copy()
    faces[12:] = faces[12:, ::-1]
    body = mended(one_inside_out.vertices, faces)
    assert body.notes == ("a part of it was inside out and is turned",)
    assert outward(body) == pytest.approx(2 * VOLUME)
    cross = trimesh.util.concatenate([box((0.12, 0.02, 0.02)), box((0.02, 0.12, 0.02))])
    assert outward(mended(cross.vertices, cross.faces)) == pytest.approx((0.24 - 0.02) * 0.02**2, rel=0.01)
