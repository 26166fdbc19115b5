"""Where known objects lie in a cloud: pairs of points vote, the best poses are aligned, and looked at from both sides.

After Drost et al. 2010 ("Model globally, match locally") and Vidal et al. 2018 ("A method for 6D pose estimation of
free-form rigid objects using point pair features on range data"); the view check after Hinterstoisser et al. 2016.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.errors import ConfigError, ModelError
from grasping.pose.candidates import Judged, Sought, refined, tolerance_at
from grasping.pose.hypotheses import propose
from grasping.pose.object_model import ObjectModel
from grasping.pose.object_pose import Ambiguity, ObjectPose
from grasping.pose.prepared_model import PreparedModel
from grasping.pose.scene_parts import FEWEST, Parts, parts_of
from grasping.pose.scene_surface import seen_surface, thinner
from grasping.pose.view import View
from grasping.segmentation.scene import Scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HYPOTHESES = 25  # of a model that are aligned, at least
POINTS_EACH = 8  # of the sample that votes: in a heap so many more are
FINE_HYPOTHESES = 4  # of them that are aligned again, on more points
FIRST_REACH, SECOND_REACH = 0.12, 0.04  # of the diameter: how far off a pose that was voted for may be, and then
SURFACE = 0.005  # m between the points that are aligned
COARSE_STEPS, FINE_STEPS, LAST_STEPS = 6, 12, 25
COARSE_POINTS, FINE_POINTS = 120, 400
LEAST_SEEN = 0.7  # of the model's surface in sight: 98 % of D435 cut-outs of which up to 40 % is hidden have more
MOST_CLEAR = 0.1  # of it in front of what was measured there
MOST_SUNK = 0.1  # of the model below the table
LEAST_INLIERS = 0.9  # of a part on one model, where it is one thing: what is on a cut-out's own model, D435 or Kinect
SMOOTH = 0.9, 0.35  # least cosine of two normals, and greatest slope, with which a surface goes on from point to point
RUNS_ON = 0.2  # of the root of the points explained, which an outline has some 3.5 of: where it goes on, the thing does
LEAST_SEEN_BESIDE = 0.8  # of a model's surface in sight, where other things are in the part, too
NEARLY = 0.9  # of the best's score: poses that may still become the best
AS_GOOD = 0.97  # of the best's score: poses that fit as well
OTHER = 0.1  # of the diameter: how far a point of one pose must be from the other for the two to differ


class PoseEstimator:
    """Finds known objects in clouds, by their shape alone.

    models: the known objects. Raises ModelError where there are none, or two of one name.

    reason: why the last call found nothing, or nothing more; "" where all was explained.
    """

    def __init__(self, models: Sequence[ObjectModel]) -> None:
        if not len(models):
            raise ModelError("models: none; a pose is found of a known model only")
        names = [model.name for model in models]
        for name in names:
            if names.count(name) > 1:
                raise ModelError(f"models: two are called {name!r}; each needs a name of its own")
        self.models = tuple(models)
        self.reason = ""
        self._prepared = [PreparedModel(model) for model in models]

    def of_class(self, label: str) -> PoseEstimator:
        """One that knows the models of a class only, prepared once for both. Raises ModelError where there are none."""
        of_it = [each for each in self._prepared if each.model.label == label]
        estimator = PoseEstimator([each.model for each in of_it])
        estimator._prepared = of_it
        return estimator

    def estimate(
        self,
        cloud: ArrayLike | Scene,
        viewpoint: ArrayLike | None = None,
        table: ArrayLike | None = None,
    ) -> list[ObjectPose]:
        """The known objects in a cut-out (N, 3) of one thing or several, a `Scene`, or an organised frame (H, W, 3), m.

        viewpoint: (3,) where the camera stood, in the cloud's frame; None: the scene's, or the origin. table: (4,),
        n·p + d = 0 with n up; None: the scene's, of a frame the one that is found in it. Raises CloudError and
        ConfigError (`scene_parts.parts_of`).
        """
        parts = parts_of(cloud, viewpoint, table)
        found: list[ObjectPose] = []
        reasons = [parts.reason] if parts.reason else []
        view = View.of(parts.points, parts.eye) if parts.parts else None
        for part in parts.parts:
            assert view is not None
            poses, reason = self._in_part(parts, part, view)
            found += poses
            reasons += [reason] if reason else []
        self.reason = "; ".join(dict.fromkeys(reasons))
        return found

    def refine(
        self,
        cloud: ArrayLike | Scene,
        model: ObjectModel,
        proposals: ArrayLike,
        viewpoint: ArrayLike | None = None,
        table: ArrayLike | None = None,
    ) -> ObjectPose | None:
        """The best of the proposals T_camera_object (P, 4, 4) of one model after alignment, None where none passes.

        The same check decides as in `estimate`; `reason` then says why. Raises ConfigError for proposals that are no
        poses, or a model that the estimator was not made with.
        """
        prepared = next((each for each in self._prepared if each.model is model), None)
        if prepared is None:
            raise ConfigError(f"model = {model.name!r} is none of the estimator's")
        T = np.asarray(proposals, dtype=np.float64)
        if T.ndim != 3 or T.shape[1:] != (4, 4) or not np.isfinite(T).all():
            raise ConfigError(f"proposals: shape {T.shape}, expected finite (P, 4, 4)")
        parts = parts_of(cloud, viewpoint, table)
        self.reason = parts.reason
        if not parts.parts or not len(T):
            self.reason = self.reason or "no proposals"
            return None
        view = View.of(parts.points, parts.eye)
        part = np.concatenate(parts.parts)
        sought = self._sought(parts, part, view)
        coarse = refined(prepared, sought.some(COARSE_POINTS), T, FIRST_REACH * model.diameter, COARSE_STEPS)
        fine = self._fine(prepared, sought, coarse)
        self.reason = self._refusal(fine, sought)
        return None if self.reason else self._pose(fine, [], parts.index[self._near(parts, part, fine)])

    def _sought(self, parts: Parts, part: IntArray, view: View) -> Sought:
        points = parts.points[part]
        tolerance = tolerance_at(float(np.linalg.norm(points.mean(axis=0) - parts.eye)))
        return Sought(*seen_surface(points, parts.eye, SURFACE), view, parts.table, tolerance)

    def _in_part(self, parts: Parts, part: IntArray, view: View) -> tuple[list[ObjectPose], str]:
        """The objects in one part, the best explained first, and why the rest is none."""
        found: list[ObjectPose] = []
        rest, reason = part, ""
        while len(rest) >= max(FEWEST, (1.0 - LEAST_INLIERS) * len(part)):
            if float(np.ptp(parts.points[rest], axis=0).max()) < 2.0 * SURFACE:
                reason = f"it is hardly {2.0 * SURFACE:g} m wide"
                break
            sought = self._sought(parts, rest, view)
            tried = [each for each in (self._best(prepared, sought) for prepared in self._prepared) if each is not None]
            if not tried:
                reason = "no pair of its points is one of a model's"
                break
            tried.sort(key=lambda each: -each.score[0])
            best = next((each for each in tried if not self._refusal(each, sought)), None)
            if best is None:
                reason = self._refusal(tried[0], sought)
                break
            near = self._near(parts, rest, best)
            if not len(near):
                break
            found.append(self._pose(best, tried, parts.index[near]))
            rest = np.setdiff1d(rest, near, assume_unique=True)
        return found, reason

    def _best(self, prepared: PreparedModel, sought: Sought) -> Judged | None:
        model = prepared.model
        sample = thinner(sought.points, sought.normals, prepared.sampled)
        most = max(HYPOTHESES, len(sample[0]) // POINTS_EACH)
        T, _ = propose(prepared.table, prepared.corners, *sample, model.diameter, most)
        if not len(T):
            return None
        coarse = refined(prepared, sought.some(COARSE_POINTS), T, FIRST_REACH * model.diameter, COARSE_STEPS)
        return self._fine(prepared, sought, coarse)

    def _fine(self, prepared: PreparedModel, sought: Sought, coarse: Judged) -> Judged:
        """The best of the poses aligned with more points, and then, those as good as the first, until they rest."""
        few, reach = sought.some(FINE_POINTS), SECOND_REACH * prepared.model.diameter
        fine = refined(prepared, few, coarse.first(FINE_HYPOTHESES).T, reach, FINE_STEPS)
        good = fine.of(np.flatnonzero(fine.score >= NEARLY * fine.score[0]))
        return refined(prepared, few, good.T, 0.0, LAST_STEPS)

    def _near(self, parts: Parts, rest: IntArray, best: Judged) -> IntArray:
        """Those of the points that the model explains, whichever way they face."""
        prepared, T = best.prepared, best.T[0]
        points = parts.points[rest]
        local = (points - T[:3, 3]) @ T[:3, :3]
        reach = prepared.spacing + 2.0 * tolerance_at(float(np.linalg.norm(points.mean(axis=0) - parts.eye)))
        return rest[prepared.grid.within(local, reach)]

    def _refusal(self, judged: Judged, sought: Sought) -> str:
        """Why the best of the poses is none, or ""."""
        reason = refusal(judged)
        if reason or judged.inliers[0] >= LEAST_INLIERS:
            return reason
        name = judged.prepared.model.name
        if judged.seen[0] < LEAST_SEEN_BESIDE:
            return (
                f"{name} fits best, but explains {judged.inliers[0]:.0%} of the points, and {judged.seen[0]:.0%} of "
                f"its side was measured: at least {LEAST_INLIERS:.0%} or {LEAST_SEEN_BESIDE:.0%} are needed"
            )
        on = judged.prepared.grid.within(
            (sought.points - judged.T[0, :3, 3]) @ judged.T[0, :3, :3], judged.prepared.spacing + 2.0 * sought.tolerance
        )
        if goes_on(sought.points, sought.normals, on) > RUNS_ON * np.sqrt(on.sum()):
            return (
                f"{name} fits best, but explains {judged.inliers[0]:.0%} of a surface that goes on "
                f"where the model ends, at least {LEAST_INLIERS:.0%} are needed"
            )
        return ""

    def _pose(self, best: Judged, tried: Sequence[Judged], indices: IntArray) -> ObjectPose:
        prepared = best.prepared
        as_good = best.T[1:][best.score[1:] >= AS_GOOD * best.score[0]]
        others = [T for T in as_good if differ(prepared, best.T[0], T)]
        models = tuple(
            each.prepared.model.name for each in tried if each is not best and each.score[0] >= AS_GOOD * best.score[0]
        )
        ambiguous = Ambiguity(prepared.model.symmetry, np.array(others).reshape(-1, 4, 4), models)
        return ObjectPose(
            best.T[0],
            prepared.model,
            float(best.inliers[0]),
            float(best.residual[0]),
            ambiguous,
            float(best.seen[0]),
            float(best.clear[0]),
            indices,
        )


def refusal(judged: Judged) -> str:
    """Why the best of the poses is none, or ""."""
    name = judged.prepared.model.name
    if judged.clear[0] > MOST_CLEAR:
        return (
            f"{name} fits best, but {judged.clear[0]:.0%} of it would stand in front of what was seen there, at most "
            f"{MOST_CLEAR:.0%} may"
        )
    if judged.seen[0] < LEAST_SEEN:
        return f"{name} fits best, but {judged.seen[0]:.0%} of its side was measured, at least {LEAST_SEEN:.0%} must be"
    if judged.sunk[0] > MOST_SUNK:
        return (
            f"{name} fits best, but {judged.sunk[0]:.0%} of it would lie below the table, at most {MOST_SUNK:.0%} may"
        )
    return ""


def differ(prepared: PreparedModel, one: FloatArray, other: FloatArray) -> bool:
    """Whether the model's surface lies elsewhere at the second pose: a turn onto itself is no other pose."""
    points = prepared.model.points[::5]
    moved = ((points @ other[:3, :3].T + other[:3, 3]) - one[:3, 3]) @ one[:3, :3]
    return bool(prepared.tree.query(moved)[0].max() > OTHER * prepared.model.diameter)


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
