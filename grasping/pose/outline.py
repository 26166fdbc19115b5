"""The lines of a model that are drawn over a cloud: where it ends as seen from the camera, and its creases."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasping.pose.object_model import ObjectModel

FloatArray = NDArray[np.float64]

CREASE = math.cos(math.radians(40))  # of two faces' normals
STEP = 0.001  # m between the points of a line


def outline(model: ObjectModel, T_camera_object: FloatArray, eye: FloatArray) -> FloatArray:
    """Points (M, 3) along the model's outline and creases at a pose, seen from (3,), in the camera's frame, m."""
    at = (eye - T_camera_object[:3, 3]) @ T_camera_object[:3, :3]
    corners = model.vertices[model.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    facing = np.einsum("ij,ij->i", normal, at - corners[:, 0]) > 0
    ends = np.sort(model.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    face = np.repeat(np.arange(len(model.faces)), 3)
    order = np.lexsort(ends.T)
    ends, face = ends[order], face[order]
    same = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    one, other = face[same], face[same + 1]
    seen = facing[one] | facing[other]
    drawn = seen & ((facing[one] != facing[other]) | (np.einsum("ij,ij->i", normal[one], normal[other]) < CREASE))
    start, stop = model.vertices[ends[same[drawn]]].swapaxes(0, 1)
    count = np.maximum(1, np.ceil(np.linalg.norm(stop - start, axis=1) / STEP)).astype(int)
    line = np.repeat(np.arange(len(count)), count)
    along = (np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)) / count[line]
    points = start[line] + along[:, None] * (stop - start)[line]
    return np.asarray(points @ T_camera_object[:3, :3].T + T_camera_object[:3, 3], np.float64)
