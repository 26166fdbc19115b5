"""What an episode of DualGrasp-v1 starts with: where the thing lies, how far to carry it, where the arms are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.robot.two_arm_bases import MIDDLE
from pecgrasp_env.scene.placement import PlacementError, move
from pecgrasp_env.scene.settling import settle

_OFF_MIDDLE_M = (0.03, 0.05)
_MOST_TURNED = np.deg2rad(40)  # of its long axis against the line across
_UP_M, _SIDEWAYS_M = (0.15, 0.22), (0.05, 0.10)
_FALL_M = 0.005


@dataclass(frozen=True)
class DualStart:
    """pose: (7,) world frame, m and wxyz. goal: (3,) m. joint_offsets: (2, 6) rad, of the arms from where they wait."""

    pose: np.ndarray
    goal: np.ndarray
    joint_offsets: np.ndarray


def draw_start(model: ObjectModel, rng: np.random.Generator, joint_noise: float) -> DualStart:
    """Raises PlacementError where the object does not come to rest."""
    lowest = min(float(hull[:, 2].min()) for hull in model.hulls)
    poses, at_rest = settle([model], np.array([[0.0, 0.0, _FALL_M - lowest, 1.0, 0.0, 0.0, 0.0]]))
    if not at_rest[0]:
        raise PlacementError(f"{model.instance} does not come to rest on the table")
    outline = np.concatenate(model.hulls)[:, :2]
    middle = (outline.max(axis=0) + outline.min(axis=0)) / 2
    yaw = np.pi / 2 + rng.uniform(-_MOST_TURNED, _MOST_TURNED) + np.pi * rng.integers(2)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    place = np.array(MIDDLE) + rng.uniform(-1.0, 1.0, 2) * _OFF_MIDDLE_M
    # The middle of its extent is put there, not its centre of mass.
    pose = move(poses[0], yaw, place - turn @ middle)
    heading, far = rng.uniform(-np.pi, np.pi), rng.uniform(*_SIDEWAYS_M)
    goal = np.array([far * np.cos(heading), far * np.sin(heading), rng.uniform(*_UP_M)])
    return DualStart(pose, goal, rng.uniform(-joint_noise, joint_noise, size=(2, 6)))
