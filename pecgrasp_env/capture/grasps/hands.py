"""Many 2F-140 without arms in one plain SAPIEN scene: the robot's own linkage, each hand on a slide along its approach.

Links, shapes, masses and joints are those of `robot.description`; what keeps the fingers parallel and left and right
together, materials and armatures are those of `robot.agent`, and the fingers are driven as `robot.gripper_controller`
drives them. In place of the arm stands a fixed flange with a stiff prismatic joint: the hand comes in along it, and
it is drawn back by what the pads advance while they close. The wrist camera is not there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import sapien
from sapien import physx
from sapien.wrapper.articulation_builder import ArticulationBuilder, LinkBuilder
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.agent import UR5Robotiq2F140
from pecgrasp_env.robot.description import CRANK_JOINTS, FINGER_JOINTS, FINGER_LINKS, GRIPPER_LINKS, Link, joints, links
from pecgrasp_env.robot.gripper_controller import DAMPING, LEAD, STIFFNESS
from pecgrasp_env.robot.kinematics import tool0_from_grasp

__all__ = ["CONTROL_S", "Hands"]

CONTROL_S = 0.05  # s between two commands, as in the task
_SLIDE = "slide"
_SLIDE_LIMITS = (-0.6, 0.1)  # m
# As stiff as the arm is at its flange: 3e4 N·m/rad half a metre away. What resists more than the force stops the hand.
_SLIDE_STIFFNESS, _SLIDE_DAMPING, _SLIDE_FORCE = 1.2e5, 2.4e3, 300.0  # N/m, N·s/m, N
_AWAY_M = 5.0
_HULL_FRICTION = 0.6  # of what is not a finger, as the task's default material
_TENDON_STIFFNESS = 1e5  # as the loader gives a `<mimic>`
_APART_IN_ITSELF = 1 << 31
_X_TO_Z = sapien.Pose(q=[np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0])
_X_TO_MINUS_X = sapien.Pose(q=[0.0, 0.0, 0.0, 1.0])


class Hands:
    """n hands; arrays have one row a hand. Grasp frames as everywhere: origin midway between the pads, z approach."""

    def __init__(self, scene: sapien.Scene, groups: Sequence[int]) -> None:
        """groups: of each hand the collision groups (a bit mask) of what it can touch."""
        self._hands = [_build(scene, group) for group in groups]
        names = [joint.name for joint in self._hands[0].active_joints]
        self._slide = names.index(_SLIDE)
        self._cranks = [names.index(name) for name in CRANK_JOINTS]
        self._fingers = [names.index(name) for name in FINGER_JOINTS]
        self._target = np.full(len(groups), linkage.STROKE)
        fingers = [[hand.find_link_by_name(name).entity.per_scene_id for name in FINGER_LINKS] for hand in self._hands]
        self.finger_ids = np.array(fingers)
        """(n, 2) per_scene_id of the left and the right finger."""

    def __len__(self) -> int:
        return len(self._hands)

    def place(self, T_world_grasp: np.ndarray, openings: np.ndarray, standoffs: np.ndarray) -> None:
        """Put the hands (n, 4, 4) m, at rest, at their openings (n,) m, so far (n,) m before their grasps."""
        self._target = np.asarray(openings, float).copy()
        for hand, T, opening, standoff in zip(self._hands, T_world_grasp, openings, standoffs, strict=True):
            hand.set_root_pose(sapien.Pose(tool0_from_grasp(T, 0.0)))
            q = np.zeros(len(hand.active_joints), np.float32)
            q[self._slide] = _slide_at(opening) - standoff
            q[[*self._cranks, *self._fingers]] = linkage.crank_joint(opening)
            hand.set_qpos(q)
            hand.set_qvel(np.zeros_like(q))
        self.slide_to(openings, standoffs)
        self.squeeze_to(openings, np.full(len(self), linkage.MAX_FORCE))

    def take_away(self, which: np.ndarray) -> None:
        """Put those hands, (n,) bool, where they touch nothing, until they are placed again."""
        for number in np.flatnonzero(which):
            pose = self._hands[number].root_pose
            self._hands[number].set_root_pose(sapien.Pose(pose.p + np.array([0, 0, _AWAY_M]), pose.q))

    def opening(self) -> np.ndarray:
        """(n,) m, measured between the pads."""
        return linkage.opening(self._qpos()[:, self._cranks].mean(axis=1))

    def lag(self, openings: np.ndarray, standoffs: np.ndarray) -> np.ndarray:
        """(n,) m: how far the hands are behind where `slide_to` sent them."""
        return np.abs(self._qpos()[:, self._slide] - (_slide_at(openings) - standoffs))

    def slide_to(self, openings: np.ndarray, standoffs: np.ndarray) -> None:
        """Send the hands so far (n,) m before their grasps, as the pads are where the openings (n,) m are these."""
        for hand, target in zip(self._hands, _slide_at(openings) - standoffs, strict=True):
            hand.active_joints[self._slide].set_drive_target(float(target))

    def squeeze_to(self, wishes: np.ndarray, forces: np.ndarray) -> None:
        """One control step of the fingers towards openings (n,) m with at most these forces (n,) N."""
        q = self._qpos()[:, self._cranks].mean(axis=1)
        measured = linkage.opening(q)
        start = np.clip(self._target, measured - LEAD, measured + LEAD)
        stride = linkage.MAX_SPEED * CONTROL_S
        self._target = start + np.clip(np.clip(wishes, 0.0, linkage.STROKE) - start, -stride, stride)
        angles = linkage.crank_joint(self._target)
        for hand, angle, torque in zip(self._hands, angles, linkage.crank_torque(forces, q), strict=True):
            for number in self._cranks:
                joint = hand.active_joints[number]
                joint.set_drive_properties(STIFFNESS, DAMPING, float(torque), "force")
                joint.set_drive_target(float(angle))

    def pads(self) -> np.ndarray:
        """(n, 3) m, world: midway between the pads' centres."""
        left, right = (
            np.array([_point(hand.find_link_by_name(name), side) for hand in self._hands])
            for name, side in zip(FINGER_LINKS, (1.0, -1.0), strict=True)
        )
        return (left + right) / 2

    def _qpos(self) -> np.ndarray:
        return np.array([hand.qpos for hand in self._hands])


def _slide_at(openings: np.ndarray | float) -> np.ndarray:
    """m by which the flange stands in front of where it is with closed fingers, for pads at the same place."""
    return linkage.pad_depth(0.0) - linkage.pad_depth(openings)


def _point(finger: physx.PhysxArticulationLinkComponent, side: float) -> np.ndarray:
    return (finger.entity.pose * sapien.Pose([0, side * linkage.PAD_CENTRE_Y, linkage.PAD_CENTRE_Z])).p


def _build(scene: sapien.Scene, group: int) -> physx.PhysxArticulation:
    builder = ArticulationBuilder()
    builder.set_scene(scene)
    flange = builder.create_link_builder()
    flange.set_name("wrist_3_link")
    flange.set_mass_and_inertia(1.0, sapien.Pose(), [1e-3] * 3)
    made: dict[str, LinkBuilder] = {"wrist_3_link": flange}
    described = {link.name: link for link in links()}
    for joint in joints():
        if joint.child not in GRIPPER_LINKS:
            continue
        link = builder.create_link_builder(made[joint.parent])
        made[joint.child] = link
        _fill(link, described[joint.child], group)
        at = sapien.Pose(joint.xyz, np.roll(Rotation.from_euler("xyz", joint.rpy).as_quat(), 1))
        if joint.limits is None:  # the mount
            link.set_joint_name(_SLIDE)
            link.set_joint_properties("prismatic", _SLIDE_LIMITS, at * _X_TO_Z, _X_TO_Z)
        else:
            link.set_joint_name(joint.name)
            along = sapien.Pose() if joint.axis[0] > 0 else _X_TO_MINUS_X
            link.set_joint_properties("revolute", joint.limits, at * along, along)
    hand = builder.build(fix_root_link=True)
    _constrain(scene, hand)
    return hand


def _fill(builder: LinkBuilder, link: Link, group: int) -> None:
    builder.set_name(link.name)
    builder.set_mass_and_inertia(link.mass, sapien.Pose(link.com), link.inertia)
    friction, radius = _HULL_FRICTION, 0.0
    if link.name in FINGER_LINKS:
        robot: dict[str, Any] = UR5Robotiq2F140.urdf_config
        friction = robot["_materials"]["pad"]["static_friction"]
        radius = robot["link"][link.name]["patch_radius"]
    material = physx.PhysxMaterial(friction, friction, 0.0)
    builder.collision_groups = [group, group, _APART_IN_ITSELF, 0]
    for shape in link.collision:
        turn = Rotation.from_euler("xyz", shape.rpy)
        rest = {"material": material, "patch_radius": radius, "min_patch_radius": radius}
        if len(shape.size) == 3:
            pose = sapien.Pose(shape.xyz, np.roll(turn.as_quat(), 1))
            builder.add_box_collision(pose, [size / 2 for size in shape.size], **rest)
        else:  # SAPIEN's cylinders lie along x
            pose = sapien.Pose(shape.xyz, np.roll(turn.as_quat(), 1)) * _X_TO_Z
            builder.add_cylinder_collision(pose, shape.size[0], shape.size[1] / 2, **rest)


def _constrain(scene: sapien.Scene, hand: physx.PhysxArticulation) -> None:
    """What no description says: parallel fingers, coupled cranks, reflected inertia; see `robot.agent`."""
    palm, left, right = (hand.find_link_by_name(name) for name in GRIPPER_LINKS[:3])
    for name in (*FINGER_LINKS, *FINGER_LINKS):
        lock = scene.create_drive(palm, sapien.Pose(), hand.find_link_by_name(name), sapien.Pose())
        lock.set_limit_twist(0.0, 0.0)
    hand.create_fixed_tendon([palm, right, left], [0, -1, 1], [0, -1, 1], stiffness=_TENDON_STIFFNESS)
    for link in hand.links:
        link.disable_gravity = True
    hand.find_joint_by_name(_SLIDE).set_drive_properties(_SLIDE_STIFFNESS, _SLIDE_DAMPING, _SLIDE_FORCE, "force")
    armature = {CRANK_JOINTS: UR5Robotiq2F140.crank_armature, FINGER_JOINTS: UR5Robotiq2F140.finger_armature}
    for names, value in armature.items():
        for name in names:
            hand.find_joint_by_name(name).set_armature(np.array([value], np.float32))
