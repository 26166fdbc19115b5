"""How far an estimated pose is from the true one, as the field measures it.

ADD and ADD-S (Hinterstoisser et al. 2012), the area under their curve (Xiang et al., PoseCNN, 2018), and of the BOP
benchmark MSSD and VSD (Hodaň et al. 2020), as its toolkit computes them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.pose.symmetry import Symmetry

FloatArray = NDArray[np.float64]

AUC_TO = 0.10  # m
DIAMETER_SHARE = 0.10  # of the diameter: nearer is right (PoseCNN, LINEMOD)
NEAR_ENOUGH = 0.02  # m: nearer can be grasped (DenseFusion)
VSD_DELTA = 0.015  # m that a surface may lie behind what was measured and still be the one that was
VSD_TAUS = tuple(round(0.05 * k, 2) for k in range(1, 11))  # of the diameter
SYMMETRY_STEP = 0.01  # of the diameter that the farthest point moves between two steps about an axis


def add(points: FloatArray, T_estimated: FloatArray, T_true: FloatArray) -> float:
    """Mean distance, m, of the model's points (N, 3) at the two poses (4, 4)."""
    return float(np.linalg.norm(_at(points, T_estimated) - _at(points, T_true), axis=1).mean())


def add_s(points: FloatArray, T_estimated: FloatArray, T_true: FloatArray) -> float:
    """Mean distance, m, of each point at the true pose from the nearest at the estimated one: blind to symmetry."""
    return float(cKDTree(_at(points, T_estimated)).query(_at(points, T_true))[0].mean())


def auc(errors: ArrayLike, to: float = AUC_TO) -> float:
    """Area under the curve of the share of errors below a threshold, over thresholds from 0 to `to`, m; in [0, 1].

    An object that was not found has an infinite error. Raises ValueError for no errors.
    """
    values = np.asarray(errors, dtype=np.float64)
    if not len(values):
        raise ValueError("errors: none, so there is no curve")
    return float(np.clip(1 - values / to, 0, 1).mean())


def mssd(
    points: FloatArray,
    T_estimated: FloatArray,
    T_true: FloatArray,
    symmetry: Symmetry,
    step: float = SYMMETRY_STEP,
) -> float:
    """Greatest distance, m, of a surface point at the two poses, at the best of the model's symmetric poses.

    Any angle about an axis is tried in steps that move no point by more than a share of the diameter, `step`, as BOP
    does.
    """
    if symmetry.ball is not None:
        at = np.append(symmetry.ball, 1.0)
        return float(np.linalg.norm((T_estimated - T_true) @ at))
    estimated = _at(points, T_estimated)
    angle = math.radians(6)
    if symmetry.axis is not None:
        point, direction = symmetry.axis
        off = points - point
        radius = float(np.linalg.norm(off - (off @ direction)[:, None] * direction, axis=1).max())
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        angle = step * extent / max(radius, 1e-9)
    turned = T_true @ symmetry.transforms(angle)
    squared = np.zeros((len(turned), len(points)))
    for i in range(3):
        squared += (turned[:, i, :3] @ points.T + turned[:, i, 3, None] - estimated[:, i]) ** 2
    return float(np.sqrt(squared.max(axis=1).min()))


def vsd(
    measured: FloatArray,
    estimated: FloatArray,
    true: FloatArray,
    K: FloatArray,
    diameter: float,
    delta: float = VSD_DELTA,
    taus: ArrayLike = VSD_TAUS,
) -> FloatArray:
    """Visible surface discrepancy for each tolerance tau, a share of the diameter: in [0, 1], 0 where all is right.

    measured, estimated, true: depth images (H, W), m, of the scene and of the model at the two poses, 0 where there is
    nothing (`depth_image`). K: (3, 3). Distances are from the camera's centre; a pixel counts where the model at either
    pose is visible, which is where it is no more than delta, m, behind the scene, or nothing was measured.
    """
    rows, columns = np.indices(measured.shape)
    ray = np.sqrt(((columns - K[0, 2]) / K[0, 0]) ** 2 + ((rows - K[1, 2]) / K[1, 1]) ** 2 + 1)
    scene, at_estimate, at_truth = (np.asarray(image, np.float64) * ray for image in (measured, estimated, true))

    def visible(image: FloatArray) -> NDArray[np.bool_]:
        return (image > 0) & ((image - scene <= delta) | (scene == 0))

    in_truth = visible(at_truth)
    in_estimate = visible(at_estimate) | (in_truth & (at_estimate > 0))
    both, either = in_truth & in_estimate, int((in_truth | in_estimate).sum())
    if not either:
        return np.ones(len(np.asarray(taus)))
    off = np.abs(at_truth[both] - at_estimate[both]) / diameter
    wrong = (off[None] >= np.asarray(taus, np.float64)[:, None]).sum(axis=1)
    return np.asarray((wrong + either - both.sum()) / either, np.float64)


def _at(points: FloatArray, T: FloatArray) -> FloatArray:
    return points @ T[:3, :3].T + T[:3, 3]
