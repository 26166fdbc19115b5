"""Many hands are proposed, those that something is in the way of fall out, and a learned function ranks the rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.baselines.learned.hand_room import HandSpace
from grasping.baselines.learned.local_frames import local_frames, turned_hands
from grasping.errors import ConfigError, require_between
from grasping.geometry.level_frame import GraspScores, level_frame, level_scores
from grasping.geometry.sampling import thinned
from grasping.grasp import Grasp, GraspPlan, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.validation import object_cloud, require_near, sight, workspace

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GraspProposals: TypeAlias = Callable[[FloatArray], ArrayLike]
"""cloud (N, 3) in a level frame, m → poses (G, 4, 4) of grasps there."""

TURNS = 8  # about the axis of least curvature, over half a turn
OFFSETS_M = np.linspace(-0.06, 0.06, 7)  # along the closing direction
BITE_M = 0.01  # of the tips past the first point between them, at least
NARROWER_M = (0.03, 0.01)  # spare openings, both sides together, where the open hand has no room
LEAST_WIDTH_M = 0.002
SAME_PLACE_M, SAME_TURN = 0.01, math.cos(math.radians(20))  # grasps nearer than both are one


@dataclass(frozen=True)
class _Hands:
    """rotations (M, 3, 3), pads' centres (M, 3), openings to come in with (M,) and widths at contact (M,), m."""

    rotations: FloatArray
    origins: FloatArray
    openings: FloatArray
    widths: FloatArray


class LearnedPlanner:
    """Plan grasps that `scores` ranks: `pec.grasps.GraspScorer` is such a function, of a trained network.

    scores: (cloud, poses, widths) → how good each grasp is, in [0, 1]; see `GraspScores`.
    propose: cloud → poses, as `pec.grasps.GraspProposer`; None: hands on local frames of the surface, as GPD
        (ten Pas et al., IJRR 2017) and PointNetGPD (Liang et al., ICRA 2019) have them: pushed forward until something
        is in the way, then centred on what is between the fingers.
    n_samples: points of the surface at which hands are tried.
    n_judged: hands that `scores` is asked about, at most.
    n_grasps: of the plan, at most, no two alike.
    max_tilt: of the approach against straight down, rad, where up is known; an arm reaches little else.
    tip_clearance: of the open hand above a known table, m.
    n_points: larger clouds are thinned before hands are tried; `scores` is given all points.

    Terms of a grasp: `opening`, m, to come in with; `reach`, m, of the tips past what is between them; `tilt`, rad.
    """

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        scores: GraspScores,
        propose: GraspProposals | None = None,
        n_samples: int = 40,
        n_judged: int = 256,
        n_grasps: int = 40,
        max_tilt: float = math.radians(60),
        tip_clearance: float = 0.004,
        n_points: int = 600,
    ) -> None:
        for name, value, least, most in (
            ("n_samples", n_samples, 1, 10_000),
            ("n_judged", n_judged, 1, 100_000),
            ("n_grasps", n_grasps, 1, 1000),
            ("max_tilt", max_tilt, 0.0, math.pi),
            ("tip_clearance", tip_clearance, 0.0, 0.1),
            ("n_points", n_points, 50, 100_000),
        ):
            require_between(name, value, least, most)
        if not callable(scores):
            raise ConfigError(f"scores = {scores!r:.80} must be a function; checkpoint=DIR of an evaluator makes one")
        self.gripper = gripper
        self.scores = scores
        self.propose = propose
        self.n_samples, self.n_judged, self.n_grasps = n_samples, n_judged, n_grasps
        self.max_tilt, self.tip_clearance, self.n_points = max_tilt, tip_clearance, n_points
        self._turns = np.linspace(-0.5 * np.pi, 0.5 * np.pi, TURNS, endpoint=False)

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
        unseen: ArrayLike | None = None,
    ) -> GraspPlan:
        """Plan on the cloud (N, 3) of one object, m; what was not seen (unseen) counts as free.

        viewpoint: the first of several says which side of the surface is outside; None: the frame's origin.
        Raises CloudError for a cloud, ConfigError for a scene that is none, or for scores that are none.
        """
        cloud = object_cloud(points)
        up_vector, plane, neighbours = workspace(up, table, obstacles)
        viewpoints, _ = sight(viewpoint, unseen)
        if plane is not None:
            require_near(cloud.T, plane)
        some = thinned(cloud, self.n_points)
        space = HandSpace(self.gripper, some, neighbours, plane, self.tip_clearance)
        if self.propose is None:
            eye = np.zeros(3) if viewpoints is None else viewpoints[0]
            tried, forward = self._on_local_frames(some, eye), True
        else:
            tried, forward = self._proposed(cloud, up_vector, plane), False
        n_tried = len(tried[0])
        rotations, origins = self._tilted_little(*tried, up_vector)
        hands, reach = self._with_room(space, rotations, origins, forward)
        if not len(reach):
            reason = f"of {n_tried} hands that were tried none has room around something to hold"
            return plan_from([], [], reason)
        if len(reach) > self.n_judged:
            chosen = np.linspace(0, len(reach) - 1, self.n_judged).round().astype(np.int64)
            hands, reach = _taken(hands, chosen), reach[chosen]
        poses = np.tile(np.eye(4), (len(reach), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = hands.rotations, hands.origins
        score = level_scores(self.scores, cloud, poses, hands.widths, up_vector, plane)
        grasps = []
        for k in _unlike(poses, score, self.n_grasps):
            terms = {"opening": float(hands.openings[k]), "reach": float(reach[k])}
            if up_vector is not None:
                terms["tilt"] = float(np.arccos(np.clip(-poses[k, :3, 2] @ up_vector, -1.0, 1.0)))
            grasps.append(Grasp(poses[k], float(hands.widths[k]), float(score[k]), "region", None, terms))
        return plan_from(grasps, [], "")

    def _on_local_frames(self, cloud: FloatArray, eye: FloatArray) -> tuple[FloatArray, FloatArray]:
        samples, frames = local_frames(cloud, eye, self.n_samples)
        return turned_hands(samples, frames, self._turns, OFFSETS_M)

    def _proposed(
        self, cloud: FloatArray, up: FloatArray | None, table: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        assert self.propose is not None
        T_level_cloud = level_frame(cloud, up, table)
        poses = np.asarray(self.propose(cloud @ T_level_cloud[:3, :3].T + T_level_cloud[:3, 3]), np.float64)
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise ConfigError(f"propose: gave an array of shape {poses.shape}, poses (G, 4, 4) were expected")
        poses = np.linalg.inv(T_level_cloud) @ poses
        return poses[:, :3, :3], poses[:, :3, 3]

    def _tilted_little(
        self, rotations: FloatArray, origins: FloatArray, up: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        if up is None:
            return rotations, origins
        kept = -(rotations[:, :, 2] @ up) >= math.cos(self.max_tilt) - 1e-9
        return rotations[kept], origins[kept]

    def _with_room(
        self, space: HandSpace, rotations: FloatArray, origins: FloatArray, forward: bool
    ) -> tuple[_Hands, FloatArray]:
        """Hands that hold something and that nothing is in the way of, and the reach (M,) of each, m.

        forward: whether they go on until something is in the way; else they only draw back where they must.
        """
        room = space.room(rotations, origins, np.full(len(origins), self.gripper.stroke), np.inf if forward else 0.0)
        kept = np.isfinite(room.advance) & (room.width >= LEAST_WIDTH_M) & (room.reach >= BITE_M)
        rotations, advance = rotations[kept], room.advance[kept, None]
        origins = origins[kept] + advance * rotations[:, :, 2] + room.middle[kept, None] * rotations[:, :, 0]
        widths = room.width[kept]
        # Centred, the open hand may be kept farther back than it was; a narrower one less.
        openings = np.minimum(self.gripper.stroke, widths + np.array([[math.inf], *([m] for m in NARROWER_M)]))
        rooms = [space.room(rotations, origins, each, 0.0) for each in openings]
        best = np.argmax([each.advance for each in rooms], axis=0)
        row = np.arange(len(widths))
        advance, reach, held = (
            np.array([getattr(each, name) for each in rooms])[best, row] for name in ("advance", "reach", "width")
        )
        good = np.flatnonzero(np.isfinite(advance) & (held >= LEAST_WIDTH_M) & (reach >= BITE_M))
        origins = origins[good] + advance[good, None] * rotations[good, :, 2]
        return _Hands(rotations[good], origins, openings[best, row][good], held[good]), reach[good]


def _taken(hands: _Hands, index: IntArray) -> _Hands:
    return _Hands(hands.rotations[index], hands.origins[index], hands.openings[index], hands.widths[index])


def _unlike(poses: FloatArray, score: FloatArray, most: int) -> list[int]:
    """The best grasps (of G poses), each unlike those before it; a hand turned half round its approach is the same."""
    left = score.copy()
    chosen: list[int] = []
    while len(chosen) < most and np.isfinite(left).any():
        best = int(left.argmax())
        chosen.append(best)
        near = np.linalg.norm(poses[:, :3, 3] - poses[best, :3, 3], axis=1) < SAME_PLACE_M
        near &= np.abs(poses[:, :3, 0] @ poses[best, :3, 0]) > SAME_TURN
        near &= poses[:, :3, 2] @ poses[best, :3, 2] > SAME_TURN
        left[near] = -np.inf
    return chosen
