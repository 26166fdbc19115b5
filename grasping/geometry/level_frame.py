"""The frame in which learned functions look at an object: z is up, the table z = 0, as where their labels came from."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import ConfigError

FloatArray = NDArray[np.float64]

GraspScores: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], ArrayLike]
"""(cloud (N, 3), poses (G, 4, 4), widths (G,)) → (G,) in [0, 1], higher is better; all in a level frame, m."""


def level_frame(cloud: FloatArray, up: FloatArray | None, table: FloatArray | None) -> FloatArray:
    """T_level_cloud (4, 4): up (3,) becomes z by the shortest turn, and the table (4,), else the lowest point, z = 0.

    Where up is not known, z stays what it was.
    """
    pose = np.eye(4)
    if up is not None:
        axis = np.cross(up, [0.0, 0.0, 1.0])
        cosine = float(up[2])
        if cosine < -1.0 + 1e-12:
            pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
        else:
            cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
            pose[:3, :3] += cross + cross @ cross / (1.0 + cosine)
    pose[2, 3] = float(table[3]) if table is not None else -float((cloud @ pose[2, :3]).min())
    return pose


def level_scores(
    scores: GraspScores,
    cloud: FloatArray,
    poses: FloatArray,
    widths: FloatArray,
    up: FloatArray | None,
    table: FloatArray | None,
) -> FloatArray:
    """What `scores` says of grasps (G, 4, 4) in the cloud's frame: (G,).

    Raises ConfigError where it says something else than one number in [0, 1] a grasp.
    """
    T_level_cloud = level_frame(cloud, up, table)
    said = np.asarray(scores(cloud @ T_level_cloud[:3, :3].T + T_level_cloud[:3, 3], T_level_cloud @ poses, widths))
    if said.shape != widths.shape or not ((said >= 0.0) & (said <= 1.0)).all():
        raise ConfigError(f"scores: said {said!r:.80} of {len(widths)} grasps; of each one number in [0, 1] is needed")
    return said.astype(np.float64)
