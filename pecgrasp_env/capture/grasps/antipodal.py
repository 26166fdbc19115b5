"""Antipodal grasps on an object on a table: two contacts that face each other, taken from any side that is free.

A line through a point of the surface, within the friction cone of its normal, is cut with the object's convex parts,
which are what the simulator touches. Two of the places where it goes in and comes out are contacts where friction holds
at both (Nguyen 1988), the pads fit between and the fingers beside: so walls and handles are found as well as wholes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.motion.grasp_approach import clear_of_table
from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.objects.meshing.surface_points import doubled_normals, uniform_points
from pecgrasp_env.objects.model import FRICTION

__all__ = ["OPEN_MARGIN_M", "TABLE", "Antipodal", "antipodal_grasps"]

TABLE = np.array([0.0, 0.0, 1.0, 0.0])
OPEN_MARGIN_M = 0.03  # wider than the object, both sides together, as the policy where its planner has no wish

_PAD_FRICTION = (0.8 + FRICTION) / 2  # of a contact: the mean of both materials'
_AXIS_CONE = np.arctan(0.35)  # within which the closing axis is drawn about the surface's normal
_GAP_M = 5e-4  # convex parts that are nearer to each other are one piece
_ROOM_M = 0.002  # beside a finger, where another piece of the object is next
_LEAST_WIDTH_M = 0.002
_LINES = 400  # drawn at once
_ROUNDS = 6
_STEEPEST_AXIS = 0.75  # of the closing axis' vertical part: beyond, a finger would have to be below the object
_FROM_ABOVE = 0.5  # share that come down as steeply as the closing axis allows
_TILT = np.radians(35.0)  # standard deviation of the others about that
_MOST_TILT = np.radians(75.0)  # of the approach against straight down
_ON_PAD_M = 0.025  # how far from the pads' centre, along the approach, the contacts may be drawn
_PAD_REACH_M = ROBOTIQ_2F_140.pad_length / 2 - 0.003  # and may come to lie where the table draws the hand back


@dataclass(frozen=True)
class Antipodal:
    """Grasps T_world_grasp (n, 4, 4), the tips clear of the table, and their widths (n,) m."""

    poses: np.ndarray
    widths: np.ndarray


def antipodal_grasps(model: ObjectModel, T_world_object: np.ndarray, count: int, rng: np.random.Generator) -> Antipodal:
    """Up to `count` grasps of the object as it lies (4, 4); fewer where it has few such places."""
    shapes = [ConvexHull(hull.astype(float)).equations for hull in model.hulls]
    poses: list[np.ndarray] = []
    widths: list[float] = []
    for _ in range(_ROUNDS):
        points, normals = _on_surface(model, _LINES, rng)
        axes = _within_cone(normals, rng)
        for start, end, line in _contacts(shapes, points, axes, rng):
            turn = T_world_object[:3, :3]
            axis = turn @ axes[line]
            middle = turn @ (points[line] + (start + end) / 2 * axes[line]) + T_world_object[:3, 3]
            pose = _approach(middle, axis, end - start, rng)
            if pose is not None:
                poses.append(pose)
                widths.append(end - start)
            if len(poses) == count:
                break
        if len(poses) == count:
            break
    return Antipodal(np.array(poses).reshape(-1, 4, 4), np.array(widths))


def _on_surface(model: ObjectModel, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) uniform on what is seen of the object, and normals (n, 3) of either sign; object frame."""
    corners = np.concatenate([part.vertices[part.faces] for part in model.parts]).astype(float)
    normals = doubled_normals(corners)
    areas = np.linalg.norm(normals, axis=1)
    points, face = uniform_points(corners, areas, count, rng)
    return points, normals[face] / areas[face, None]


def _within_cone(normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Directions (n, 3) about the normals, uniform in the tangent of the angle's disc."""
    noise = rng.standard_normal(normals.shape)
    across = np.cross(normals, noise)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    axes = normals + np.tan(_AXIS_CONE) * np.sqrt(rng.random((len(normals), 1))) * across
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _contacts(
    shapes: list[np.ndarray], points: np.ndarray, axes: np.ndarray, rng: np.random.Generator
) -> Iterator[tuple[float, float, int]]:
    """Where pads may touch: two places along a line, m from its point, and which line; at most one pair a line."""
    cuts = [_cut(equations, points, axes) for equations in shapes]
    starts, ends, facing_in, facing_out = (np.stack(each, axis=1) for each in zip(*cuts, strict=True))
    room = ROBOTIQ_2F_140.finger_thickness + _ROOM_M
    for line in range(len(points)):
        pieces = _pieces(starts[line], ends[line], facing_in[line], facing_out[line])
        last = len(pieces) - 1
        pairs = [
            (pieces[i][0], pieces[j][1])
            for i in range(len(pieces))
            for j in range(i, len(pieces))
            if _LEAST_WIDTH_M <= pieces[j][1] - pieces[i][0] <= ROBOTIQ_2F_140.stroke - 2 * _ROOM_M
            and min(pieces[i][2], pieces[j][3]) >= np.cos(np.arctan(_PAD_FRICTION))
            and (i == 0 or pieces[i][0] - pieces[i - 1][1] >= room)
            and (j == last or pieces[j + 1][0] - pieces[j][1] >= room)
        ]
        if pairs:
            yield (*pairs[rng.integers(len(pairs))], line)


def _cut(equations: np.ndarray, points: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of a convex shape (F, 4) and lines: where each goes in and comes out (n,) m, NaN where it misses, and the cosines
    between the line and the face's inward normal there, and its outward normal where it comes out."""
    along = axes @ equations[:, :3].T
    above = points @ equations[:, :3].T + equations[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = -above / along
    enter, leave = np.where(along < 0, at, -np.inf), np.where(along > 0, at, np.inf)
    first, second = enter.argmax(axis=1), leave.argmin(axis=1)
    row = np.arange(len(points))
    start, end = enter[row, first], leave[row, second]
    missed = (start >= end) | ((along == 0) & (above > 0)).any(axis=1)
    return np.where(missed, np.nan, start), np.where(missed, np.nan, end), -along[row, first], along[row, second]


def _pieces(starts: np.ndarray, ends: np.ndarray, facing_in: np.ndarray, facing_out: np.ndarray) -> list[list[float]]:
    """What a line meets, in order: start and end of each piece of solid, and the cosines of `_cut` there."""
    pieces: list[list[float]] = []
    for k in np.argsort(starts):
        if np.isnan(starts[k]):
            break  # the others were missed, too: they come last
        if pieces and starts[k] <= pieces[-1][1] + _GAP_M:
            if ends[k] > pieces[-1][1]:
                pieces[-1][1], pieces[-1][3] = ends[k], facing_out[k]
        else:
            pieces.append([starts[k], ends[k], facing_in[k], facing_out[k]])
    return pieces


def _approach(middle: np.ndarray, axis: np.ndarray, width: float, rng: np.random.Generator) -> np.ndarray | None:
    """T_world_grasp (4, 4) with the pads about `middle`, closing along `axis`; None where the table is in the way."""
    steepest = np.array([0.0, 0.0, -1.0]) + axis[2] * axis
    if abs(axis[2]) > _STEEPEST_AXIS:
        return None
    steepest /= np.linalg.norm(steepest)
    turn = 0.0 if rng.random() < _FROM_ABOVE else rng.normal(0, _TILT)
    approach = np.cos(turn) * steepest + np.sin(turn) * np.cross(axis, steepest)
    if -approach[2] < np.cos(_MOST_TILT):
        return None
    pose = np.eye(4)
    pose[:3, :3] = np.stack([axis, np.cross(approach, axis), approach], axis=1)
    pose[:3, 3] = middle - rng.uniform(-_ON_PAD_M, _ON_PAD_M) * approach
    cleared = clear_of_table(pose, min(ROBOTIQ_2F_140.stroke, width + OPEN_MARGIN_M), TABLE)
    return cleared if abs((middle - cleared[:3, 3]) @ approach) <= _PAD_REACH_M else None
