"""What is searched: the parts of a cloud, a scene or a whole frame, and what else the camera saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import CloudError
from grasping.geometry.clustering import by_label, voxel_clusters
from grasping.segmentation.scene import Scene
from grasping.segmentation.segmenter import Segmenter
from grasping.validation import LARGEST_OBJECT, as_cloud, plane_equation, position

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FEWEST = 60  # points of a part: on fewer, hardly more than a plane can be told
OFF_TABLE = 0.006  # m: what is lower is the table's noise
GAP = 0.012  # m: parts of a frame are farther apart
FINELY = -3.0  # log odds: a thing that is cut in two is found by either piece, two that are joined by none
WIDEST = 1.0  # m: a wider part is a wall, or the robot, not a heap of things


@dataclass(frozen=True, eq=False)
class Parts:
    """points: (N, 3) of the whole input that is measured. parts: indices into it of what may be objects, each apart
    from the others; pieces: of each part, those of the things into which the segmenter cuts it, the largest first.
    index: (N,) of the points in the flattened input. eye: (3,). table: (4,), n·p + d = 0, or None. reason: why there
    are no parts.
    """

    points: FloatArray
    parts: list[IntArray]
    pieces: list[list[IntArray]]
    index: IntArray
    eye: FloatArray
    table: FloatArray | None
    reason: str = ""


def parts_of(cloud: ArrayLike | Scene, viewpoint: ArrayLike | None, table: ArrayLike | None) -> Parts:
    """Of a cut-out (N, 3), a `Scene`, or an organised frame (H, W, 3), m, in which NaN and (0, 0, 0) are invalid.

    viewpoint: (3,) where the camera stood, None: the scene's, or the origin. table: (4,), None: the scene's, of a frame
    the one that is found in it. Raises CloudError for what is no such input, ConfigError for the other two.
    """
    eye = np.zeros(3) if viewpoint is None else position(viewpoint, name="viewpoint")
    plane = None if table is None else plane_equation(table)
    if isinstance(cloud, Scene):
        if viewpoint is None and cloud.viewpoint is not None:
            eye = np.asarray(cloud.viewpoint, dtype=np.float64)
        return _of_scene(cloud, eye, plane if plane is not None else cloud.plane)
    if np.ndim(cloud) == 3:
        return _of_frame(np.asarray(cloud), eye, plane)
    points = as_cloud(cloud, name="cloud")
    if len(points) and float(np.ptp(points, axis=0).max()) > 2 * LARGEST_OBJECT:
        raise CloudError(
            f"cloud: spans {float(np.ptp(points, axis=0).max()):.6g} m, more than {2 * LARGEST_OBJECT} m; are these "
            "millimetres? A whole frame is given as (H, W, 3)"
        )
    every = np.arange(len(points))
    if len(points) < FEWEST:
        return Parts(points, [], [], every, eye, plane, f"{len(points)} points, at least {FEWEST} are needed")
    return Parts(points, [every], [[every]], every, eye, plane)


def _of_scene(scene: Scene, eye: FloatArray, plane: FloatArray | None) -> Parts:
    clouds = [np.asarray(each, dtype=np.float64) for each in scene.objects]
    others = [np.asarray(each, dtype=np.float64) for each in scene.obstacles]
    points = np.concatenate([*clouds, *others]) if clouds or others else np.empty((0, 3))
    index = np.concatenate(
        [np.asarray(i, dtype=np.int64).reshape(-1) for i in scene.indices] or [np.empty(0, np.int64)]
    )
    index = np.concatenate([index, np.full(len(points) - len(index), -1)])
    owner = np.repeat(np.arange(len(clouds)), [len(each) for each in clouds])
    # What touches is one part: the segmenter may have cut one thing in two.
    parts = _clusters(points, np.arange(len(owner)))
    reason = "" if parts else f"the scene has no object of at least {FEWEST} points"
    return Parts(points, parts, [_pieces(part, owner) for part in parts], index, eye, plane, reason)


def _of_frame(frame: NDArray, eye: FloatArray, plane: FloatArray | None) -> Parts:
    scene = Segmenter(whole_rather=FINELY).segment(frame, viewpoint=None if not eye.any() else eye)
    if plane is None:
        plane = scene.plane
    flat = frame.reshape(-1, 3).astype(np.float64)
    measured = np.isfinite(flat).all(axis=1) & (np.square(flat).sum(axis=1) > 0)
    index = np.flatnonzero(measured)
    points = flat[index]
    owner = np.full(len(flat), -1)
    for number, own in enumerate(scene.indices):
        owner[own] = number
    owner = owner[index]
    above = measured[index] if plane is None else points @ plane[:3] + plane[3] > OFF_TABLE
    # Where the segmenter sees things, the rest is wall, floor or robot.
    parts = _clusters(points, np.flatnonzero(above & (owner >= 0 if (owner >= 0).any() else True)))
    reason = "" if parts else f"nothing of at least {FEWEST} points stands on the table"
    return Parts(points, parts, [_pieces(part, owner[part]) for part in parts], index, eye, plane, reason)


def _clusters(points: FloatArray, chosen: IntArray) -> list[IntArray]:
    clusters = [chosen[own] for own in by_label(voxel_clusters(points[chosen], GAP)) if len(own) >= FEWEST]
    return [own for own in clusters if float(np.ptp(points[own], axis=0).max()) <= WIDEST]


def _pieces(part: IntArray, owner: IntArray) -> list[IntArray]:
    """Of a part those of one owner (N,) each, the largest first."""
    pieces = [part[owner == number] for number in np.unique(owner)]
    return sorted(pieces, key=len, reverse=True)
