"""The robot's body as spheres, for planning motions and for telling it apart in a depth frame.

They are made from the collision shapes of its description: each box or cylinder becomes a row of spheres along its
longest axis that covers all of it but the rims of a cylinder. Those of another arm are the UR5's, as much longer as its
upper arm and forearm are, and as much thicker as its base. NumPy only; no simulator.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot import description
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.batch_kinematics import joint_frames

_LONG = (2, 3)  # frames of upper arm and forearm, which lie along x
TOOL = 6  # number of the frame that moves with joint 6; 0 is the base
_OPENING_STEP = 0.005  # m, to which an opening is rounded up: a wider hand needs more room


@dataclass(frozen=True)
class Spheres:
    """frame: (S,) which frame each moves with, 0 the base … 6 tool0, in rising order. centre: (S, 3) m there, in the DH
    frame after the joint of that number. radius: (S,) m. gripper, fingertip: (S,) bool, whether it is part of the
    gripper, and of what comes down beside an object. arm: whose it is.
    """

    frame: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    gripper: np.ndarray
    fingertip: np.ndarray
    arm: ArmLengths

    def at(self, q: np.ndarray) -> np.ndarray:
        """Centres (N, S, 3), base frame, at postures q (N, 6)."""
        frames = np.empty((len(q), 7, 4, 4))
        frames[:, 0] = np.eye(4)
        frames[:, 1:] = joint_frames(q, self.arm)
        result = np.empty((len(q), len(self.frame), 3))
        ends = np.searchsorted(self.frame, np.arange(8)).tolist()
        for number, (first, last) in enumerate(pairwise(ends)):
            T = frames[:, number]
            result[:, first:last] = self.centre[first:last] @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        return result


def body(opening: float, arm: ArmLengths = UR5) -> Spheres:
    """The whole robot with the gripper at an opening (m); the base and the shoulder first, the hand last."""
    return _body(min(linkage.STROKE, float(np.ceil(opening / _OPENING_STEP - 1e-9) * _OPENING_STEP)), arm)


def robot_spheres(q: np.ndarray, opening: float, T_base_camera: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """(S, 4) x, y, z and radius, m: the whole robot in a camera's frame, as `Segmenter.segment(…, robot=…)` takes it.

    q: (6,) joint angles, rad. opening: of the gripper, m. T_base_camera: (4, 4), camera frame into the base frame; the
    identity gives the spheres in the base frame.
    """
    robot = body(opening, arm)
    R, t = T_base_camera[:3, :3], T_base_camera[:3, 3]
    return np.column_stack([(robot.at(np.asarray(q, float)[None])[0] - t) @ R, robot.radius])


@lru_cache(maxsize=64)
def _body(opening: float, arm: ArmLengths) -> Spheres:
    poses = _links_at_rest(opening)
    frames = np.concatenate([np.eye(4)[None], joint_frames(np.zeros(6))])
    numbers = {link.name: number for number, link in enumerate(description.links()[: TOOL + 1])}
    parts = []
    for link in description.links():
        number = numbers.get(link.name, TOOL)
        thicker = arm.thickness if number < TOOL else 1.0
        longer = thicker * np.ones(3)
        if number in _LONG:
            longer[0] = arm.dh[number - 1, 0] / UR5.dh[number - 1, 0]
        T = np.linalg.inv(frames[number]) @ poses[link.name]
        for shape in link.collision:
            centres, radius = _cover(shape)
            tip = link.name in description.FINGER_LINKS and shape.xyz[2] > linkage.PAD_LENGTH / 2
            n = len(centres)
            row = [
                np.full(n, value) for value in (number, thicker * radius, link.name in description.GRIPPER_LINKS, tip)
            ]
            parts.append((row[0], (centres @ T[:3, :3].T + T[:3, 3]) * longer, *row[1:]))
    frame, centre, radii, gripper, fingertip = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Spheres(frame, centre, radii, gripper, fingertip, arm)


def _links_at_rest(opening: float) -> dict[str, np.ndarray]:
    """T_base_link of every link with the arm's joints at zero and the gripper at an opening (m)."""
    hinge = float(linkage.crank_joint(opening))
    poses = {"base_link": np.eye(4)}
    for joint in description.joints():
        T = _transform(joint.xyz, Rotation.from_euler("xyz", joint.rpy))
        if joint.name in description.CRANK_JOINTS or joint.name in description.FINGER_JOINTS:
            T = T @ _transform((0, 0, 0), Rotation.from_rotvec(hinge * np.array(joint.axis)))
        poses[joint.child] = poses[joint.parent] @ T
    return poses


def _transform(xyz: description.Vector, rotation: Rotation) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), xyz
    return T


def _cover(shape: description.Shape) -> tuple[np.ndarray, float]:
    """Centres (K, 3), link frame, of spheres of one radius that cover a shape."""
    if len(shape.size) == 3:
        axis = int(np.argmax(shape.size))
        length = shape.size[axis]
        across = 0.5 * float(np.linalg.norm(np.delete(shape.size, axis)))
    else:
        axis, (across, length) = 2, shape.size
    count = max(1, int(np.ceil(length / (1.4 * across))))
    piece = length / count
    # Of a cylinder the corners are rounded off: a cover of its rims would be half as thick again.
    radius = float(np.hypot(across, piece / 2)) if len(shape.size) == 3 else max(across, piece / 2) * 1.06
    centres = np.zeros((count, 3))
    centres[:, axis] = piece * (np.arange(count) + 0.5) - length / 2
    rotation = Rotation.from_euler("xyz", shape.rpy).as_matrix()
    return centres @ rotation.T + np.array(shape.xyz), radius
