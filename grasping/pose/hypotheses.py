"""Poses that a scene's votes speak for: those of nearly one place joined, the most voted for first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.pose.point_pairs import FINE, TURNS, PairTable, frames, pairs_of
from grasping.pose.voting import vote

FloatArray = NDArray[np.float64]

EVERY = 5  # so many points of the scene for one that votes (Drost et al.)
FEWEST = 40  # vote, where there are so many
PEAKS = 3  # of its accumulator that are taken
SAME_PLACE = 0.1  # of the diameter: root mean square distance of the corners of two poses that are one


def propose(
    table: PairTable, corners: FloatArray, points: FloatArray, normals: FloatArray, diameter: float, most: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """T_scene_object (H, 4, 4) of at most so many poses, and their votes (H,), the most first.

    points, normals: (S, 3) of the scene, as far apart as the table's. corners: (C, 3) of the model, object frame.
    """
    if len(points) < 3:
        return np.empty((0, 4, 4)), np.empty(0, dtype=np.int64)
    voters = np.arange(0, len(points), max(1, min(EVERY, len(points) // FEWEST)))
    pairs = pairs_of(points, normals, voters, table.step, diameter)
    found = vote(table, pairs, len(voters), PEAKS).reshape(-1, 3)
    T = poses(table, frames(points[voters], normals[voters]), found)
    order = np.argsort(-found[:, 0], kind="stable")
    order = order[found[order, 0] > 0]
    return joined(T[order], found[order, 0].astype(np.int64), corners, SAME_PLACE * diameter, most)


def poses(table: PairTable, to_local: FloatArray, found: NDArray[np.int32]) -> FloatArray:
    """T_scene_object (R * PEAKS, 4, 4) of what was voted for, by the scene's `frames` (R, 4, 4)."""
    angle = found[:, 2] * (2.0 * np.pi / (TURNS * FINE))
    turn = np.zeros((len(found), 4, 4))
    turn[:, 0, 0] = turn[:, 3, 3] = 1.0
    turn[:, 1, 1] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 2, 1] = np.sin(angle)
    turn[:, 1, 2] = -turn[:, 2, 1]
    back = np.repeat(_inverse(to_local), len(found) // max(len(to_local), 1), axis=0)
    return back @ turn @ table.to_local[found[:, 1]]


def joined(
    T: FloatArray, votes: NDArray[np.int64], corners: FloatArray, near: float, most: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """The poses of which none before it, in order, is within `near` m; each with the votes of those that are."""
    at = np.einsum("hij,cj->hci", T[:, :3, :3], corners) + T[:, None, :3, 3]
    flat = (at - at.mean(axis=0)).reshape(len(T), -1)
    length = np.einsum("hi,hi->h", flat, flat)
    squared = (length[:, None] + length - 2.0 * flat @ flat.T) / len(corners)
    kept: list[int] = []
    sums: list[int] = []
    for number in range(len(T)):
        if kept:
            gaps = squared[number, kept]
            nearest = int(gaps.argmin())
            if gaps[nearest] < near * near:
                sums[nearest] += int(votes[number])
                continue
        kept.append(number)
        sums.append(int(votes[number]))
    total = np.array(sums, dtype=np.int64)
    order = np.argsort(-total, kind="stable")[:most]
    return T[np.array(kept, dtype=np.int64)[order]], total[order]


def _inverse(T: FloatArray) -> FloatArray:
    out = np.zeros_like(T)
    out[:, :3, :3] = T[:, :3, :3].transpose(0, 2, 1)
    out[:, :3, 3] = -np.einsum("nij,nj->ni", out[:, :3, :3], T[:, :3, 3])
    out[:, 3, 3] = 1.0
    return out
