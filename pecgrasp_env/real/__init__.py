"""A robot on the desk: what an arm, a gripper and a camera must be able to do, drivers for some, stand-ins for all.

Imports neither a simulator nor torch; each driver's library is imported where the driver is made.
"""

from pecgrasp_env.real.errors import (
    ConnectionLost,
    Declined,
    EmergencyStop,
    GripperFault,
    JointLimit,
    MissingExtra,
    MotionTimeout,
    NotInRemoteControl,
    ProtectiveStop,
    RobotError,
    SpeedLimit,
)
from pecgrasp_env.real.interfaces import Arm, ArmState, DepthCamera, DepthImage, Motion, ParallelGripper
from pecgrasp_env.real.robotiq import RobotiqGripper

__all__ = [
    "Arm",
    "ArmState",
    "ConnectionLost",
    "Declined",
    "DepthCamera",
    "DepthImage",
    "EmergencyStop",
    "GripperFault",
    "JointLimit",
    "MissingExtra",
    "Motion",
    "MotionTimeout",
    "NotInRemoteControl",
    "ParallelGripper",
    "ProtectiveStop",
    "RobotError",
    "RobotiqGripper",
    "SpeedLimit",
]
