"""UR5 with a Robotiq 2F-140 and a wrist-mounted D435 for ManiSkill.

How the gripper's closed linkage is enforced. SAPIEN does not enforce mimic joints: its loader makes a tendon of some
and skips others without a word, and tendons between crank and finger give a wrong squeeze force. Here the physics has
a crank and a free finger a side, and two kinds of constraint that the solver does hold:
- each finger is locked to the palm's orientation by a six-axis constraint whose only locked axis is the twist about
  the hinge: the parallelogram, whose inner knuckles are drawn but carry nothing;
- left and right cranks are coupled by one fixed tendon (`<mimic>` between siblings), as one motor drives both.
Reflected inertia on the joints (`armature`) keeps 10 g links stable against a 125 N squeeze at 100 Hz.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.agents.base_agent import BaseAgent, Keyframe
from mani_skill.agents.controllers import (
    PassiveControllerConfig,
    PDEEPoseControllerConfig,
    PDJointPosControllerConfig,
)
from mani_skill.agents.registration import register_agent
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs import Actor, Link, Pose

from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.description import ARM_JOINTS, CRANK_JOINTS, FINGER_JOINTS, FINGER_LINKS, GRIPPER_LINKS
from pecgrasp_env.robot.gripper_controller import GripperControllerConfig, opening_of
from pecgrasp_env.robot.inner_knuckles import InnerKnuckles
from pecgrasp_env.robot.kinematics import HOME
from pecgrasp_env.robot.pad_contact import MAX_ANGLE_DEG, MIN_FORCE_N, both_press, outward
from pecgrasp_env.robot.urdf import robot_urdf
from pecgrasp_env.sensor.intrinsics import D435

# SAPIEN's cameras look along +x with +z up; this turns that into an OpenCV optical frame (z forward, y down).
_CAMERA_FROM_OPENCV = sapien.Pose(q=[0.5, -0.5, 0.5, -0.5]).inv()


def gripper_qpos(opening: float) -> np.ndarray:
    """The gripper's four joint angles (4,) at an opening (m): cranks left and right, fingers left and right."""
    return np.full(4, float(linkage.crank_joint(opening)))


@register_agent()
class UR5Robotiq2F140(BaseAgent):
    """UR5 + Robotiq 2F-140 + D435.

    qpos (10,): six arm joints from shoulder pan to wrist 3, left and right crank, left and right finger (finger = crank
    angle where the pads are parallel).

    Control modes (action (8,) = arm (6,), opening, force limit):
    - `pd_joint_pos`: joint targets, rad; opening, m, 0 … 0.14; force, N, 10 … 125;
    - `pd_joint_delta_pos`: all in [-1, 1]: ±0.1 rad from where the joints are; opening and force over their range;
    - `pd_ee_pose`: position, m, and XYZ Euler angles, rad, of `tcp` in base_link; opening, m; force, N;
    - `pd_ee_delta_pose`: all in [-1, 1]: ±0.1 m along base_link's axes, ±0.1 rad about them; opening and force.

    `tcp` is fixed to the flange, at the pads' centre of the closed gripper (x closing, z approach). The pads themselves
    move 29 mm along z over the stroke: `pads_pose` is where they are.
    """

    uid = "ur5_robotiq_2f140"
    # Rubber pads on plastics; the friction of a contact is the mean of both materials'. A patch radius gives a contact
    # resistance against turning on the spot.
    urdf_config = {  # noqa: RUF012
        "_materials": {"pad": {"static_friction": 0.8, "dynamic_friction": 0.8, "restitution": 0.0}},
        "link": {name: {"material": "pad", "patch_radius": 0.01, "min_patch_radius": 0.01} for name in FINGER_LINKS},
    }
    keyframes = {  # noqa: RUF012
        "home": Keyframe(qpos=np.concatenate([HOME, gripper_qpos(linkage.STROKE)]), pose=sapien.Pose())
    }

    # 1 kg at full reach bends the arm by 0.2 mm. One damping-to-stiffness ratio: all joints lag alike, so that a
    # straight path of joint targets stays straight. Torque limits are the UR5's.
    arm_stiffness = (3e4, 3e4, 3e4, 1e4, 1e4, 1e4)
    arm_damping = tuple(0.05 * stiffness for stiffness in arm_stiffness)
    arm_force_limit = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
    crank_armature, finger_armature = 0.02, 0.01  # kg·m²

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.urdf_path = str(robot_urdf())
        super().__init__(*args, **kwargs)

    # ---------------------------------------------------------------------------------------------- physics

    def _after_loading_articulation(self) -> None:
        links = self.robot.links_map
        # Each lock is there twice: the solver then works on it twice in every iteration, which a hard knock needs.
        for name in (*FINGER_LINKS, *FINGER_LINKS):
            lock = self.scene.create_drive(links["gripper_base"], sapien.Pose(), links[name], sapien.Pose())
            for constraint in lock._objs:  # ManiSkill's Drive does not expose the twist limit
                constraint.set_limit_twist(0.0, 0.0)
        # The linkage's own parts overlap where they are hinged: collisions inside the gripper are off. The hands of two
        # robots do meet, so each has a bit of its own.
        for name in (*GRIPPER_LINKS, "wrist_3_link", "wrist_camera"):
            links[name].set_collision_group_bit(group=2, bit_idx=31 - int(self._agent_idx or 0), bit=1)
        for names, armature in ((CRANK_JOINTS, self.crank_armature), (FINGER_JOINTS, self.finger_armature)):
            for name in names:
                for joint in self.robot.joints_map[name]._objs:
                    joint.set_armature(np.array([armature], dtype=np.float32))

    def _after_init(self) -> None:
        self.tcp: Link = self.robot.links_map["tcp"]
        self.left_finger: Link = self.robot.links_map[FINGER_LINKS[0]]
        self.right_finger: Link = self.robot.links_map[FINGER_LINKS[1]]
        self._cranks = [self.robot.joints_map[name].active_index[0].item() for name in CRANK_JOINTS]
        self._qpos_before = torch.full_like(self.robot.get_qpos(), torch.nan)
        self._knuckles = None
        if self.scene.can_render() and not self.scene.gpu_sim_enabled:
            self._knuckles = InnerKnuckles(self.scene, self.robot, Path(self.urdf_path).with_name("inner_knuckle.glb"))

    # ---------------------------------------------------------------------------------------------- control

    @property
    def _controller_configs(self) -> dict[str, Any]:
        drive = {"stiffness": self.arm_stiffness, "damping": self.arm_damping, "force_limit": self.arm_force_limit}
        tcp = dict(ee_link="tcp", urdf_path=self.urdf_path, **drive)
        arm = list(ARM_JOINTS)
        arms = {
            "pd_joint_pos": PDJointPosControllerConfig(arm, None, None, normalize_action=False, **drive),
            "pd_joint_delta_pos": PDJointPosControllerConfig(arm, -0.1, 0.1, use_delta=True, **drive),
            "pd_ee_pose": PDEEPoseControllerConfig(arm, -2.0, 2.0, use_delta=False, normalize_action=False, **tcp),
            # ManiSkill scales the rotation by rot_lower alone: its usual -0.1 would turn against the action's sign.
            "pd_ee_delta_pose": PDEEPoseControllerConfig(arm, -0.1, 0.1, rot_lower=0.1, rot_upper=0.1, **tcp),
        }
        return {
            mode: {
                "arm": config,
                "gripper": GripperControllerConfig(list(CRANK_JOINTS), normalize_action=config.normalize_action),
                "fingers": PassiveControllerConfig(list(FINGER_JOINTS), damping=0.0, friction=0.0),
            }
            for mode, config in arms.items()
        }

    def set_action(self, action: torch.Tensor) -> None:
        """Send an action (num_envs, 8) to the controllers. Raises ValueError where it is not finite (CPU only)."""
        # On a GPU the check would wait for the device at every step.
        if not self.scene.gpu_sim_enabled and not torch.isfinite(action).all():
            raise ValueError(f"action must be finite, got {action.tolist()}")
        self._qpos_before = self.robot.get_qpos().clone()
        self.controller.set_action(action)

    def before_simulation_step(self) -> None:
        super().before_simulation_step()
        if self._knuckles is not None:
            self._knuckles.follow()

    def reset(self, init_qpos: Any = None) -> None:
        super().reset(init_qpos)
        if self._knuckles is not None:
            self._knuckles.follow()
        self._qpos_before[self.scene._reset_mask] = torch.nan

    # ---------------------------------------------------------------------------------------------- sensing

    @property
    def _sensor_configs(self) -> list[CameraConfig]:
        intrinsics = D435["424x240"]
        return [
            CameraConfig(
                uid="wrist_camera",
                pose=_CAMERA_FROM_OPENCV,
                width=intrinsics.width,
                height=intrinsics.height,
                intrinsic=intrinsics.matrix,
                near=0.01,
                far=10.0,
                mount=self.robot.links_map["wrist_camera"],
            )
        ]

    @property
    def joint_rates(self) -> torch.Tensor:
        """Mean joint rates (num_envs, 10), rad/s, over the last control step; zero after a reset.

        From differences of positions: under a squeeze the solver's own velocities are false (1 rad/s at rest).
        """
        return torch.nan_to_num((self.robot.get_qpos() - self._qpos_before) * self._control_freq)

    def get_proprioception(self) -> dict[str, Any]:
        obs = super().get_proprioception()
        obs["qvel"] = self.joint_rates
        return obs

    @property
    def gripper_opening(self) -> torch.Tensor:
        """Measured opening between the pads (num_envs,), m."""
        return opening_of(self.robot.get_qpos()[:, self._cranks].mean(dim=-1))

    @property
    def tcp_pos(self) -> torch.Tensor:
        return self.tcp.pose.p

    @property
    def tcp_pose(self) -> Pose:
        """World pose of the fixed tool centre point, in grasp axes (x closing, z approach)."""
        return self.tcp.pose

    @property
    def pads_pose(self) -> Pose:
        """World pose of the grasp frame as it is now: midway between the pads' centres, x closing, z approach."""
        y, z = linkage.PAD_CENTRE_Y, linkage.PAD_CENTRE_Z
        left = self.left_finger.pose * sapien.Pose([0, y, z])
        right = self.right_finger.pose * sapien.Pose([0, -y, z])
        return Pose.create_from_pq((left.p + right.p) / 2, self.tcp.pose.q)

    def is_grasping(
        self, object: Actor | None = None, min_force: float = MIN_FORCE_N, max_angle: float = MAX_ANGLE_DEG
    ) -> torch.Tensor:
        """Whether both pads press on `object` (None: on anything), (num_envs,) bool.

        A pad presses where the contact force on it is at least `min_force` (N) and points outwards, within `max_angle`
        (degrees) of the closing axis.
        """
        forces = [
            finger.get_net_contact_forces()
            if object is None
            else self.scene.get_pairwise_contact_forces(finger, object)
            for finger in (self.left_finger, self.right_finger)
        ]
        pressed = both_press(torch.stack(forces, dim=1)[:, :, None], outward(self.left_finger), min_force, max_angle)
        return pressed[:, 0]

    def is_static(self, threshold: float = 0.2) -> torch.Tensor:
        """Whether no arm joint moved faster than `threshold` (rad/s) over the last control step, (num_envs,) bool."""
        return self.joint_rates[:, : len(ARM_JOINTS)].abs().amax(dim=1) <= threshold
