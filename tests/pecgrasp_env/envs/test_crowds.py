"""Piles and the bin: what is laid out, how much of the asked-for object is seen, and what may be taken away."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from mani_skill.utils.structs.pose import Pose

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.objects import LARS_CLASSES, Catalogue
from pecgrasp_env.robot import UR5Robotiq2F140
from pecgrasp_env.scene.clutter import BIN
from pecgrasp_env.scene.visibility import nearest_surface, placed_mesh

SOURCE = Catalogue(LARS_CLASSES, instances_per_class=2)
HOME = np.array([*UR5Robotiq2F140.keyframes["home"].qpos[:6], 0.14, 60.0], np.float32)


def make(clutter, **kwargs):
    defaults = {
        "obs_mode": "state_dict",
        "control_mode": "pd_joint_pos",
        "sim_backend": "physx_cpu",
        "render_backend": "cpu",
        "objects": SOURCE,
        "clutter": clutter,
    }
    return gym.make("SelectiveGrasp-v1", **(defaults | kwargs))


@pytest.mark.parametrize("clutter", ["piled", "bin"])
def test_a_crowd_rests_where_its_seed_puts_it(clutter):
    env = make(clutter, n_objects=3)
    first, info = env.reset(seed=5)
    for _ in range(10):
        _, _, terminated, _, info = env.step(HOME)
    assert not terminated
    assert float(info["disturbance_m"]) < 2e-3
    env.reset(seed=6)
    again, _ = env.reset(seed=5)
    assert torch.equal(first["extra"]["object_poses"], again["extra"]["object_poses"])
    places = again["extra"]["object_poses"].reshape(3, 7)[:, :2].numpy()
    if clutter == "bin":
        assert (np.abs(BIN.local(places)) < np.array(BIN.size[:2]) / 2).all()
    else:
        assert np.linalg.norm(places - places.mean(axis=0), axis=1).max() < 0.2
    env.close()


def test_the_visible_share_is_that_of_the_segmentation_whatever_camera_it_is():
    pose = Pose.create_from_pq([0.02, 0.01, 0.03], [0.5, -0.5, 0.5, -0.5])
    mount = {"width": 300, "height": 200, "pose": pose.inv().sp}
    for configs, seed in (({}, 0), ({"wrist_camera": mount}, 1)):
        env = make("bin", n_objects=3, obs_mode="segmentation", sensor_configs=configs)
        obs, info = env.reset(seed=seed)
        task, images = env.unwrapped, obs["sensor_data"]["wrist_camera"]
        asked = int(torch.nonzero(task.is_target[0])[0])
        seen = int((images["segmentation"] == task.objects[asked].per_scene_id[0]).sum())
        camera = obs["sensor_param"]["wrist_camera"]
        K, T = camera["intrinsic_cv"][0].numpy(), camera["extrinsic_cv"][0].numpy()
        vertices, faces = placed_mesh(task.models[0][asked], task.objects[asked].pose.raw_pose[0].numpy())
        x, y, z = T[:, :3] @ vertices.T + T[:, 3:]
        screen = np.stack([K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2], 1 / z], axis=1)
        alone = np.isfinite(nearest_surface(screen[faces], images["segmentation"].shape[1:3])).sum()
        assert float(info["visible_share"]) == pytest.approx(seen / alone, abs=4 / alone)
        env.close()


def stacked(clear):
    """Two objects, the asked-for one below the other."""
    env = make("apart", n_objects=2, clear=clear)
    env.reset(seed=0, options={"objects": ["joypad", "plug_adapter"], "target": "joypad"})
    below, above = env.unwrapped.objects
    pose = above.pose.raw_pose.clone()
    pose[:, :2] = below.pose.p[:, :2]
    pose[:, 2] += 0.06
    above.set_pose(Pose.create(pose))
    for _ in range(15):
        env.step(HOME)
    return env, above


def test_what_is_taken_off_the_asked_for_object_is_not_wrong_any_more():
    env, above = stacked(clear=True)
    task = env.unwrapped
    task._let_take(torch.tensor([[False, True]]), task.table.poses())
    saved = task.get_state_dict()
    above.set_pose(Pose.create_from_pq([0.5, 0.0, 0.3]))
    assert not task.evaluate()["fail"]
    task.memory.may_take[:] = False
    assert task.evaluate()["wrong_object"]
    task.set_state_dict(saved)
    assert task.memory.may_take.tolist() == [[False, True]]
    above.set_pose(Pose.create_from_pq([0.5, 0.9, -0.3]))
    assert task.evaluate()["off_table"]
    env.close()


def test_what_lies_beside_it_may_not_be_taken():
    env, above = stacked(clear=True)
    task = env.unwrapped
    above.set_pose(Pose.create_from_pq([0.35, 0.3, 0.03]))
    task._let_take(torch.tensor([[False, True]]), task.table.poses())
    assert not task.memory.may_take.any()
    env.close()
