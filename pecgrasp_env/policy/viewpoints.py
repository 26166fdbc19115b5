"""Postures from which the wrist camera looks at the table: from above, and from the sides where that was not enough."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.motion.joint_path import solutions_near
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA, home

# Where the camera is and what it looks at, base frame, metres, of an arm with the UR5's reach; of a smaller one all is
# nearer to its base, and the camera so much nearer to what it looks at, as far as it then still measures.
_TARGET = (0.50, 0.0, 0.02)
_HEIGHT = 0.42  # m of the camera above the table where one object is looked at from straight above
_EYES = ((0.50, 0.0, 0.55), (0.38, 0.18, 0.48), (0.38, -0.18, 0.48), (0.30, 0.0, 0.45))
_NEAREST = 0.7  # of the distance
_ASIDE_RAD = (1.3, -1.3)
N_VIEWPOINTS = len(_EYES)
_TILT = np.deg2rad(30)
_TURNS = np.deg2rad([0, 40, -40, 80, -80])
_GOLDEN_TURN = np.pi * (3 - np.sqrt(5))
_ALL_AROUND_TILT = np.deg2rad(50)  # the largest, of many views


def look_at(eye: tuple[float, float, float], target: tuple[float, float, float]) -> np.ndarray:
    """T_base_camera (4, 4), OpenCV axes, of a camera at ``eye`` that looks at ``target`` with the robot's x axis up in
    the image.
    """
    forward = np.subtract(target, eye)
    forward /= np.linalg.norm(forward)
    down = -np.array([1.0, 0.0, 0.0])
    down -= (down @ forward) * forward
    down /= np.linalg.norm(down)
    T = np.eye(4)
    T[:3, :3] = np.stack([np.cross(down, forward), down, forward], axis=1)
    T[:3, 3] = eye
    return T


def aside(arm: ArmLengths = UR5) -> tuple[np.ndarray, ...]:
    """Joint angles (6,) of the arm beside the table, first at its left: a camera that stands beside the robot sees what
    lies there.
    """
    return tuple(home(arm) + np.array([turn, 0, 0, 0, 0, 0]) for turn in _ASIDE_RAD)


def look_postures(T_tool0_camera: np.ndarray = T_TOOL0_CAMERA, arm: ArmLengths = UR5) -> tuple[np.ndarray, ...]:
    """Joint angles (6,) of each view, the one from above first. T_tool0_camera: (4, 4), how the camera is mounted.

    Raises ValueError for a mounting with which the arm cannot bring it there.
    """
    return _look_postures(np.asarray(T_tool0_camera, float).tobytes(), arm)


@lru_cache(maxsize=8)
def _look_postures(mount: bytes, arm: ArmLengths) -> tuple[np.ndarray, ...]:
    T_camera_tool0 = np.linalg.inv(np.frombuffer(mount).reshape(4, 4))
    postures = []
    for eye_of_ur5 in _EYES:
        eye, target = eye_of_ur5, _TARGET
        if arm.share < 1:
            target = tuple(arm.share * np.array(_TARGET))
            scale = np.array([arm.share, arm.share, max(arm.share, _NEAREST)])
            eye = tuple(target + scale * np.subtract(eye_of_ur5, _TARGET))
        solutions = solutions_near(look_at(eye, target) @ T_camera_tool0, arm=arm)
        if len(solutions):
            postures.append(solutions[0])
        elif not postures:  # what cannot be brought over its own foot looks less often
            raise ValueError(f"the camera cannot be brought to {np.round(eye, 3).tolist()} m")
    return tuple(postures)


def posture_beside(
    place: np.ndarray,
    direction: np.ndarray,
    T_tool0_camera: np.ndarray = T_TOOL0_CAMERA,
    arm: ArmLengths = UR5,
) -> np.ndarray | None:
    """Joint angles (6,) from which the camera looks at a place (3,), base frame, m, tilted, from a side (2,) or as near
    to that side as the arm can; None where it cannot. T_tool0_camera: (4, 4), how the camera is mounted.
    """
    heading, away = float(np.arctan2(direction[1], direction[0])), _height(arm)
    for turned in _TURNS:
        x, y = away * np.sin(_TILT) * np.array([np.cos(heading + turned), np.sin(heading + turned)])
        eye = (float(place[0] + x), float(place[1] + y), float(place[2] + away * np.cos(_TILT)))
        T = look_at(eye, (float(place[0]), float(place[1]), float(place[2])))
        solutions = solutions_near(T @ np.linalg.inv(T_tool0_camera), arm=arm)
        if len(solutions):
            return solutions[0]
    return None


def _height(arm: ArmLengths) -> float:
    return _HEIGHT * max(arm.share, _NEAREST)


def posture_above(
    place: np.ndarray, turn: int, T_tool0_camera: np.ndarray = T_TOOL0_CAMERA, arm: ArmLengths = UR5
) -> np.ndarray:
    """Joint angles (6,) from which the camera looks straight down on a place (3,), base frame, m, as near to it as the
    arm reaches. turn: 1, 2, … how often it was looked at so before; each time the camera is turned a little.
    T_tool0_camera: (4, 4), how it is mounted.
    """
    for height in (_height(arm), _height(arm) + 0.08):
        for shrink in (1.0, 0.9, 0.8):
            x, y = float(place[0]) * shrink, float(place[1]) * shrink
            T = look_at((x, y, height), (x, y, 0.0))
            T[:3, :3] = T[:3, :3] @ Rotation.from_euler("z", 0.3 * (turn if turn % 2 else -turn)).as_matrix()
            solutions = solutions_near(T @ np.linalg.inv(T_tool0_camera), arm=arm)
            if len(solutions):
                return solutions[0]
    return look_postures(T_tool0_camera, arm)[0]


def postures_around(
    place: np.ndarray, count: int, T_tool0_camera: np.ndarray = T_TOOL0_CAMERA, arm: ArmLengths = UR5
) -> list[np.ndarray]:
    """Joint angles (6,) of `count` views of a place (3,), base frame, m, spread evenly over the cap of 50° above it, as
    seeds are over a sunflower (Vogel 1979); fewer where the arm cannot go. T_tool0_camera: (4, 4).
    """
    T_camera_tool0 = np.linalg.inv(T_tool0_camera)
    postures: list[np.ndarray] = []
    for k in range(count):
        tilt, heading = _ALL_AROUND_TILT * np.sqrt((k + 0.5) / count), k * _GOLDEN_TURN
        # Where a view is out of reach, one from the same side but higher says nearly as much.
        for lean in (tilt, tilt / 2):
            away = _height(arm) * np.array(
                [np.sin(lean) * np.cos(heading), np.sin(lean) * np.sin(heading), np.cos(lean)]
            )
            x, y, z = (float(value) for value in np.asarray(place, float) + away)
            T = look_at((x, y, z), (float(place[0]), float(place[1]), float(place[2])))
            solutions = solutions_near(T @ T_camera_tool0, postures[-1] if postures else None, arm)
            if len(solutions):
                postures.append(solutions[0])
                break
    return postures
