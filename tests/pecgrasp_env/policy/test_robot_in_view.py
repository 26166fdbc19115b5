"""The real simulator's robot before a camera beside the table: cut out by its joint angles, and nothing else is."""

import gymnasium as gym
import numpy as np
import pytest
import sapien
from scipy.spatial.transform import Rotation

from grasping import Segmenter
from pecgrasp_env.objects import LARS_CLASSES, Catalogue
from pecgrasp_env.policy.observation import observation_of_frame
from pecgrasp_env.policy.perception import segment_frame
from pecgrasp_env.policy.viewpoints import look_at
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.kinematics import HOME, nearest_solution, tool0_from_grasp
from pecgrasp_env.sensor.d435_noise import apply_d435
from pecgrasp_env.sensor.intrinsics import D435
from pecgrasp_env.sensor.sapien_depth import SAPIEN_FROM_OPENCV, add_depth_camera, take_depth

CAMERA = D435["424x240"]
AWAY = np.array([np.pi, *HOME[1:]])  # the arm turned to the side without objects
FEW = 40  # pixels, of which the segmenter makes no object


class Bench:
    """Three things on the table, a camera that stands anywhere, and the arm put anywhere."""

    def __init__(self):
        self.env = gym.make(
            "SelectiveGrasp-v1",
            obs_mode="depth",
            control_mode="pd_joint_pos",
            sim_backend="physx_cpu",
            render_backend="cpu",
            objects=Catalogue(LARS_CLASSES, instances_per_class=2),
        )
        self.env.reset(seed=3)
        self.task = self.env.unwrapped
        self.scene = self.task.scene.sub_scenes[0]
        self.camera = add_depth_camera(self.scene, CAMERA)
        self.robot = {int(link._objs[0].entity.per_scene_id) for link in self.task.agent.robot.get_links()}
        self.things = [int(actor.per_scene_id[0]) for actor in self.task.objects]

    def picture(self, q, opening, T_base_camera):
        """Depth (H, W), and the number of what each pixel shows."""
        self.task.agent.reset(np.concatenate([q, np.full(4, linkage.crank_joint(opening))]))
        self.task.get_obs()  # brings the drawn linkage along
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = T_base_camera[:3, :3] @ SAPIEN_FROM_OPENCV.T, T_base_camera[:3, 3]
        self.camera.entity.set_pose(sapien.Pose(pose))
        self.scene.update_render()
        depth = take_depth(self.camera)
        return depth, self.camera.get_picture("Segmentation")[..., 1].astype(int)


@pytest.fixture(scope="module")
def bench():
    bench = Bench()
    yield bench
    bench.env.close()


def over(place, opening, turn):
    """Joint angles with the pads 15 cm above a place of the table, the hand leaning a little."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("ZX", [turn, np.pi - 0.2]).as_matrix()
    T[:3, 3] = [place[0], place[1], 0.15]
    return nearest_solution(tool0_from_grasp(T, opening), HOME)


@pytest.mark.parametrize("eye", [(0.55, -0.65, 0.55), (0.9, 0.5, 0.6), (0.2, 0.6, 0.75)])
@pytest.mark.parametrize("opening", [0.0, 0.08, 0.14])
@pytest.mark.parametrize("noisy", [False, True])
def test_the_arm_is_no_object_and_what_stands_beside_it_is(bench, eye, opening, noisy):
    T = look_at(eye, (0.45, 0.0, 0.05))
    q = over(bench.task.objects[0].pose.p[0].numpy(), opening, turn=eye[0])

    def found(q):
        depth, shown = bench.picture(q, opening, T)
        seen = apply_d435(depth, CAMERA, np.random.default_rng(0)) if noisy else depth
        scene = segment_frame(observation_of_frame(seen, CAMERA, T, q, opening), Segmenter())
        return scene, shown.reshape(-1)

    (before, was_shown), (scene, shown) = found(AWAY), found(q)
    robot = np.isin(shown, list(bench.robot))
    assert robot.sum() > 2000
    assert all(np.isin(shown[index], list(bench.robot)).sum() < FEW for index in scene.indices)
    (cut,) = [entry.n_points for entry in scene.rejected if entry.why == "the robot itself"]
    assert cut < 1.15 * robot.sum()
    beside = 0
    for thing in bench.things:
        if (shown == thing).sum() > 0.95 * (was_shown == thing).sum():
            pixels = [
                max((each[index] == thing).sum() for index in s.indices)
                for s, each in ((scene, shown), (before, was_shown))
            ]
            assert pixels[0] > 0.8 * pixels[1]
            beside += 1
    assert beside >= 1


def test_the_hand_alone_is_cut_out_where_the_joint_angles_are_unknown():
    """And nothing, where neither is known; the arm alone, where the opening is not."""
    depth, T = np.ones((CAMERA.height, CAMERA.width), np.float32), np.eye(4)
    nothing = observation_of_frame(depth, CAMERA, T, None, None).robot
    hand = observation_of_frame(depth, CAMERA, T, None, 0.08).robot
    arm = observation_of_frame(depth, CAMERA, T, HOME, None).robot
    everything = observation_of_frame(depth, CAMERA, T, HOME, 0.08).robot
    assert nothing.shape == (0, 4)
    assert 0 < len(arm) < len(everything)
    pads = hand[:, 2].max()
    assert 0.15 < pads < 0.2  # in front of the camera on the bracket
    assert np.linalg.norm(everything[:, None, :3] - arm[:, :3], axis=2).min(axis=0).max() < 1e-12
