"""Models from meshes: samples of the surface, what is refused, and the cache."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from mesh_shapes import ball, bottle, box, join, lathe, mug, prism, write_ply
from scipy.spatial import cKDTree

from grasping.errors import ModelError
from grasping.pose.object_model import ModelWarning, cache_folder, load_models, object_model


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_samples_lie_on_the_surface_and_keep_their_distance():
    model = object_model(*ball(0.05), "ball", n_points=1000)
    assert model.points.shape == model.normals.shape == (1000, 3)
    radius = np.linalg.norm(model.points, axis=1)
    assert np.abs(radius - 0.05).max() < 0.0006  # of a ball with flat faces
    assert (np.einsum("ij,ij->i", model.normals, model.points) > 0.99 * radius).all()
    apart = cKDTree(model.points).query(model.points, k=2)[0][:, 1]
    widest = np.sqrt(4 * np.pi * 0.05**2 / (2 * np.sqrt(3) * 1000)) * 2  # of disks that fill the plane
    assert apart.min() > 0.6 * widest  # of random points it is a hundredth
    assert model.diameter == pytest.approx(0.1, abs=1e-4)


def test_as_many_samples_on_each_share_of_the_surface_as_its_area_has():
    model = object_model(*box(0.05, 0.08, 0.13), "box")
    areas = np.array([0.08 * 0.13, 0.05 * 0.13, 0.05 * 0.08])
    counts = np.array([(np.abs(model.normals[:, k]) > 0.9).sum() for k in range(3)])
    np.testing.assert_allclose(counts / 1500, areas / areas.sum(), atol=0.02)


def test_normals_point_outwards_however_the_faces_are_wound():
    vertices, faces = box(0.05, 0.08, 0.13)
    rng = np.random.default_rng(3)
    wound = np.where(rng.random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces)
    for each in (faces, faces[:, ::-1], wound):
        model = object_model(vertices, each, "box")
        assert (np.einsum("ij,ij->i", model.normals, model.points) > 0).all()


def test_what_no_camera_sees_is_no_part_of_the_model():
    shell, motor = box(0.1, 0.1, 0.1), box(0.05, 0.05, 0.05)
    model = object_model(*join(shell, motor), "machine")
    assert np.abs(model.points).max(axis=1).min() > 0.049


def test_the_inside_of_a_cup_is_seen_and_faces_inwards():
    model = object_model(*mug(), "mug")
    inner = np.abs(np.linalg.norm(model.points[:, :2], axis=1) - 0.036) < 0.0005
    inner &= np.abs(model.points[:, 2]) < 0.03
    assert inner.sum() > 100
    assert (np.einsum("ij,ij->i", model.normals[inner, :2], model.points[inner, :2]) < 0).all()


def test_the_same_mesh_makes_the_same_model_from_the_cache_or_not():
    first = object_model(*bottle(), "one")
    assert len(list(cache_folder().iterdir())) == 1
    second = object_model(*bottle(), "other", "class")
    assert (second.name, second.label, first.label) == ("other", "class", "one")
    for file in cache_folder().iterdir():
        file.write_bytes(b"half of a file")
    third = object_model(*bottle(), "one")
    for other in (second, third):
        np.testing.assert_array_equal(first.points, other.points)
        np.testing.assert_array_equal(first.normals, other.normals)
        np.testing.assert_array_equal(first.symmetry.turns, other.symmetry.turns)
        np.testing.assert_array_equal(first.symmetry.axis, other.symmetry.axis)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        pytest.param(
            (box(0.1, 0.1, 0.1)[0] * (1, 1, 0), box(1, 1, 1)[1]), "flat sheet: it encloses no volume", id="flat"
        ),
        pytest.param(lathe([(0.03, 0), (0.03, 0.1)]), "encloses no volume", id="tube"),
        pytest.param((box(60, 80, 130)), "say scale=0.001", id="millimetres"),
        pytest.param((box(1, 2, 3)), "say scale=0.01", id="centimetres"),
        pytest.param((box(1e-4, 1e-4, 1e-4)), "scale is 1: metres in one unit", id="tiny"),
        pytest.param((box(0.1, 0.1, 0.1)[0] * np.nan, box(1, 1, 1)[1]), "not numbers", id="nan"),
        pytest.param((box(0.1, 0.1, 0.1)[0][:5], box(1, 1, 1)[1]), "beyond its 5", id="missing vertices"),
    ],
)
def test_a_mesh_that_is_no_model_is_refused_by_name(mesh, message):
    with pytest.raises(ModelError, match=f"^it .*{message}"):
        object_model(*mesh, "it")


def test_an_open_shell_may_be_taken_and_is_seen_from_both_sides():
    model = object_model(*lathe([(0.03, 0), (0.03, 0.1)]), "tube", allow_open=True)
    outwards = np.einsum("ij,ij->i", model.normals[:, :2], model.points[:, :2]) > 0
    assert 0.3 < outwards.mean() < 0.7


def test_a_folder_of_classes_and_loose_meshes(tmp_path):
    write_ply(tmp_path / "m" / "tin" / "a.ply", prism(40, 0.04, 0.1))
    write_ply(tmp_path / "m" / "carton" / "a.ply", box(0.06, 0.1, 0.2))
    write_ply(tmp_path / "m" / "carton" / "b.ply", box(0.06, 0.06, 0.2))
    write_ply(tmp_path / "m" / "loose.ply", bottle())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        models = load_models(tmp_path / "m")
    assert [(m.label, m.name) for m in models] == [
        ("loose", "loose"),
        ("carton", "carton/a"),
        ("carton", "b"),
        ("tin", "tin/a"),
    ]
    assert [m.name for m in load_models(tmp_path / "m", classes=["tin"])] == ["a"]
    with pytest.raises(ModelError, match="no class 'cup'"):
        load_models(tmp_path / "m", classes=["cup"])


def test_folders_without_meshes_are_refused(tmp_path):
    with pytest.raises(ModelError, match="is not a folder"):
        load_models(tmp_path / "nowhere")
    with pytest.raises(ModelError, match="has no meshes"):
        load_models(tmp_path)
    (tmp_path / "broken.ply").write_text("ply\n")
    with pytest.raises(ModelError, match=r"broken\.ply"):
        load_models(tmp_path)


def test_millimetres_are_taken_with_a_scale(tmp_path):
    write_ply(tmp_path / "carton.ply", box(0.06, 0.1, 0.2), scale=1000)
    with pytest.raises(ModelError, match=r"carton\.ply .*say scale=0\.001"):
        load_models(tmp_path)
    assert load_models(tmp_path, scale=0.001)[0].diameter == pytest.approx(np.hypot(np.hypot(0.06, 0.1), 0.2))


def test_one_mesh_twice_is_refused_and_two_that_are_alike_are_named(tmp_path):
    write_ply(tmp_path / "a" / "one.ply", box(0.06, 0.1, 0.2))
    write_ply(tmp_path / "a" / "other.ply", box(0.06, 0.08, 0.2))
    turned = box(0.2, 0.06, 0.1)  # the first, lying
    write_ply(tmp_path / "b" / "lying.ply", turned)
    with pytest.warns(ModelWarning, match=r"one \(a\) and lying \(b\) are alike") as caught:
        load_models(tmp_path)
    assert len(caught) == 1
    write_ply(tmp_path / "b" / "copy.ply", turned)
    with pytest.raises(ModelError, match="are one mesh"):
        load_models(tmp_path)
