"""The viewer: data that survives the trip into the page, text that cannot break out of it, a gripper to scale."""

from __future__ import annotations

import base64
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from grasping.errors import CloudError
from grasping.grasp import Grasp, GraspPlan, RegionReport
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.viewer.figure import Layer, fragment, score_rgb
from grasping.viewer.gripper_mesh import gripper_parts
from grasping.viewer.html import page

HAND_85 = Gripper.from_mapping(
    OmegaConf.to_container(OmegaConf.load(Path(__file__).parents[3] / "conf/gripper/robotiq_2f_85.yaml"))
)
HAND = Gripper("hand", 0.08, 0.02, 0.018, 0.01, max_force=70, min_force=5, palm_depth=0.066, depth_offset=0.1034)
HOSTILE = '</script><b>"it\'s" & co</b><!--'


def decoded(layer: dict) -> np.ndarray:
    codes = np.frombuffer(base64.b64decode(layer["xyz"]), dtype="<u2").reshape(-1, 3)
    return np.array(layer["origin"]) + codes * np.array(layer["step"])


def cloud(seed: int = 0, n: int = 300) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.05, 0.05, (n, 3)) + np.array([0, 0, 0.6])


def two_region_plan() -> GraspPlan:
    points = cloud()
    low, high = points[points[:, 0] < 0], points[points[:, 0] >= 0]
    regions = [
        RegionReport(low, "cylinder", 0.05, 0.011, "candidate", slab=0),
        RegionReport(high, "box", 0.05, 0.017, "candidate", slab=1),
        RegionReport(high[:20], "box", 0.2, 0.03, f"too wide {HOSTILE}", slab=1, cluster=0),
    ]
    grasps = []
    for index, score in ((1, 0.9), (0, 0.4)):
        pose = np.eye(4)
        pose[:3, 3] = regions[index].points.mean(axis=0)
        grasps.append(Grasp(pose, 0.05, score, "region", index, {"margin": 0.5}))
    return GraspPlan(grasps[0], grasps, regions, None)


def data_of(outline, html: str) -> dict:
    return json.loads(outline(page("t", html)).data[0])


def test_planning_does_not_load_what_writes_pages() -> None:
    command = "import sys, grasping; sys.exit(bool({'jinja2', 'scipy', 'matplotlib'} & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", command], check=True)


@given(st.integers(0, 2**32 - 1), st.integers(1, 400), st.floats(1e-3, 50))
@settings(max_examples=30, deadline=None)
def test_points_survive_the_trip_to_a_65535th_of_their_extent(seed: int, n: int, size: float) -> None:
    points = np.random.default_rng(seed).normal(0, size, (n, 3)).astype(np.float32)
    layers = json.loads(re.search(r'application/json">(.*?)</script>', fragment(cloud=points))[1])["layers"]
    assert np.all(np.abs(decoded(layers[0]) - points) <= np.ptp(points, axis=0) / 65535 + 1e-9)


def test_rows_with_nan_are_left_out_and_large_clouds_are_thinned_to_the_limit(outline) -> None:
    points = cloud(n=1000)
    points[::10] = np.nan
    assert len(decoded(data_of(outline, fragment(cloud=points))["layers"][0])) == 900
    thin = decoded(data_of(outline, fragment(cloud=points, max_points=200))["layers"][0])
    assert len(thin) == 200
    known = points[np.isfinite(points).all(axis=1)]
    assert np.abs(thin[:, None] - known[None]).max(axis=2).min(axis=1).max() < 1e-5


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"cloud": np.zeros((4, 2))}, r"cloud.*\(4, 2\)"),
        ({"cloud": np.full((4, 3), np.nan)}, "nothing to draw"),
        ({}, "nothing to draw"),
        ({"cloud": cloud(), "up": (0, 0, 0)}, "up"),
        ({"cloud": cloud(), "layers": [Layer(np.zeros(3), "flat")]}, r"layers\[0\].*\(3,\)"),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(arguments: dict, named: str) -> None:
    with pytest.raises(CloudError, match=named):
        fragment(**arguments)


def test_labels_and_titles_cannot_break_out_of_the_page(outline) -> None:
    layers = [Layer(cloud(1), HOSTILE, (HOSTILE,), group=HOSTILE), Layer(cloud(2), "b", group="other")]
    seen = outline(page(HOSTILE, fragment(two_region_plan(), layers=layers)))
    layer = next(layer for layer in json.loads(seen.data[0])["layers"] if layer["group"] == HOSTILE)
    assert layer["text"] == [HOSTILE, HOSTILE]
    assert seen.text.count(HOSTILE) >= 3  # title, button, legend


def test_regions_are_coloured_from_the_worst_score_to_the_best_and_carry_their_verdict(outline) -> None:
    layers = data_of(outline, fragment(two_region_plan()))["layers"]
    assert [layer["group"] for layer in layers] == ["Regions"] * 3
    assert len({tuple(layer["rgb"]) for layer in layers}) == 3
    assert "rank 1 of 2, score 0.9" in layers[1]["text"]
    assert layers[2]["text"][1] == f"too wide {HOSTILE}"


def test_the_legend_names_only_colours_that_are_seen(outline) -> None:
    plan = two_region_plan()
    assert "not grasped" in outline(page("t", fragment(plan))).text
    whole = Grasp(np.eye(4), 0.05, 0.9, "primitive")
    assert "not grasped" not in outline(page("t", fragment(GraspPlan(whole, [whole], plan.regions, None)))).text


def test_the_slider_steps_through_the_candidates_with_the_gripper_at_each(outline) -> None:
    plan = two_region_plan()
    html = fragment(plan)
    data = data_of(outline, html)
    assert 'max="1"' in html
    assert [grasp["layer"] for grasp in data["grasps"]] == [1, 0]
    parts = gripper_parts(ROBOTIQ_2F_140, plan.candidates[1].width)
    for part, pose in zip(parts, data["grasps"][1]["poses"], strict=True):
        expected = plan.candidates[1].pose @ part.T_grasp_part
        np.testing.assert_allclose(np.reshape(pose, (3, 4)), expected[:3], atol=1e-5)


def test_a_plan_without_a_grasp_and_a_lone_point_are_drawn(outline) -> None:
    regions = two_region_plan().regions
    assert data_of(outline, fragment(GraspPlan(None, [], regions, "all too wide")))["grasps"] == []
    assert data_of(outline, fragment(cloud=np.zeros((1, 3))))["radius"] > 0


@pytest.mark.parametrize("gripper", [ROBOTIQ_2F_140, HAND_85, HAND])
@given(share=st.floats(0, 1))
@settings(max_examples=30, deadline=None)
def test_pads_are_as_far_apart_as_the_opening_and_the_palm_stands_at_the_flange(gripper, share: float) -> None:
    opening = share * gripper.stroke
    corners = {
        part.name: part.vertices @ part.T_grasp_part[:3, :3].T + part.T_grasp_part[:3, 3]
        for part in gripper_parts(gripper, opening)
    }
    assert corners["right pad"][:, 0].min() == pytest.approx(opening / 2)
    assert corners["left pad"][:, 0].max() == pytest.approx(-opening / 2)
    assert np.ptp(corners["left pad"], axis=0) == pytest.approx(
        [gripper.finger_thickness, gripper.finger_width, gripper.pad_length]
    )
    assert corners["palm"][:, 2].min() == pytest.approx(-gripper.pad_depth(opening))
    assert np.ptp(corners["palm"][:, 2]) == pytest.approx(gripper.palm_depth)


@pytest.mark.parametrize("gripper", [ROBOTIQ_2F_140, HAND_85, HAND])
def test_parts_are_rigid_closed_and_face_outwards(gripper) -> None:
    closed, wide = gripper_parts(gripper, 0.0), gripper_parts(gripper, gripper.stroke)
    for one, other in zip(closed, wide, strict=True):
        np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-9)
        np.testing.assert_allclose(one.T_grasp_part[:3, :3] @ one.T_grasp_part[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(one.T_grasp_part[:3, :3]) == pytest.approx(1)
        edges = np.sort(one.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)
        a, b, c = np.moveaxis(one.vertices[one.faces], 1, 0)
        assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 > 0


def test_a_palm_with_measures_is_drawn_to_scale() -> None:
    panda = replace(HAND, palm_width=0.204, palm_breadth=0.063)
    (palm,) = [part for part in gripper_parts(panda, 0.04) if part.name == "palm"]
    assert np.ptp(palm.vertices, axis=0) == pytest.approx([0.204, 0.063, 0.066])
    (palm,) = [part for part in gripper_parts(HAND_85, 0.04) if part.name == "palm"]
    assert np.ptp(palm.vertices, axis=0) == pytest.approx([0.075, 0.075, 0.0665], abs=1e-3)


def test_without_a_plan_the_gripper_steps_through_the_layers_best_first(outline) -> None:
    grasps = [Grasp(np.eye(4), 0.04, score, "region", 7) for score in (0.3, 0.8)]
    layers = [
        Layer(cloud(1), "low", rgb=score_rgb(0.3), grasp=grasps[0]),
        Layer(cloud(2), "none", rgb=score_rgb(None)),
        Layer(cloud(3), "high", rgb=score_rgb(0.8), grasp=grasps[1]),
    ]
    data = data_of(outline, fragment(layers=layers))
    assert [(grasp["layer"], grasp["text"][0]) for grasp in data["grasps"]] == [(2, "high"), (0, "low")]
    assert len({tuple(layer["rgb"]) for layer in data["layers"]}) == 3


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_all_of_the_subject_is_in_the_first_picture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (200, 3)) * rng.uniform(0.01, 0.3, 3) + rng.uniform(-1, 1, 3)
    up = rng.normal(size=3)
    html = fragment(layers=[Layer(points, "a")], up=up)
    data = json.loads(re.search(r'application/json">(.*?)</script>', html)[1])
    eye, towards = np.array(data["eye"]), points - data["target"]
    right = np.cross(data["up"], eye) / np.linalg.norm(np.cross(data["up"], eye))
    ahead = data["distance"] - towards @ eye
    edge = ahead * np.tan(data["field_of_view"] / 2)
    assert (np.abs(towards @ right) <= edge).all()
    assert (np.abs(towards @ np.cross(eye, right)) <= edge).all()


@pytest.fixture
def opened(browse):
    """A page of twenty figures, the first in sight."""
    figures = [fragment(two_region_plan(), layers=[Layer(cloud(), HOSTILE)], up=(0, 0, -1))] * 20
    return browse(page("t", "".join(figures)))


LOOK = "(({yaw, pitch, zoom, grasp, group}) => ({yaw, pitch, zoom, grasp, group}))(document.querySelector('.pgv').pgv)"


def pointer(opened, kind: str, x: float, y: float, **more) -> None:
    opened.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


def middle(opened, selector: str) -> tuple[float, float]:
    box = opened.run(f"document.querySelector({selector!r}).getBoundingClientRect().toJSON()")
    return box["left"] + box["width"] / 2, box["top"] + box["height"] / 2


def test_the_pointer_turns_and_the_wheel_zooms(opened) -> None:
    x, y = middle(opened, "canvas")
    first = opened.run(LOOK)
    pointer(opened, "mousePressed", x, y, button="left", buttons=1)
    pointer(opened, "mouseMoved", x + 50, y + 20, button="left", buttons=1)
    pointer(opened, "mouseReleased", x + 50, y + 20, button="left")
    opened.until(f"{LOOK}.yaw !== {first['yaw']!r}")
    turned = opened.run(LOOK)
    assert turned["yaw"] == pytest.approx(first["yaw"] - 0.5)
    assert turned["pitch"] == pytest.approx(min(np.pi / 2, first["pitch"] + 0.2))
    for _ in range(5):  # a browser that has just been opened may lose a click of the wheel
        pointer(opened, "mouseWheel", x, y, deltaX=0, deltaY=-100)
        opened.wait(60)
        if opened.run(LOOK)["zoom"] != first["zoom"]:
            break
    assert opened.run(LOOK)["zoom"] > 1.1
    assert opened.run("scrollY") == 0
    opened.run("document.querySelector('.pgv-reset').click()")
    assert opened.run(LOOK) == first
    assert opened.console == []


def test_pointing_at_a_region_names_it(opened) -> None:
    opened.run("document.querySelector('.pgv-gripper input').click()")
    opened.wait()
    x, y = middle(opened, "canvas")
    names = set()
    for dx in range(-200, 201, 40):
        for dy in range(-200, 201, 40):
            pointer(opened, "mouseMoved", x + dx, y + dy)
            names.add(opened.run("document.querySelector('.pgv-tip:not([hidden]) div')?.textContent"))
    assert {"region 0: cylinder", "region 1: box", None} <= names
    assert opened.console == []


def test_the_slider_and_the_switch_choose_what_is_seen(opened) -> None:
    before = opened.run("document.querySelector('canvas').toDataURL()")
    opened.run(
        "const slider = document.querySelector('input[type=range]'); slider.value = 1; "
        "slider.dispatchEvent(new Event('input')); document.querySelectorAll('[data-group]')[1].click()"
    )
    opened.wait()
    look = opened.run(LOOK)
    assert (look["grasp"], look["group"]) == (1, "Objects")
    assert opened.run("document.querySelector('output').textContent").startswith("2 of 2: region 0")
    assert opened.run("document.querySelectorAll('.pgv-legend:not([hidden])')[0].textContent") == HOSTILE
    assert opened.run("document.querySelector('canvas').toDataURL()") != before
    assert opened.console == []


def test_figures_out_of_sight_hold_no_pixels_and_come_back(opened) -> None:
    count = "[...document.querySelectorAll('canvas')].filter((canvas) => canvas.width === 0).length"
    assert 10 <= opened.run(count) < 20
    opened.run("[...document.querySelectorAll('.pgv')].at(-1).scrollIntoView()")
    opened.wait(10)
    assert opened.run("[...document.querySelectorAll('canvas')].at(-1).width") > 0
    assert opened.run("document.querySelector('canvas').width") == 0
