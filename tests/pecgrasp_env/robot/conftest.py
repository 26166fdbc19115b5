"""A bench for the robot: the real simulator under ManiSkill's settings, without rendering or a task."""

from __future__ import annotations

import numpy as np
import pytest
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot import UR5Robotiq2F140, nearest_solution, tool0_from_grasp
from pecgrasp_env.robot import gripper_linkage as linkage


class Bench(BaseEnv):
    """The robot, and blocks that a test puts before it. `act` runs one control step of `pd_joint_pos`."""

    agent: UR5Robotiq2F140
    DOWN = np.array([[0.0, 1, 0, 0.5], [1, 0, 0, 0.0], [0, 0, -1, 0.3], [0, 0, 0, 1]])  # a grasp that closes along y

    def __init__(self, blocks=(), control_mode="pd_joint_pos", control_freq=20, render=False):
        self.block_specs = blocks
        super().__init__(
            robot_uids=UR5Robotiq2F140,
            control_mode=control_mode,
            obs_mode="none",
            reward_mode="none",
            sim_config={"control_freq": control_freq},
            sim_backend="physx_cpu",
            render_backend="cpu" if render else "none",
        )

    def _load_agent(self, options):
        super()._load_agent(options, sapien.Pose())

    def _load_scene(self, options):
        self.blocks = [self._block(f"block_{i}", **spec) for i, spec in enumerate(self.block_specs)]

    def _block(self, name, size, mass=None, friction=0.6, pose=None):
        """A box of `size` (m); fixed where it has no `mass` (kg)."""
        builder = self.scene.create_actor_builder()
        material = sapien.physx.PhysxMaterial(friction, friction, 0.0)
        density = (mass or 1.0) / np.prod(size)
        builder.add_box_collision(half_size=np.array(size) / 2, material=material, density=density)
        if self.scene.can_render():
            builder.add_box_visual(half_size=np.array(size) / 2)
        builder.initial_pose = sapien.Pose([0, 0, -1]) if pose is None else pose
        return builder.build_static(name) if mass is None else builder.build(name)

    def _initialize_episode(self, env_idx, options):
        self.agent.reset(self.agent.keyframes["home"].qpos)

    def evaluate(self):
        return {}

    # ------------------------------------------------------------------------------------------------ moving

    def place(self, q, opening):
        """Put the robot at rest at arm joints `q` (6,) and an opening (m)."""
        self.agent.reset(np.concatenate([q, np.full(4, linkage.crank_joint(opening))]))
        self.agent.controller.reset()

    def grasp_posture(self, T_base_grasp, width):
        return nearest_solution(tool0_from_grasp(T_base_grasp, width), self.agent.keyframes["home"].qpos[:6])

    def act(self, q, opening, force, each_step=None):
        action = np.concatenate([q, [opening, force]]).astype(np.float32)
        self.agent.set_action(torch.from_numpy(action)[None])
        for _ in range(self._sim_steps_per_control):
            self.agent.before_simulation_step()
            self.scene.step()
            if each_step is not None:
                each_step()

    def hold(self, q, opening, force, seconds, each_step=None):
        for _ in range(round(seconds * self.control_freq)):
            self.act(q, opening, force, each_step)

    def grip(self, block, width, force, offset=0.0):
        """Close on a block that floats between the pads, `offset` m further along the approach; then let it hang."""
        q = self.grasp_posture(self.DOWN, width)
        self.place(q, min(width + 0.01, linkage.STROKE))
        block.set_pose(sapien.Pose(self.DOWN[:3, 3] + [0, 0, -offset]))
        block.disable_gravity = True
        self.hold(q, 0.0, force, 0.5)
        block.disable_gravity = False
        self.hold(q, 0.0, force, 0.5)
        return q

    # --------------------------------------------------------------------------------------------- measuring

    def in_pads(self, block):
        """Pose of a block in the pads' frame (4, 4)."""
        return np.linalg.inv(self.agent.pads_pose.sp.to_transformation_matrix()) @ self.matrix(block)

    def any_contact(self, block):
        """Whether anything pushed on a block in the last step."""
        entity = block._bodies[0].entity
        return any(
            np.linalg.norm([point.impulse for point in contact.points]) > 0
            for contact in self.scene.px.get_contacts()
            if entity in (contact.bodies[0].entity, contact.bodies[1].entity)
        )

    def joint_gap(self):
        """Greatest distance between the two halves of a joint, over all of the robot's joints, m."""
        gaps = []
        for joint in self.agent.robot._objs[0].joints:
            if joint.parent_link is not None:
                parent = joint.parent_link.entity_pose * joint.pose_in_parent
                child = joint.child_link.entity_pose * joint.pose_in_child
                gaps.append(np.linalg.norm(parent.p - child.p))
        return max(gaps)

    @property
    def q(self):
        return self.agent.robot.get_qpos()[0].numpy().astype(float)

    def matrix(self, link):
        return link.pose.sp.to_transformation_matrix().astype(float)

    def pad_force(self, finger, block):
        """Contact force of a pad on a block along the closing axis, N."""
        closing = self.matrix(finger)[:3, 1]
        return abs(float(self.scene.get_pairwise_contact_forces(finger, block)[0].numpy() @ closing))

    def pad_tilt(self):
        """Greatest angle between a pad's normal and the palm's closing axis, rad."""
        palm = self.matrix(self.agent.robot.links_map["gripper_base"])
        tilts = []
        for finger in (self.agent.left_finger, self.agent.right_finger):
            R = palm[:3, :3].T @ self.matrix(finger)[:3, :3]
            tilts.append(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))
        return max(tilts)

    def snapshot(self):
        """Palm and finger poses and crank angles now, for `separation`: (3 * 7 + 2,). Cheap: taken at every step."""
        links = self.agent.robot.links_map
        poses = [links[name]._objs[0].entity_pose for name in ("gripper_base", "left_finger", "right_finger")]
        return np.concatenate([*(part for pose in poses for part in (pose.p, pose.q)), self.q[6:8]])

    @staticmethod
    def separation(snapshots):
        """How far the linkage is from a rigid one, (n,) m, for (n, 23) snapshots: the worst of

        - a pad's tip against where the closed parallelogram of its own crank would have it,
        - left and right crank against each other, at the crank's end,
        - the finger's pin of the parallel (inner knuckle) against the parallel's end.
        """
        snapshots = np.atleast_2d(snapshots).astype(float)
        palm_p, palm_R = snapshots[:, :3], Rotation.from_quat(snapshots[:, 3:7], scalar_first=True)
        cranks = snapshots[:, 21:]
        worst = linkage.CRANK_LENGTH * np.abs(cranks[:, 0] - cranks[:, 1])
        for column, side in ((0, -1), (1, 1)):  # left is on -y
            theta = linkage.CRANK_REST - cranks[:, column]
            swing = linkage.CRANK_LENGTH * np.stack([0 * theta, side * np.sin(theta), np.cos(theta)], axis=1)
            pivot = np.array([0, side * linkage.CRANK_PIVOT_Y, linkage.CRANK_PIVOT_Z])
            knuckle = np.array([0, side * linkage.KNUCKLE_PIVOT_Y, linkage.KNUCKLE_PIVOT_Z])
            tip = np.array([0, -side * linkage.PAD_CENTRE_Y, linkage.PAD_CENTRE_Z + linkage.PAD_LENGTH / 2])
            pose = snapshots[:, 7 + 7 * column : 14 + 7 * column]
            finger_R = Rotation.from_quat(pose[:, 3:], scalar_first=True)
            for point in (tip, knuckle - pivot):  # in the finger's frame, which is parallel to the palm's
                is_at = palm_R.inv().apply(pose[:, :3] + finger_R.apply(point) - palm_p)
                worst = np.maximum(worst, np.linalg.norm(is_at - (pivot + swing + point), axis=1))
        return worst


@pytest.fixture
def bench():
    """Factory of benches; they are closed at the end."""
    made = []

    def make(*args, **kwargs):
        torch.set_num_threads(1)
        made.append(Bench(*args, **kwargs))
        made[-1].reset(seed=0)
        return made[-1]

    yield make
    for each in made:
        each.close()
