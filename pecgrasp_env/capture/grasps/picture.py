"""A small picture of grasps on what a camera saw: points, and hands drawn as lines, seen askew from above."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from grasping import ROBOTIQ_2F_140
from pec.grasps.labels import GraspScene

__all__ = ["OUTCOME_COLORS", "grasp_picture"]

OUTCOME_COLORS = ((38, 150, 70), (235, 150, 20), (215, 50, 40), (130, 90, 190))
"""Of each outcome of `trials.OUTCOMES`."""
_SIDE, _FINE, _MARGIN = 300, 2, 12  # pixels; drawn this much larger, then reduced
_PAPER, _NEAR, _FAR = (250, 250, 248), np.array([60, 75, 90]), np.array([185, 195, 205])
_ELEVATION = np.radians(35.0)
_BEHIND_M, _STEM_M = 0.06, 0.035  # from the pads' centre back to where the lines meet, and from there on


def grasp_picture(scene: GraspScene, chosen: np.ndarray, in_frame: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 of a scene and its grasps of the indices `chosen`, each in its outcome's colour.

    in_frame: indices of the grasps for which the picture has room, so that two pictures show the object alike.
    """
    away = scene.T_world_camera[:2, 3] - scene.points[:, :2].mean(axis=0)
    azimuth = np.arctan2(away[1], away[0])
    back = np.array([np.cos(azimuth) * np.cos(_ELEVATION), np.sin(azimuth) * np.cos(_ELEVATION), np.sin(_ELEVATION)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    down = np.cross(right, back)
    axes = np.stack([right, down, back], axis=1)
    points = scene.points.astype(float) @ axes
    hands = {i: _hand(scene.T_world_grasp[i].astype(float), float(scene.widths[i])) @ axes for i in in_frame.tolist()}
    everything = np.concatenate([points, *hands.values()])[:, :2]
    low, high = everything.min(axis=0), everything.max(axis=0)
    size = _FINE * _SIDE
    scale = (size - 2 * _FINE * _MARGIN) / max(float((high - low).max()), 1e-6)
    image = Image.new("RGB", (size, size), _PAPER)
    draw = ImageDraw.Draw(image)

    def on_paper(at: np.ndarray) -> np.ndarray:
        return (at[..., :2] - (low + high) / 2) * scale + size / 2

    near = (points[:, 2] - points[:, 2].min()) / max(float(np.ptp(points[:, 2])), 1e-9)
    for i in np.argsort(points[:, 2]):
        x, y = on_paper(points[i])
        color = (_FAR + near[i] * (_NEAR - _FAR)).astype(int)
        draw.ellipse([x - 2, y - 2, x + 2, y + 2], fill=tuple(color.tolist()))
    for i in chosen.tolist():
        corners = [tuple(each) for each in on_paper(hands[i]).tolist()]
        color = OUTCOME_COLORS[int(scene.outcome[i])]
        draw.line(corners[:4], fill=color, width=2 * _FINE, joint="curve")
        draw.line(corners[4:], fill=color, width=2 * _FINE)
    return np.asarray(image.resize((_SIDE, _SIDE), Image.Resampling.LANCZOS))


def _hand(T_world_grasp: np.ndarray, width: float) -> np.ndarray:
    """(6, 3) world: tip, root, root and tip of the fingers, then the stem's two ends."""
    half, tip = width / 2, ROBOTIQ_2F_140.pad_length / 2
    corners = [(-half, tip), (-half, -_BEHIND_M), (half, -_BEHIND_M), (half, tip)]
    corners += [(0.0, -_BEHIND_M), (0.0, -_BEHIND_M - _STEM_M)]
    return np.array([[x, 0.0, z] for x, z in corners]) @ T_world_grasp[:3, :3].T + T_world_grasp[:3, 3]
