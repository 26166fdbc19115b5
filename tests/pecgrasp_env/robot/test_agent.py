"""The agent in the real simulator: kinematics, controllers, what it senses, and its camera."""

import gymnasium as gym
import numpy as np
import pytest
import sapien
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot import T_TOOL0_CAMERA, T_TOOL0_TCP, forward_kinematics
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS
from pecgrasp_env.sensor import D435

HOME_VIEW = np.array([[0.0, -1, 0, 0.5], [-1, 0, 0, 0], [0, 0, -1, 0.55], [0, 0, 0, 1]])  # T_world_camera, OpenCV


def in_tool0(b, name):
    return np.linalg.inv(b.matrix(b.agent.robot.links_map["wrist_3_link"])) @ b.matrix(b.agent.robot.links_map[name])


def test_tool_pose_is_the_dh_product_at_1000_random_joint_vectors(bench):
    b = bench()
    rng = np.random.default_rng(0)
    for q in rng.uniform(JOINT_LIMITS[:, 0], JOINT_LIMITS[:, 1], (1000, 6)):
        b.agent.robot.set_qpos(np.concatenate([q, np.zeros(4)]))
        np.testing.assert_allclose(
            b.matrix(b.agent.robot.links_map["wrist_3_link"]), forward_kinematics(q), rtol=0, atol=1e-5
        )


def test_tcp_and_camera_stand_where_the_constants_say(bench):
    b = bench()
    np.testing.assert_allclose(in_tool0(b, "tcp"), T_TOOL0_TCP, atol=1e-6)
    np.testing.assert_allclose(in_tool0(b, "wrist_camera"), T_TOOL0_CAMERA, atol=1e-6)
    closed_pads = b.agent.pads_pose
    b.place(b.q[:6], 0.0)
    np.testing.assert_allclose(b.agent.pads_pose.p, b.agent.tcp_pos, atol=1e-4)
    assert np.linalg.norm(closed_pads.p - b.agent.tcp_pos) > 0.028  # open pads stand 29 mm nearer to the palm


def test_the_arm_holds_its_pose_within_a_millimetre_under_payload(bench):
    b = bench(blocks=[{"size": (0.06, 0.06, 0.08), "mass": 2.0}])
    q = b.grip(b.blocks[0], 0.06, 80)
    b.hold(q, 0.0, 80, 1.0)
    assert b.agent.is_grasping(b.blocks[0])
    sag = b.matrix(b.agent.robot.links_map["wrist_3_link"])[:3, 3] - forward_kinematics(q)[:3, 3]
    assert np.linalg.norm(sag) < 1e-3


class TestControllers:
    def test_every_mode_takes_arm_opening_and_force(self, bench):
        for mode in ("pd_joint_pos", "pd_joint_delta_pos", "pd_ee_pose", "pd_ee_delta_pose"):
            b = bench(control_mode=mode)
            assert b.action_space.shape == (8,)
            if "delta" in mode:
                assert b.action_space == gym.spaces.Box(-1, 1, (8,), np.float32)
            else:
                np.testing.assert_allclose(b.action_space.low[6:], [0.0, 10.0])
                np.testing.assert_allclose(b.action_space.high[6:], [0.14, 125.0])

    def act(self, b, action, seconds):
        for _ in range(round(seconds * b.control_freq)):
            b.step(np.asarray(action, dtype=np.float32))

    def test_ee_pose_puts_the_tcp_at_a_pose_in_the_base_frame(self, bench):
        b = bench(control_mode="pd_ee_pose")
        position, angles = [0.45, 0.1, 0.25], [np.pi, 0.1, -1.2]
        self.act(b, [*position, *angles, 0.05, 60], 1.5)
        T = b.agent.tcp_pose.sp.to_transformation_matrix()
        np.testing.assert_allclose(T[:3, 3], position, atol=1e-3)
        expected = Rotation.from_euler("XYZ", angles)  # intrinsic, as ManiSkill reads them
        assert (Rotation.from_matrix(T[:3, :3]) * expected.inv()).magnitude() < 2e-3
        assert b.agent.gripper_opening.item() == pytest.approx(0.05, abs=1e-3)

    @pytest.mark.parametrize("axis", range(6))
    def test_ee_delta_pose_moves_and_turns_along_the_action_s_sign(self, bench, axis):
        b = bench(control_mode="pd_ee_delta_pose")
        before = b.agent.tcp_pose.sp.to_transformation_matrix()
        action = np.zeros(8)
        action[axis] = 0.5
        self.act(b, action, 0.25)
        after = b.agent.tcp_pose.sp.to_transformation_matrix()
        moved = after[:3, 3] - before[:3, 3]
        turned = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
        change = np.concatenate([moved, turned])
        assert change[axis] > 0.02
        assert np.abs(np.delete(change, axis)).max() < 0.1 * change[axis]

    def test_joint_delta_moves_one_joint_by_the_action(self, bench):
        b = bench(control_mode="pd_joint_delta_pos")
        before = b.q
        self.act(b, [0, 0, 0, 0, 0, 1.0, -1.0, 0], 0.05)
        self.act(b, [0, 0, 0, 0, 0, 0, -1.0, 0], 1.0)
        assert 0.03 < b.q[5] - before[5] < 0.101
        np.testing.assert_allclose(b.q[:5], before[:5], atol=2e-3)

    def test_normalised_opening_and_force_span_their_ranges(self, bench):
        b = bench(control_mode="pd_joint_delta_pos")
        for action, opening, force in ((-1.0, 0.0, 10.0), (1.0, 0.14, 125.0), (0.0, 0.07, 67.5)):
            self.act(b, [0] * 6 + [action, action], 1.0)
            assert b.agent.gripper_opening.item() == pytest.approx(opening, abs=1e-3)
            state = b.agent.get_controller_state()["gripper"]
            assert state["force_limit"].item() == pytest.approx(force, rel=1e-3)
            assert state["target_opening"].item() == pytest.approx(opening, abs=1e-5)

    def test_an_action_that_is_not_finite_is_refused(self, bench):
        b = bench()
        with pytest.raises(ValueError, match="action must be finite"):
            self.act(b, [0, 0, 0, 0, 0, np.nan, 0.1, 20], 0.05)

    def test_commands_outside_the_gripper_s_range_are_clipped(self, bench):
        b = bench()
        b.hold(b.q[:6], 0.3, 500, 0.5)
        assert b.agent.gripper_opening.item() == pytest.approx(linkage.STROKE, abs=1e-3)
        assert b.agent.get_controller_state()["gripper"]["force_limit"].item() == linkage.MAX_FORCE


class TestSensing:
    def test_a_held_object_is_static_though_the_solver_s_velocities_are_not(self, bench):
        b = bench(blocks=[{"size": (0.05, 0.06, 0.05), "mass": 0.3}])
        q = b.grip(b.blocks[0], 0.06, 125)
        b.hold(q, 0.0, 125, 0.5)
        assert b.agent.robot.get_qvel()[0, 6:].abs().max() > 0.2  # why the agent does not report them
        assert b.agent.joint_rates.abs().max() < 0.05
        assert b.agent.is_static(0.02)

    def test_a_moving_arm_is_not_static(self, bench):
        b = bench()
        q = b.q[:6]
        for step in range(5):
            b.act(q + 0.05 * step * np.eye(6)[0], 0.1, 60)
        assert not b.agent.is_static(0.2)
        assert b.agent.joint_rates[0, 0] == pytest.approx(1.0, abs=0.3)

    def test_rates_are_zero_after_a_reset(self, bench):
        b = bench()
        b.hold(b.q[:6] + 0.3, 0.1, 60, 0.2)
        b.reset(seed=1)
        assert (b.agent.joint_rates == 0).all()
        assert b.agent.get_proprioception()["qvel"].shape == (1, 10)

    def test_gripper_opening_is_measured_not_commanded(self, bench):
        b = bench(blocks=[{"size": (0.05, 0.08, 0.05), "mass": 0.3}])
        b.grip(b.blocks[0], 0.08, 40)
        assert b.agent.gripper_opening.item() == pytest.approx(0.08, abs=1e-3)


class TestWristCamera:
    def test_home_looks_straight_down_on_the_workspace_from_055_m(self, bench):
        b = bench()
        T_world_camera = b.matrix(b.agent.robot.links_map["wrist_camera"])
        np.testing.assert_allclose(T_world_camera, HOME_VIEW, atol=1e-4)
        corners = np.array([(x, y, z) for x in (0.3, 0.7) for y in (-0.3, 0.3) for z in (0.0, 0.12)])
        points = (corners - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
        camera = D435["424x240"]
        pixels = points @ camera.matrix.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        assert ((pixels > 0) & (pixels < [camera.width, camera.height])).all()

    def test_picture_has_the_d435_s_intrinsics_and_shows_no_part_of_the_robot(self, bench):
        table = {"size": (2.0, 2.0, 0.04), "pose": sapien.Pose([0.5, 0, -0.02])}
        b = bench(blocks=[table], render=True)
        camera = b.scene.sensors["wrist_camera"]
        for opening in (0.0, 0.07, 0.14):
            b.place(b.q[:6], opening)
            b.scene.update_render()
            camera.capture()
            images = camera.get_obs(rgb=False, depth=True, position=False, segmentation=True)
            # 0.55 m of free air: no finger, no bracket, no knuckle.
            assert (images["segmentation"] == b.blocks[0].per_scene_id.item()).all()
            assert images["depth"].shape == (1, 240, 424, 1)
            assert ((images["depth"].double() / 1000 - 0.55).abs() < 2e-3).all()
        parameters = camera.get_params()
        np.testing.assert_allclose(parameters["intrinsic_cv"][0], D435["424x240"].matrix, rtol=1e-5)
        np.testing.assert_allclose(parameters["extrinsic_cv"][0], np.linalg.inv(HOME_VIEW)[:3], atol=1e-4)
