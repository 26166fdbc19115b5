"""Tiny clouds of known shapes for the tests of `grasping`: deterministic, metres, z up, table at z = 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

UP = (0.0, 0.0, 1.0)
TABLE = (0.0, 0.0, 1.0, 0.0)
FloatArray = NDArray[np.float64]


def grid(*ranges: tuple[float, float], step: float) -> FloatArray:
    """All points of a regular grid, ends included."""
    axes = [np.linspace(a, b, max(2, round((b - a) / step) + 1)) for a, b in ranges]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(ranges))


def moved(points: FloatArray, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> FloatArray:
    return points + np.array([x, y, z])


def box_top(length: float, width: float, height: float, step: float = 0.003, bottom: bool = True) -> FloatArray:
    """A box's top face and two of its sides, as a camera above sees it: long axis x, centred at the origin."""
    top = grid((-length / 2, length / 2), (-width / 2, width / 2), step=step)
    parts = [np.column_stack([top, np.full(len(top), height)])]
    if bottom:
        side = grid((-length / 2, length / 2), (0.0, height), step=step)
        parts.append(np.column_stack([side[:, 0], np.full(len(side), -width / 2), side[:, 1]]))
        end = grid((-width / 2, width / 2), (0.0, height), step=step)
        parts.append(np.column_stack([np.full(len(end), length / 2), end[:, 0], end[:, 1]]))
    return np.vstack(parts)


def roof(height: float) -> FloatArray:
    """A board of 160 × 120 mm over the origin, of which the lower side is there."""
    board = grid((-0.08, 0.08), (-0.06, 0.06), step=0.004)
    return np.column_stack([board, np.full(len(board), height)])


def standing_can(radius: float, height: float, step: float = 0.003) -> FloatArray:
    """A can as seen from above and one side: its top disc and half of its wall."""
    disc = grid((-radius, radius), (-radius, radius), step=step)
    disc = disc[np.hypot(*disc.T) <= radius]
    wall = grid((-np.pi / 2, np.pi / 2), (0.0, height), step=step / radius)
    wall = np.column_stack([radius * np.cos(wall[:, 0]), radius * np.sin(wall[:, 0]), wall[:, 1]])
    return np.vstack([np.column_stack([disc, np.full(len(disc), height)]), wall])


def ringed_cylinder(radius: float, length: float, rings: int, around: int) -> FloatArray:
    """Evenly spaced points on the wall of a cylinder along y."""
    y = (np.arange(rings) + 0.5) / rings * length - length / 2
    angle = np.arange(around) * (2 * np.pi / around)
    angle, y = (axis.reshape(-1) for axis in np.meshgrid(angle, y))
    return np.column_stack([radius * np.cos(angle), y, radius * np.sin(angle)])


def whole_cylinder(radius: float, length: float, count: int = 256, seed: int = 0) -> FloatArray:
    """Random points on the wall of a cylinder along y."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    y = (rng.permutation(count) + 0.5) / count * length - length / 2
    return np.column_stack([radius * np.cos(angle), y, radius * np.sin(angle)])


def pliers(step: float = 0.002) -> FloatArray:
    """Seen from above: two parallel handles, 100 × 12 × 12 mm with 30 mm between them, joined by a 50 mm head."""
    handle = box_top(0.100, 0.012, 0.012, step=step, bottom=False)
    head = box_top(0.050, 0.054, 0.014, step=step, bottom=False)
    return np.vstack([moved(handle, y=0.021), moved(handle, y=-0.021), moved(head, x=0.075)])


def axis_angle(a: FloatArray, b: FloatArray) -> float:
    """Angle (rad) between two axes, their signs ignored."""
    return float(np.arccos(np.clip(abs(a @ b), 0.0, 1.0)))


def tips(pose: FloatArray, pad_length: float = 0.065) -> FloatArray:
    """Where the pads' tips are, midway between the fingers."""
    return pose[:3, 3] + 0.5 * pad_length * pose[:3, 2]
