"""Measuring poses: what a right, a symmetric, a wrong and a missing one count, and a run that goes on."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from grasping.pose.depth_image import depth_image
from grasping.pose.object_model import object_model
from grasping.pose.object_pose import Ambiguity, ObjectPose
from pecgrasp_env.experiments.known_poses import methods
from pecgrasp_env.experiments.known_poses.cases import CloudCase, FrameCase, partly_hidden
from pecgrasp_env.experiments.known_poses.page import render
from pecgrasp_env.experiments.known_poses.run import RIGHT, VSD_LEAST, Rows, errors, frame_errors, run_clouds
from pecgrasp_env.experiments.known_poses.tables import MEASURES, cloud_results, frame_results, table
from pecgrasp_env.experiments.known_poses.task_scenes import task_frames

QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def block(x: float, y: float, z: float, at=(0.0, 0.0, 0.0)):
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * (x / 2, y / 2, z / 2) + at
    return corners, np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))], np.int32)


@pytest.fixture(scope="module")
def model():
    """Two blocks, of no symmetry."""
    (v, f), (w, g), (u, h) = (
        block(0.05, 0.08, 0.13),
        block(0.06, 0.02, 0.03, (0.05, 0.02, 0.04)),
        block(0.02, 0.03, 0.02, (0, 0.05, -0.05)),
    )
    return object_model(np.concatenate([v, w, u]), np.concatenate([f, g + 8, h + 16]), "thing")


def case(model, seed: int) -> CloudCase:
    """The side that a camera in the origin sees, hiding itself by its normals alone."""
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    T[:3, 3] = (0.05, -0.02, 0.6)
    points, normals = model.points @ T[:3, :3].T + T[:3, 3], model.normals @ T[:3, :3].T
    seen = np.einsum("ij,ij->i", points, normals) < -0.2 * np.linalg.norm(points, axis=1)
    return CloudCase(f"case {seed}", model, points[seen] + rng.normal(0, 2e-4, (seen.sum(), 3)), T, 0.0)


def test_no_pose_counts_as_infinitely_far(model):
    rows = [
        {"object": "thing", **errors(model, T, np.eye(4))}
        for T in (np.eye(4), np.diag([1.0, -1, -1, 1]), None, np.eye(4))
    ]
    shares = {name: measure(rows) for name, measure in MEASURES.items()}
    assert shares["no pose"] == 0.25
    assert shares["MSSD < 10 %"] == shares["ADD(-S) < 10 %"] == 0.5
    assert 0.5 <= shares["AUC ADD-S"] < 0.75


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_a_part_is_hidden_beyond_a_straight_edge(model, share):
    whole = case(model, 0)
    assert partly_hidden(whole, 0.0) is whole
    part = partly_hidden(replace(whole, occlusion=0.5), share)
    assert len(part.points) == pytest.approx((1 - share) * len(whole.points), abs=1)
    assert part.occlusion == pytest.approx(1 - 0.5 * (1 - share))
    kept = (whole.points[:, None] == part.points).all(axis=2).any(axis=1)
    picture = np.column_stack([whole.points[:, :2] / whole.points[:, 2:], np.ones(len(whole.points))])
    assert linprog(
        np.zeros(3), A_ub=np.where(kept, -1, 1)[:, None] * picture, b_ub=-1e-6 * np.ones(len(kept)), bounds=(None, None)
    ).success
    np.testing.assert_array_equal(part.points, partly_hidden(replace(whole, occlusion=0.5), share).points)


def test_a_run_goes_on_where_it_was_stopped(model, tmp_path):
    cases, steps = [case(model, seed) for seed in range(3)], []
    first = Rows(tmp_path / "rows.jsonl")
    run_clouds("made", cases[:2], ["geometry"], first, lambda done, total: steps.append((done, total)))
    (tmp_path / "rows.jsonl").open("a").write('{"half of a li')
    again = Rows(tmp_path / "rows.jsonl")
    assert again.rows == first.rows
    run_clouds("made", cases, ["geometry"], again, lambda done, total: steps.append((done, total)))
    assert [row["case"] for row in again.rows] == ["case 0", "case 1", "case 2"]
    assert steps == [(1, 2), (2, 2), (1, 3), (2, 3), (3, 3)]
    (result,) = cloud_results(again.rows)
    assert (result["n"], result["objects"], result["method"]) == (3, 1, "geometry")
    assert result["measures"]["ADD-S < 2 cm"][0] == 1
    assert "| made | geometry | 3 | 1 | 100.0 % (100–100)" in table([result], [])


@pytest.mark.parametrize("name", ["opencv_ppf", "open3d_fpfh"])
def test_the_others_run_where_they_are_installed(name, model):
    if not methods.installed(name):
        pytest.skip("pip install 'pecgrasp[pose-rivals]'")
    T = methods.method(name, model)(case(model, 1).points)
    assert T is None or np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6)


def test_frames_count_the_known_the_twins_and_the_strangers():
    def thing(name, visible=1.0, off=None, given=None, off_open=None, vsd=None):
        return {
            "name": name,
            "visible": visible,
            "off": off,
            "off_open": off if off_open is None else off_open,
            "vsd": vsd,
            "given": given,
        }

    objects = [
        thing("mug", off=0.02, given="mug", vsd=0.1),
        thing("mug", off=0.5, given="mug", off_open=0.03, vsd=0.2),
        thing("can", visible=0.3),  # too hidden to count
        thing("box", off=None, given="can"),
        thing(None),
        thing(None, given="can"),
    ]
    row = {"group": "g", "kind": "piled", "seconds": 0.1, "on_nothing": 0, "objects": objects}
    result = frame_results([row])[0]
    assert (result["found"]["count"], result["found"]["n"]) == (1, 3)
    assert (result["found_or_left_open"]["count"], result["found_by_vsd"]["count"]) == (2, 2)
    assert (result["two_of_a_kind_both"]["count"], result["two_of_a_kind_both"]["n"]) == (0, 1)
    assert result["two_of_a_kind_both_or_left_open"]["count"] == 1
    assert (result["stranger_given_a_pose"]["count"], result["stranger_given_a_pose"]["n"]) == (1, 2)
    assert (result["wrong_model"]["count"], result["wrong_model"]["n"]) == (1, 3)
    assert "1 of 2, 50 %" in table([], [result])


def test_the_page_names_what_was_missed_and_draws_a_line_a_method(model, tmp_path):
    rows = Rows(tmp_path / "rows.jsonl")
    run_clouds("made <here>", [case(model, 0), partly_hidden(case(model, 1), 0.5)], ["geometry"], rows, lambda *_: None)
    objects = [
        {"name": "mug", "visible": 1.0, "off": 0.5, "off_open": 0.5, "vsd": 0.9, "given": "can"},
        {"name": "box", "visible": 1.0, "off": 0.02, "off_open": 0.02, "vsd": 0.1, "given": "box"},
        {"name": "can", "visible": 0.3, "off": None, "off_open": None, "vsd": None, "given": None},
        {"name": None, "visible": 0.8, "off": None, "off_open": None, "vsd": None, "given": "box"},
    ]
    rows.add(
        {"group": "g", "case": "frame 7", "method": "geometry", "kind": "piled", "seconds": 0.1, "objects": objects}
    )
    page = render(rows.rows, cloud_results(rows.rows), frame_results(rows.rows))
    text = " ".join(page.split())
    assert "made &lt;here&gt;" in text
    assert "<here>" not in text
    assert text.count("<svg") == 2  # over the distance, and over what is hidden
    for cells in (
        ("frame 7", "piled", "mug", "100 %", "can", "50 %"),
        ("frame 7", "piled", "a stranger", "80 %", "box", "–"),
        ("20–40 %", "0 of 1", "0 %"),
        ("80–100 %", "1 of 2", "50 %"),
    ):
        assert "".join(f"<td>{cell}</td>" for cell in cells) in text
    assert text.count("<td>frame 7</td>") == 2


def test_a_turn_that_the_view_leaves_open_is_far_off_but_right_by_what_is_seen():
    """A block with a knob on its far side: half a turn about the line of sight moves nothing that is seen."""
    (v, f), (w, g) = block(0.08, 0.08, 0.12), block(0.02, 0.02, 0.02, (0.025, 0.01, 0.07))
    knob = object_model(np.concatenate([v, w]), np.concatenate([f, g + 8]), "knob", allow_open=True)
    camera = np.array([[200.0, 0, 79.5], [0, 200.0, 59.5], [0, 0, 1]])
    T_true = np.eye(4)
    T_true[2, 3] = 0.6
    turned = T_true @ np.diag([-1.0, -1.0, 1.0, 1.0])
    depth = depth_image(knob.vertices, knob.faces, T_true, camera, (120, 160))
    rows, columns = np.indices(depth.shape)
    ray = np.stack([(columns - 79.5) / 200, (rows - 59.5) / 200, np.ones(depth.shape)], axis=-1)
    cloud = np.where(depth[..., None] > 0, ray * depth[..., None], np.nan)
    labels = (depth > 0).astype(np.int64)
    frame = FrameCase("f", "apart", cloud, camera, labels, ("knob",), T_true[None], np.ones(1))
    nothing_open = Ambiguity(knob.symmetry, np.empty((0, 4, 4)))
    right = ObjectPose(T_true, knob, 1.0, 0.0, nothing_open, 1.0, 0.0, np.empty(0, np.int64))
    wrong = replace(right, T_camera_object=turned, ambiguous=replace(nothing_open, others=T_true[None]))
    errors_of = frame_errors(frame, knob, right, 0)
    assert errors_of == pytest.approx({"off": 0, "off_open": 0, "vsd": 0}, abs=1e-9)
    errors_of = frame_errors(frame, knob, wrong, 0)
    assert errors_of["off"] > RIGHT
    assert errors_of["off_open"] == pytest.approx(0, abs=1e-9)
    assert errors_of["vsd"] < VSD_LEAST


def test_what_is_not_installed_is_known_without_loading_it():
    assert methods.installed("geometry")
    assert methods.installed("open3d_fpfh") == (importlib.util.find_spec("open3d") is not None)


@pytest.mark.slow  # the simulator
def test_scenes_of_the_task_say_where_everything_is(tmp_path):
    for label, mesh in {
        "brick": trimesh.creation.box((0.05, 0.07, 0.1)),
        "tin": trimesh.creation.cylinder(0.03, 0.09),
    }.items():
        (tmp_path / label).mkdir()
        mesh.export(tmp_path / label / "one.ply")
    settings = {"models": tmp_path, "strangers": None, "n_objects": 3, "n_strangers": 1, "scenes": 1, "first_seed": 3}
    models, frames = task_frames("apart", {**settings, "sensor": "ideal", "resolution": "424x240"})
    (frame,) = frames
    known = {model.name: model for model in models}
    assert sorted(name or "" for name in frame.names)[0] == ""
    assert len(set(frame.names) - {None}) == 2
    assert len(frame.names) == 4
    assert ((frame.visible >= 0) & (frame.visible <= 1)).all()
    for k, name in enumerate(frame.names):
        points = frame.cloud[frame.labels == k + 1]
        assert len(points) > 100
        if name is not None:
            local = (points - frame.T_true[k, :3, 3]) @ frame.T_true[k, :3, :3]
            assert np.quantile(cKDTree(known[name].points).query(local)[0], 0.9) < 0.005
