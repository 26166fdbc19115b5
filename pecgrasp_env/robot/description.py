"""The robot as data: links, joints, masses and collision shapes of the UR5, the 2F-140 and the D435, and its URDF.

Kinematics, masses and inertias are Universal Robots' published ones (`Universal_Robots_ROS2_Description`, ur5); the
gripper's are in `linkage`. The link frames are those of the maker's URDF, except that the half turn between `base_link`
and the DH base is in the first joint. `wrist_3_link` is tool0.

The gripper has four joints in the physics: a crank and a finger a side. What keeps the fingers parallel, and left and
right together, is added to the loaded model (see `agent`), because a URDF cannot say it: the simulator's loader honours
`<mimic>` only between siblings, as the one written here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pecgrasp_env.robot import gripper_linkage as lk
from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS
from pecgrasp_env.robot.kinematics import COUPLER, T_TOOL0_CAMERA, T_TOOL0_GRIPPER, T_TOOL0_TCP

Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
HALF_PI = math.pi / 2

ARM_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
CRANK_JOINTS = ("left_crank_joint", "right_crank_joint")
FINGER_JOINTS = ("left_finger_joint", "right_finger_joint")
FINGER_LINKS = ("left_finger", "right_finger")
GRIPPER_LINKS = ("gripper_base", "left_crank", "right_crank", *FINGER_LINKS)


@dataclass(frozen=True)
class Shape:
    """A collision solid: `size` is (x, y, z) of a box or (radius, length along z) of a cylinder; pose in the link."""

    size: tuple[float, ...]
    xyz: Vector = ORIGIN
    rpy: Vector = ORIGIN


@dataclass(frozen=True)
class Link:
    name: str
    mass: float  # kg
    inertia: Vector  # kg·m², principal, about the centre of mass
    com: Vector = ORIGIN
    inertia_rpy: Vector = ORIGIN
    collision: tuple[Shape, ...] = ()


@dataclass(frozen=True)
class Joint:
    name: str
    parent: str
    child: str
    xyz: Vector = ORIGIN
    rpy: Vector = ORIGIN
    axis: Vector = (0.0, 0.0, 1.0)
    limits: tuple[float, float] | None = None  # rad; None: fixed
    effort: float = 0.0  # N·m
    mimic: str | None = field(default=None)  # follow that joint one to one


def _arm_links() -> list[Link]:
    along_x, along_y = (0.0, HALF_PI, 0.0), (HALF_PI, 0.0, 0.0)
    return [
        Link(
            "base_link",
            4.0,
            (0.00443333, 0.00443333, 0.0072),
            collision=(Shape((0.0745, 0.022), (0, 0, 0.011)), Shape((0.060, 0.010), (0, 0, 0.024))),
        ),
        Link(
            "shoulder_link",
            3.7,
            (0.0149723583, 0.0149723583, 0.01040625),
            (0, -0.00193, -0.02561),
            collision=(Shape((0.060, 0.120), (0, 0, -0.006)), Shape((0.060, 0.136), (0, -0.004, 0), along_y)),
        ),
        Link(
            "upper_arm_link",
            8.393,
            (0.1338858354, 0.1338858354, 0.0151074),
            (-0.2125, 0, 0.11336),
            along_x,
            (
                Shape((0.060, 0.125), (0, 0, 0.1335)),
                Shape((0.054, 0.425), (-0.2125, 0, 0.13585), along_x),
                Shape((0.060, 0.125), (-0.425, 0, 0.1335)),
            ),
        ),
        Link(
            "forearm_link",
            2.33,
            (0.0312168035, 0.0312168035, 0.004095),
            (-0.24225, 0, 0.0265),
            along_x,
            (
                Shape((0.060, 0.110), (0, 0, 0.0165)),
                Shape((0.040, 0.392), (-0.196, 0, 0.0165), along_x),
                Shape((0.045, 0.090), (-0.39225, 0, 0.0165)),
            ),
        ),
        Link(
            "wrist_1_link",
            1.219,
            (0.0020138896, 0.0020138896, 0.0021942),
            (0, -0.01634, -0.0018),
            collision=(Shape((0.045, 0.092), (0, 0, -0.002)), Shape((0.045, 0.050), (0, -0.025, 0), along_y)),
        ),
        Link(
            "wrist_2_link",
            1.219,
            (0.0018310396, 0.0018310396, 0.0021942),
            (0, 0.01634, -0.0018),
            collision=(Shape((0.045, 0.092), (0, 0, -0.002)), Shape((0.045, 0.045), (0, 0.022, 0), along_y)),
        ),
        Link(
            "wrist_3_link",
            0.1879,
            (0.0000806248, 0.0000806248, 0.0001321172),
            (0, 0, -0.001159),
            collision=(Shape((0.0375, 0.037), (0, 0, -0.0185)),),
        ),
    ]


def _arm_joints() -> list[Joint]:
    chain = [
        "base_link",
        "shoulder_link",
        "upper_arm_link",
        "forearm_link",
        "wrist_1_link",
        "wrist_2_link",
        "wrist_3_link",
    ]
    origins: list[tuple[Vector, Vector]] = [
        ((0, 0, 0.089159), (0, 0, math.pi)),
        (ORIGIN, (HALF_PI, 0, 0)),
        ((-0.425, 0, 0), ORIGIN),
        ((-0.39225, 0, 0.10915), ORIGIN),
        ((0, -0.09465, 0), (HALF_PI, 0, 0)),
        ((0, 0.0823, 0), (HALF_PI, math.pi, math.pi)),
    ]
    return [
        Joint(name, chain[i], chain[i + 1], *origins[i], limits=tuple(JOINT_LIMITS[i]), effort=150.0 if i < 3 else 28.0)
        for i, name in enumerate(ARM_JOINTS)
    ]


def _gripper_links() -> list[Link]:
    # The real gripper weighs 1.025 kg; the published masses of its moving parts are kept, the rest is the housing's.
    crank_mass, finger_mass = 0.008532 + 0.022614, 0.010400
    base_mass = 1.025 - 2 * (crank_mass + finger_mass)
    links = [
        Link(
            "gripper_base",
            base_mass,
            (0.0013, 0.0013, 0.0008),
            (0, 0, 0.035),
            collision=(
                Shape((0.0375, 0.045), (0, 0, 0.0225)),
                Shape((0.060, 0.100, 0.036), (0, 0, 0.054)),
            ),
        )
    ]
    for side, name in ((-1, "left"), (1, "right")):  # left is on -y
        inward = -side
        back = lk.PAD_CENTRE_Y - lk.PAD_THICKNESS / 2  # the pad's outer face
        links += [
            Link(
                f"{name}_crank",
                crank_mass,
                (3.1e-5, 3.1e-5, 4e-6),
                (0, 0, 0.05),
                collision=(Shape((0.024, 0.016, 0.100), (0, side * 0.004, 0.050)),),
            ),
            Link(
                f"{name}_finger",
                finger_mass,
                (6e-6, 6e-6, 2e-6),
                (0, inward * 0.02, 0.035),
                collision=(
                    Shape(
                        (lk.PAD_WIDTH, lk.PAD_THICKNESS, lk.PAD_LENGTH), (0, inward * lk.PAD_CENTRE_Y, lk.PAD_CENTRE_Z)
                    ),
                    Shape((0.024, 0.010, lk.PAD_LENGTH), (0, inward * (back - 0.005), lk.PAD_CENTRE_Z)),
                    Shape((0.024, 0.026, 0.020), (0, inward * 0.010, 0.006)),
                ),
            ),
        ]
    return links


def _gripper_joints() -> list[Joint]:
    joints = [Joint("gripper_mount", "wrist_3_link", "gripper_base", (0, 0, COUPLER), _rpy(T_TOOL0_GRIPPER))]
    for side, name in ((-1, "left"), (1, "right")):
        joints += [
            # Both cranks close with growing q; the fingers turn back by the same angle.
            Joint(
                f"{name}_crank_joint",
                "gripper_base",
                f"{name}_crank",
                (0, side * lk.CRANK_PIVOT_Y, lk.CRANK_PIVOT_Z),
                (-side * lk.CRANK_REST, 0, 0),
                (side * 1.0, 0, 0),
                lk.CRANK_LIMITS,
                effort=20.0,
                mimic=CRANK_JOINTS[0] if name == "right" else None,
            ),
            Joint(
                f"{name}_finger_joint",
                f"{name}_crank",
                f"{name}_finger",
                (0, 0, lk.CRANK_LENGTH),
                (side * lk.CRANK_REST, 0, 0),
                (-side * 1.0, 0, 0),
                (-1.0, 1.2),
                effort=20.0,
            ),
        ]
    return joints


def links() -> list[Link]:
    """All links, parents first."""
    frame_only = ((1e-6, 1e-6, 1e-6), ORIGIN, ORIGIN)
    camera = Link(
        "wrist_camera",  # OpenCV optical frame; the body is behind the lens plane
        0.072,
        (5e-5, 1e-5, 5e-5),
        (0.0175, 0, -0.0125),
        collision=(
            Shape((0.090, 0.025, 0.025), (0.0175, 0, -0.0130)),
            Shape((0.030, 0.100, 0.006), (0, 0.038, -0.052)),
            Shape((0.026, 0.014, 0.025), (0, 0, -0.0375)),
        ),
    )
    return [*_arm_links(), *_gripper_links(), Link("tcp", 1e-3, *frame_only), camera]


def joints() -> list[Joint]:
    """All joints, in the order of the links they carry."""
    return [
        *_arm_joints(),
        *_gripper_joints(),
        Joint("tcp_mount", "wrist_3_link", "tcp", tuple(T_TOOL0_TCP[:3, 3]), _rpy(T_TOOL0_TCP)),
        Joint("camera_mount", "wrist_3_link", "wrist_camera", tuple(T_TOOL0_CAMERA[:3, 3]), _rpy(T_TOOL0_CAMERA)),
    ]


def _rpy(T: np.ndarray) -> Vector:
    """Fixed-axis roll, pitch, yaw of a rotation whose pitch is not ±π/2."""
    return (math.atan2(T[2, 1], T[2, 2]), math.asin(-T[2, 0]), math.atan2(T[1, 0], T[0, 0]))
