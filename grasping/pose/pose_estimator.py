"""Where known objects lie in a cloud: pairs of points vote, the best poses are aligned, and looked at from both sides.

After Drost et al. 2010 ("Model globally, match locally") and Vidal et al. 2018 ("A method for 6D pose estimation of
free-form rigid objects using point pair features on range data"); the view check after Hinterstoisser et al. 2016.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import ConfigError, ModelError
from grasping.pose.acceptance import AMONG, LEAST_INLIERS, NAMED, SURFACE, Limits, differ, refusal, rival
from grasping.pose.candidates import Judged, Sought, judge, refined, tolerance_at
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
COARSE_STEPS, FINE_STEPS, LAST_STEPS = 6, 12, 25
COARSE_POINTS, FINE_POINTS = 120, 400
LEAST_TURNED = 0.5  # score from which on the poses in which a model looks alike are tried: worse is another thing
NEARLY = 0.9  # of the best's score: poses that may still become the best
LARGE_ENOUGH = 0.75  # of a piece's extent: the least diameter of a model that may be all of it, as noise lengthens it
AS_GOOD = 0.97  # of the best's score: poses that fit as well


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
        for part, pieces in zip(parts.parts, parts.pieces, strict=True):
            assert view is not None
            poses, why = self._in_part(parts, part, pieces, view)
            found += poses
            reasons += why
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
        self.reason = refusal(fine, sought, self._limits)
        return None if self.reason else self._pose(fine, [], parts.index[self._near(parts, part, fine)])

    @property
    def _limits(self) -> Limits:
        return NAMED if len({each.model.label for each in self._prepared}) == 1 else AMONG

    def _sought(self, parts: Parts, part: IntArray, view: View) -> Sought:
        points = parts.points[part]
        tolerance = tolerance_at(float(np.linalg.norm(points.mean(axis=0) - parts.eye)))
        return Sought(*seen_surface(points, parts.eye, SURFACE), view, parts.table, tolerance)

    def _in_part(
        self, parts: Parts, part: IntArray, pieces: Sequence[IntArray], view: View
    ) -> tuple[list[ObjectPose], list[str]]:
        """The objects in one part, piece by piece, and why the rest is none.

        A pose that a piece gives takes all of the part's points that lie on it: the segmenter may have cut one thing
        in two, and what is left of a piece in which it joined two is searched again.
        """
        found: list[ObjectPose] = []
        reasons: list[str] = []
        left = np.zeros(len(parts.points), dtype=bool)
        left[part] = True
        for piece in pieces:
            rest = piece[left[piece]]
            while len(rest) >= max(FEWEST, (1.0 - LEAST_INLIERS) * len(piece)):
                best, tried, reason = self._in_piece(parts, rest, view)
                near = np.empty(0, np.int64) if best is None else self._near(parts, part[left[part]], best)
                if best is None or not len(near):
                    reasons += [reason] if reason else []
                    break
                found.append(self._pose(best, tried, parts.index[near]))
                left[near] = False
                rest = piece[left[piece]]
        return found, reasons

    def _in_piece(self, parts: Parts, piece: IntArray, view: View) -> tuple[Judged | None, list[Judged], str]:
        """The best explained object of a piece, what was tried, and why there is none."""
        if float(np.ptp(parts.points[piece], axis=0).max()) < 2.0 * SURFACE:
            return None, [], f"it is hardly {2.0 * SURFACE:g} m wide"
        sought = self._sought(parts, piece, view)
        tried: list[Judged] = []
        best: Judged | None = None
        # Models that are large enough to be all of the piece go first: where one is, the smaller ones are none of it.
        reach = LARGE_ENOUGH * extent(sought.points)
        for large in (True, False):
            own = [each for each in self._prepared if (each.model.diameter >= reach) is large]
            if best is None:
                tried += [each for each in (self._best(prepared, sought) for prepared in own) if each is not None]
                tried.sort(key=lambda each: -each.score[0])
                best = next((each for each in tried if not refusal(each, sought, self._limits)), None)
        if not tried:
            return None, [], "no pair of its points is one of a model's"
        reason = refusal(tried[0], sought, self._limits) if best is None else rival(best, tried)
        return (None if reason else best), tried, reason

    def _best(self, prepared: PreparedModel, sought: Sought) -> Judged | None:
        model = prepared.model
        sample = thinner(sought.points, sought.normals, prepared.sampled)
        most = max(HYPOTHESES, len(sample[0]) // POINTS_EACH)
        T, _ = propose(prepared.table, prepared.corners, *sample, model.diameter, most)
        if not len(T):
            return None
        coarse = refined(prepared, sought.some(COARSE_POINTS), T, FIRST_REACH * model.diameter, COARSE_STEPS)
        best = self._fine(prepared, sought, coarse)
        return best if best.score[0] < LEAST_TURNED else self._turned(prepared, sought, best)

    def _turned(self, prepared: PreparedModel, sought: Sought, best: Judged) -> Judged:
        """The best of the poses and of those in which the model looks much as it does in the first."""
        if not len(prepared.look_alikes):
            return best
        T, reach = best.T[0] @ prepared.look_alikes, SECOND_REACH * prepared.model.diameter
        coarse = refined(prepared, sought.some(COARSE_POINTS), T, reach, COARSE_STEPS)
        fine = self._fine(prepared, sought, coarse)
        return judge(prepared, sought.some(FINE_POINTS), np.concatenate([best.T, fine.T]))

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

    def _pose(self, best: Judged, tried: Sequence[Judged], indices: IntArray) -> ObjectPose:
        prepared = best.prepared
        as_good = best.T[1:][best.score[1:] >= AS_GOOD * best.score[0]]
        others: list[FloatArray] = []
        for T in as_good:
            if all(differ(prepared.model, known, T) for known in (best.T[0], *others)):
                others.append(T)
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


def extent(points: FloatArray) -> float:
    """The diagonal of the box (m) along the principal axes of points (N, 3)."""
    off = points - points.mean(axis=0)
    return float(np.linalg.norm(np.ptp(off @ np.linalg.eigh(off.T @ off)[1], axis=0)))
