"""The lengths of one Universal Robots arm, as its factory measured them and its controller tells who connects.

From PolyScope 3.6 on the robot state message of the secondary interface has a sub-package "kinematics info": the whole
Denavit-Hartenberg table that the controller reckons with, corrections included ("Primary and Secondary Interfaces",
docs.universal-robots.com). Nothing is sent to the controller, so it answers in local mode, too.
"""

from __future__ import annotations

import socket
import struct
import time

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.errors import ConnectionLost, WrongArm
from pecgrasp_env.real.ur_models import URModel
from pecgrasp_env.robot.arm_lengths import ArmLengths
from pecgrasp_env.robot.kinematics import forward_kinematics, home

PORT = 30002
ROBOT_STATE, KINEMATICS_INFO = 16, 5  # types of a message and of a sub-package
HEADER = struct.Struct(">iB")  # whole length in bytes, type
TABLE = struct.Struct(">6I24dI")  # checksums of the joints; theta, a, d, alpha of all; state of the calibration
_LONGEST_MESSAGE = 1 << 16
_TELLING_S = 2.0  # ten messages a second
_OTHER_ARM_M = 0.03  # of the tool: what a factory corrects comes to millimetres


def lengths_of(host: str, model: URModel, patience: float = 1.0) -> ArmLengths:
    """Those of the arm at a controller; those of its type where the controller tells none, as before PolyScope 3.6.

    patience: s more of our clock than a controller needs. Raises ConnectionLost, and WrongArm where the controller's
    arm is of another type.
    """
    table = _told(host, time.monotonic() + _TELLING_S + patience)
    if table is None:
        return model.lengths
    arm = model.lengths.with_measured(table)
    away, _ = departure(arm)
    if not away < _OTHER_ARM_M:
        shown = ", ".join(f"{value:.4f}" for value in (*table[1:3, 1], table[0, 2], table[1:4, 2].sum(), *table[4:, 2]))
        raise WrongArm(
            f"robot={model.name}: the arm at {host} has other lengths (a2, a3, d1, d2 + d3 + d4, d5, d6 = {shown} m); "
            f"its tool would be {away:.2f} m from where a {model.name}'s is: robot=… names its type"
        )
    return arm


def departure(arm: ArmLengths) -> tuple[float, float]:
    """How far, m, and by how much, rad, the measured lengths move the tool against the type's, in the home posture."""
    q = home(arm)
    moved = np.linalg.inv(forward_kinematics(q, arm.with_measured(None))) @ forward_kinematics(q, arm)
    return float(np.linalg.norm(moved[:3, 3])), float(Rotation.from_matrix(moved[:3, :3]).magnitude())


def words_of(arm: ArmLengths) -> str:
    """What is known of its lengths, for people."""
    if arm.measured is None:
        return "the controller tells no lengths of its own arm: those of its type are used"
    away, turned = departure(arm)
    return f"the arm's own lengths put its tool {1e3 * away:.1f} mm and {np.degrees(turned):.2f}° from its type's"


def table_of(arm: ArmLengths) -> np.ndarray:
    """(6, 4) theta, a, d, alpha: its own, or those of its type."""
    if arm.measured is not None:
        return arm.measured
    return np.column_stack([np.zeros(6), arm.dh])


def _told(host: str, deadline: float) -> np.ndarray | None:
    received = b""
    try:
        with socket.create_connection((host, PORT), timeout=max(0.1, deadline - time.monotonic())) as connection:
            while (left := deadline - time.monotonic()) > 0:
                connection.settimeout(left)
                try:
                    more = connection.recv(1 << 14)
                except TimeoutError:
                    break
                if not more:
                    break
                received += more
                messages, received = _split(received, host)
                for kind, held in messages:
                    for part, values in _split(held, host)[0] if kind == ROBOT_STATE else ():
                        if part == KINEMATICS_INFO and len(values) >= TABLE.size:
                            return _checked(values, host)
    except OSError as error:
        raise ConnectionLost(f"host={host}: port {PORT}: {error}; is it on, and is this its address?") from error
    return None


def _split(held: bytes, host: str) -> tuple[list[tuple[int, bytes]], bytes]:
    """Whole messages, or sub-packages, as type and content, and what is left over. Raises ConnectionLost."""
    found = []
    while len(held) >= HEADER.size:
        size, kind = HEADER.unpack_from(held)
        if not HEADER.size <= size <= _LONGEST_MESSAGE:
            raise ConnectionLost(f"host={host}: port {PORT}: a message of {size} bytes; is it a UR's controller?")
        if len(held) < size:
            break
        found.append((kind, held[HEADER.size : size]))
        held = held[size:]
    return found, held


def _checked(values: bytes, host: str) -> np.ndarray:
    table = np.array(TABLE.unpack_from(values)[6:30]).reshape(4, 6).T
    if not np.isfinite(table).all():
        raise ConnectionLost(f"host={host}: port {PORT}: lengths that are no numbers: {table.tolist()}")
    return table
