"""When a pose is believed: what the best fit of a model must bear out, and why it is refused where it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.pose.candidates import Judged, Sought, on_surface
from grasping.pose.metrics import mssd
from grasping.pose.object_model import ObjectModel

FloatArray = NDArray[np.float64]

SURFACE = 0.005  # m between the points that are aligned and judged
LEAST_SEEN = 0.7  # of the model's surface in sight: 98 % of D435 cut-outs of which up to 40 % is hidden have more
LEAST_SHOWN = 0.5  # of all of it that faces the camera: what hides more leaves too much to chance
LEAST_DETAIL = 8.0  # tolerances: the side of a square as large as what was measured on the model
TOGETHER = 9  # points, over whose mean noise is little, and the error of a wrong shape is not
MOST_SUNK = 0.1  # of the model below the table
LEAST_INLIERS = 0.9  # of a part on one model, where it is one thing: what is on a cut-out's own model, D435 or Kinect
SMOOTH = 0.9, 0.35  # least cosine of two normals, and greatest slope, with which a surface goes on from point to point
# Where other things are in the part, too: least share of the surface in sight that was measured, and how far the rest
# may go on where the model ends, in roots of the points explained, which an outline has some 3.5 of. A model that is
# there from end to end may touch a thing; where it is not, the piece may be another thing's. Then, of all that faces
# the camera, hidden or not, the least share that was measured, and how far off the points may lie, in tolerances.
WHOLE, ENDS = (0.95, 0.8, 0.75, 0.45), (0.2, LEAST_SHOWN, 1.0)
RIVAL = 0.9  # of the best's score: where a model of another class and shape fits as well, the piece tells neither


@dataclass(frozen=True)
class Limits:
    """clear: of a model in front of what was measured there, at most. shared: tolerances, at most, of the root mean
    square of the distance from the model that TOGETHER neighbours share. ends: of its surface in sight the least share
    that was measured, where other things are in the part and little of its surface goes on.
    """

    clear: float
    shared: float
    ends: float


# Of 91 right poses in heaps of the task none has more in front, strangers that fit a small piece have 0.038 to 0.05.
AMONG = Limits(clear=0.03, shared=0.27, ends=0.95)
# One class alone is sought: the caller knows that the thing is of it, and what refuses strangers costs poses of it.
NAMED = Limits(clear=0.1, shared=np.inf, ends=0.8)
OTHER = 0.1  # of the diameter: how far a point must be from where the other pose has it for the two to differ
APART, TURNED = 20, 0.05  # every so many points are compared, and turned about an axis in steps of this of the diameter


def refusal(judged: Judged, sought: Sought, limits: Limits) -> str:
    """Why the best of the poses is none, or ""."""
    fits = f"{judged.prepared.model.name} fits best, but"
    if judged.clear[0] > limits.clear:
        return (
            f"{fits} {judged.clear[0]:.0%} of it would stand in front of what was seen there, at most "
            f"{limits.clear:.0%} may"
        )
    if judged.seen[0] < LEAST_SEEN:
        return f"{fits} {judged.seen[0]:.0%} of its side was measured, at least {LEAST_SEEN:.0%} must be"
    if judged.shown[0] < LEAST_SHOWN:
        return f"{fits} {judged.shown[0]:.0%} of its side is to be seen, at least {LEAST_SHOWN:.0%} must be"
    if judged.sunk[0] > MOST_SUNK:
        return f"{fits} {judged.sunk[0]:.0%} of it would lie below the table, at most {MOST_SUNK:.0%} may"
    if SURFACE * np.sqrt(judged.inliers[0] * len(sought.points)) < LEAST_DETAIL * sought.tolerance:
        return f"{fits} what is seen of it is too small for the sensor's noise to tell its shape"
    shared = 0.0 if np.isinf(limits.shared) else shared_residual(judged, sought) / sought.tolerance
    if shared > limits.shared:
        return f"{fits} its surface bends otherwise: neighbours are off by {shared:.2f} tolerances together"
    return "" if judged.inliers[0] >= LEAST_INLIERS else _beside_others(judged, sought, limits)


def shared_residual(judged: Judged, sought: Sought) -> float:
    """Root mean square, m, of the distance along normals of the points on the best pose, each with its neighbours'.

    Infinite where fewer than TOGETHER lie on it.
    """
    on, off = on_surface(judged.prepared, sought, judged.T[:1])
    place, off = sought.points[on[0]], off[0, on[0]]
    if len(place) < TOGETHER:
        return float("inf")
    together = off[cKDTree(place).query(place, k=TOGETHER)[1]].mean(axis=1)
    return float(np.sqrt(np.mean(together * together)))


def _beside_others(judged: Judged, sought: Sought, limits: Limits) -> str:
    """Why it is none in a part of which it explains too little to be all of it, or ""."""
    model, seen, shown = judged.prepared, judged.seen[0], judged.shown[0]
    name = model.model.name
    explained = f"{name} fits best, but explains {judged.inliers[0]:.0%} of the points, not {LEAST_INLIERS:.0%}, and"
    ends = (limits.ends, *ENDS)
    if seen < limits.ends:
        return f"{explained} {seen:.0%} of its side was measured, at least {limits.ends:.0%} must be"
    local = (sought.points - judged.T[0, :3, 3]) @ judged.T[0, :3, :3]
    on = model.grid.within(local, model.spacing + 2.0 * sought.tolerance)
    runs = goes_on(sought.points, sought.normals, on) / max(np.sqrt(on.sum()), 1.0)
    off = judged.residual[0] / sought.tolerance
    if not any(seen >= a and runs <= b and shown >= c and off <= d for a, b, c, d in (WHOLE, ends)):
        return f"{explained} the surface goes on where the model ends"
    return ""


def rival(best: Judged, tried: list[Judged]) -> str:
    """Why the piece tells neither of two models: another, of another class and shape, fits about as well; or "".

    Kin are told apart by less, and taking one for the other does less harm.
    """
    label = best.prepared.model.label
    for each in tried:
        if each.prepared.model.label == label or each.score[0] < RIVAL * best.score[0]:
            continue
        if elsewhere(best, each):
            one, other = best.prepared.model.name, each.prepared.model.name
            return f"{one} fits, but {other}, which has another shape, fits about as well"
    return ""


def differ(model: ObjectModel, one: FloatArray, other: FloatArray) -> bool:
    """Whether the model lies otherwise at the second pose (4, 4): a turn onto itself is no other pose.

    Its surface may lie nearly in the same place, as that of a clamp that is turned over.
    """
    return mssd(model.points[::APART], other, one, model.symmetry, step=TURNED) > OTHER * model.diameter


def elsewhere(one: Judged, other: Judged) -> bool:
    """Whether the other's best pose puts a surface where the one's has none, or leaves one out."""
    places = [each.prepared.model.points[::5] @ each.T[0, :3, :3].T + each.T[0, :3, 3] for each in (one, other)]
    most = OTHER * max(one.prepared.model.diameter, other.prepared.model.diameter)
    there = [
        float(each.prepared.tree.query((place - each.T[0, :3, 3]) @ each.T[0, :3, :3])[0].max())
        for each, place in ((one, places[1]), (other, places[0]))
    ]
    return max(there) > most


def goes_on(points: FloatArray, normals: FloatArray, on: NDArray[np.bool_]) -> int:
    """How many of the points (S, 3) that are `on` a model have a neighbour that is not, on one smooth surface."""
    if on.all() or not on.any():
        return 0
    inside, outside = np.flatnonzero(on), np.flatnonzero(~on)
    gap, near = cKDTree(points[outside]).query(points[inside], distance_upper_bound=2.0 * SURFACE)
    inside = inside[np.isfinite(gap)]
    near = outside[near[np.isfinite(gap)]]
    step = points[near] - points[inside]
    rise = np.abs(np.einsum("ij,ij->i", step, normals[inside]))
    alike = np.einsum("ij,ij->i", normals[inside], normals[near])
    return int(((alike > SMOOTH[0]) & (rise < SMOOTH[1] * np.linalg.norm(step, axis=1))).sum())
