"""A grasp from one depth picture, without a simulator and with no arm of ours."""

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from grasping import ROBOTIQ_2F_140, ModelPlanner
from grasping.pose.object_model import object_model
from pecgrasp_env.policy.observation import ObservationError
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.policy.viewpoints import look_at
from pecgrasp_env.robot import forward_kinematics, tool0_from_grasp
from pecgrasp_env.robot.kinematics import HOME
from pecgrasp_env.sensor import D435

CAMERA = look_at((0.5, 0.0, 0.55), (0.5, 0.0, 0.0))
INTRINSICS = D435["424x240"]


def depth_of(*boxes):
    """(H, W) m of a table under CAMERA with upright boxes (x, y, half x, half y, height), by casting rays."""
    columns, rows = np.meshgrid(np.arange(INTRINSICS.width) + 0.5, np.arange(INTRINSICS.height) + 0.5)
    x, y = (columns - INTRINSICS.cx) / INTRINSICS.fx, (rows - INTRINSICS.cy) / INTRINSICS.fy
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ CAMERA[:3, :3].T
    origin = CAMERA[:3, 3]
    depth = -origin[2] / rays[..., 2]
    for centre_x, centre_y, half_x, half_y, height in boxes:
        with np.errstate(divide="ignore"):
            low = (np.array([centre_x - half_x, centre_y - half_y, 0.0]) - origin) / rays
            high = (np.array([centre_x + half_x, centre_y + half_y, height]) - origin) / rays
        enter, leave = np.minimum(low, high).max(axis=-1), np.maximum(low, high).min(axis=-1)
        depth = np.where(enter < leave, np.minimum(depth, enter), depth)
    return depth.astype(np.float32)


BRICK, SLAB = (0.45, -0.10, 0.03, 0.06, 0.05), (0.58, 0.12, 0.07, 0.02, 0.03)
SCENE = depth_of(BRICK, SLAB)


def by_size(points):
    """Stands for a classifier: a brick is higher than a slab, seen from the camera."""
    return ("brick" if np.ptp(points, axis=0).min() > 0.05 or points[:, 2].min() < 0.515 else "slab"), 0.97


def brick_model(name="a_brick", label="brick"):
    half = np.array([BRICK[2], BRICK[3], BRICK[4] / 2])
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return object_model(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], name, label)


def test_a_planner_with_models_plans_on_the_model_of_the_class_and_says_where_it_has_none(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    policy = ScriptedPolicy(by_size, ModelPlanner(models=[brick_model()]))
    pick = policy.plan_only(SCENE, INTRINSICS, CAMERA, "brick")
    assert pick.plan.source.startswith("the model a_brick")
    assert pick.T_base_grasp[:2, 3] == pytest.approx(BRICK[:2], abs=0.02)
    assert policy.log.doubts == []
    pick = policy.plan_only(SCENE, INTRINSICS, CAMERA, "slab")
    assert pick.reason is None
    assert policy.log.doubts == ["planned on the cloud: no model is of class slab"]


@pytest.mark.parametrize(("name", "box"), [("brick", BRICK), ("slab", SLAB)])
def test_the_pose_holds_the_object_that_was_asked_for(name, box):
    pick = ScriptedPolicy(by_size).plan_only(SCENE, INTRINSICS, CAMERA, name)
    assert pick.reason is None
    assert pick.confidence == pytest.approx(0.97)
    assert len(pick.objects) == 2
    assert pick.objects[pick.chosen].centroid[:2] == pytest.approx(box[:2], abs=0.01)
    assert pick.T_base_grasp[:2, 3] == pytest.approx(box[:2], abs=0.02)
    assert pick.T_base_grasp[2, 2] < -0.99
    thin = 2 * min(box[2:4])
    assert pick.width == pytest.approx(thin, abs=0.008)
    closing = pick.T_base_grasp[:2, 0]
    assert abs(closing[0 if box[2] < box[3] else 1]) > 0.98
    assert pick.width < pick.opening <= ROBOTIQ_2F_140.stroke
    assert pick.T_base_tool0 == pytest.approx(tool0_from_grasp(pick.T_base_grasp, pick.width))
    assert pick.approach is None


def test_from_joint_angles_there_are_paths_that_lead_to_the_pose():
    pick = ScriptedPolicy(by_size).plan_only(SCENE, INTRINSICS, CAMERA, "slab", q=HOME, opening=0.14)
    assert pick.approach.to_pregrasp[0] == pytest.approx(HOME)
    assert pick.approach.to_grasp[0] == pytest.approx(pick.approach.to_pregrasp[-1])
    assert pick.approach.to_close[0] == pytest.approx(pick.approach.to_grasp[-1])
    for opening in (pick.opening, 0.7 * pick.opening, pick.width, 0.004, 0.0):
        T_base_tool0 = forward_kinematics(pick.approach.posture_at(opening))
        assert T_base_tool0 == pytest.approx(tool0_from_grasp(pick.T_base_grasp, opening), abs=2e-4)
    assert forward_kinematics(pick.approach.posture_at(pick.width)) == pytest.approx(pick.T_base_tool0, abs=2e-4)
    lifted = forward_kinematics(pick.approach.to_lift[-1])
    assert lifted[2, 3] == pytest.approx(pick.T_base_tool0[2, 3] + 0.25, abs=1e-9)


def test_what_is_not_there_is_not_found_and_what_is_too_large_has_no_grasp():
    policy = ScriptedPolicy(by_size)
    pick = policy.plan_only(SCENE, INTRINSICS, CAMERA, "mug")
    assert (pick.chosen, pick.T_base_grasp, pick.reason) == (None, None, "not found")
    block = depth_of((0.5, 0.0, 0.09, 0.09, 0.06))
    pick = ScriptedPolicy(None).plan_only(block, INTRINSICS, CAMERA, "anything")
    assert pick.chosen == 0
    assert pick.T_base_grasp is None
    assert pick.reason.startswith("no grasp: ")
    assert "wide" in pick.reason


class Sees:
    """Takes both for a brick. known: how surely the brick and the slab, in the view that there is."""

    n_points = 1

    def __init__(self, known):
        self.known = known

    def predict(self, clouds):
        of_brick, of_slab = self.known
        return [self.answer(of_brick if by_size(cloud)[0] == "brick" else of_slab) for cloud in clouds]

    @staticmethod
    def answer(known):
        return SimpleNamespace(label="brick", confidence=0.98, probabilities={"brick": 0.98, "slab": 0.02}, known=known)


def test_one_sure_view_is_enough_to_touch_and_to_say_that_nothing_is_there():
    pick = ScriptedPolicy(by_size).plan_only(SCENE, INTRINSICS, CAMERA, "slab")
    assert (pick.doubt, pick.absent) == (None, False)
    pick = ScriptedPolicy(by_size).plan_only(SCENE, INTRINSICS, CAMERA, "mug")
    assert (pick.doubt, pick.absent) == (None, True)


def test_in_doubt_it_asks_for_another_view_and_joins_them():
    policy = ScriptedPolicy(Sees((0.8, 0.02)))
    first = policy.plan_only(SCENE, INTRINSICS, CAMERA, "brick")
    assert first.chosen is not None
    assert first.doubt == "whether one of them is a brick is unsure (0.78)"
    policy.classifier.known = (0.995, 0.02)
    second = policy.plan_only(SCENE, INTRINSICS, CAMERA, "brick", before=first)
    assert second.doubt is None
    assert [len(seen.evidence) for seen in second.objects] == [2, 2]
    assert [len(seen.evidence) for seen in first.objects] == [1, 1]
    unsure = ScriptedPolicy(Sees((0.4, 0.02))).plan_only(SCENE, INTRINSICS, CAMERA, "brick")
    assert (unsure.chosen, unsure.absent) == (None, False)
    assert "brick" in unsure.doubt


def test_out_of_the_arms_reach_there_is_a_pose_but_no_path():
    far = np.diag([1.0, 1.0, 1.0, 1.0])
    far[0, 3] = 0.6
    policy = ScriptedPolicy(by_size)
    assert policy.plan_only(SCENE, INTRINSICS, far @ CAMERA, "slab").T_base_grasp is not None
    pick = policy.plan_only(SCENE, INTRINSICS, far @ CAMERA, "slab", q=HOME)
    assert pick.T_base_grasp is None
    assert pick.reason.startswith("no motion: ")
    assert "reach" in pick.reason


def test_without_a_classifier_it_is_the_largest_thing():
    pick = ScriptedPolicy(None).plan_only(SCENE, INTRINSICS, CAMERA, "anything")
    assert len(pick.objects[pick.chosen].points) == max(len(seen.points) for seen in pick.objects)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"depth": SCENE[:100]}, "depth has shape"),
        ({"depth": 1000 * SCENE}, "give metres, not millimetres"),
        ({"intrinsics": INTRINSICS.matrix}, "must be CameraIntrinsics"),
        ({"intrinsics": replace(INTRINSICS, fx=1.88, fy=1.88)}, "focal lengths 1.88 and 1.88 are not plausible"),
        ({"intrinsics": replace(D435["848x480"], width=424, height=240)}, "centre 424, 240 is far from the middle"),
        ({"T_base_camera": np.eye(3)}, "T_base_camera"),
        ({"T_base_camera": 2 * np.eye(4)}, "T_base_camera"),
        ({"q": np.zeros(7)}, "q must be six"),
        ({"opening": 0.2}, "opening=0.2"),
    ],
)
def test_input_that_makes_no_sense_is_named(change, words):
    arguments = {"depth": SCENE, "intrinsics": INTRINSICS, "T_base_camera": CAMERA, "target": "slab", **change}
    with pytest.raises(ObservationError, match=words):
        ScriptedPolicy(by_size).plan_only(**arguments)


def test_it_needs_neither_simulator_nor_torch():
    program = """
import sys
class Blocker:
    def find_spec(self, name, *_):
        if name.split(".")[0] in ("sapien", "mani_skill", "torch"):
            raise ImportError(name + " is not installed")
sys.meta_path.insert(0, Blocker())
import numpy as np
from pecgrasp_env import ScriptedPolicy
from pecgrasp_env.sensor import D435
from pecgrasp_env.policy.viewpoints import look_at
from pecgrasp_env.robot.kinematics import HOME
depth = np.full((240, 424), 0.55, np.float32)
depth[100:130, 190:230] = 0.50
pick = ScriptedPolicy(None).plan_only(depth, D435["424x240"], look_at((0.5, 0, 0.55), (0.5, 0, 0)), "block", q=HOME)
assert pick.approach is not None, pick.reason
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
