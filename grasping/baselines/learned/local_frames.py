"""Where hands are tried: at points of the surface, along its normal, turned about the axis along which it bends least.

Source: ten Pas, Gualtieri, Saenko, Platt, "Grasp Pose Detection in Point Clouds", IJRR 2017: at sampled points the
frame of the averaged normal and the two principal directions of curvature; a grid of turns about the axis of least
curvature and of places along the closing direction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.geometry.sampling import spread
from grasping.geometry.surface_variation import covariances

FloatArray = NDArray[np.float64]

NEAREST = 16  # points that a normal is fitted to
FRAME_NEAREST = 30  # normals that a frame is fitted to


def local_frames(cloud: FloatArray, viewpoint: FloatArray, n_samples: int) -> tuple[FloatArray, FloatArray]:
    """Points (M, 3) spread over the cloud (N, 3), m, and rotations (M, 3, 3) there: the columns are the direction
    across the axis, the axis of least curvature, and the direction into the surface, away from the viewpoint (3,).
    """
    tree = cKDTree(cloud)
    _, members = tree.query(cloud, k=min(NEAREST, len(cloud)))
    normals = np.linalg.eigh(covariances(cloud[members]))[1][:, :, 0]
    samples = spread(cloud, n_samples)
    _, members = tree.query(samples, k=min(FRAME_NEAREST, len(cloud)))
    # Signs do not count in n nᵀ, whose least eigenvector is the direction in which no normal leans.
    near = normals[members]
    scatter = np.linalg.eigh(np.einsum("mki,mkj->mij", near, near))[1]
    inward, axis = scatter[:, :, 2], scatter[:, :, 0]
    inward = inward * np.where(np.einsum("mi,mi->m", inward, samples - viewpoint) < 0.0, -1.0, 1.0)[:, None]
    return samples, np.stack([np.cross(axis, inward), axis, inward], axis=2)


def turned_hands(
    samples: FloatArray, frames: FloatArray, turns: FloatArray, offsets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rotations (M·T·O, 3, 3) and origins (M·T·O, 3) of hands: each frame turned about its axis by turns (T,), rad, and
    moved along the closing direction by offsets (O,), m.
    """
    cos, sin, zero, one = np.cos(turns), np.sin(turns), np.zeros_like(turns), np.ones_like(turns)
    about_axis = np.stack([cos, zero, sin, zero, one, zero, -sin, zero, cos], axis=1).reshape(-1, 3, 3)
    rotations = np.einsum("mij,tjk->mtik", frames, about_axis)
    origins = samples[:, None, None] + offsets[None, None, :, None] * rotations[:, :, None, :, 0]
    rotations = np.broadcast_to(rotations[:, :, None], (*origins.shape[:3], 3, 3))
    return rotations.reshape(-1, 3, 3), origins.reshape(-1, 3)
