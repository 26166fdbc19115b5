"""The grasps that are tried on an object: antipodal ones, the planner's, and worsened copies of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from grasping import ROBOTIQ_2F_140, CurvaturePlanner
from pecgrasp_env.capture.grasps.antipodal import OPEN_MARGIN_M, TABLE, antipodal_grasps
from pecgrasp_env.motion.grasp_approach import clear_of_table
from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.robot.kinematics import UP

__all__ = ["SAMPLERS", "CandidateSampler", "Candidates"]

SAMPLERS = ("antipodal", "planner", "worsened")
_ANTIPODAL, _PLANNER, _WORSENED = range(len(SAMPLERS))

_SHIFT_M = (0.010, 0.012, 0.008)  # standard deviations of what worsens a grasp, along its axes,
_TURN_RAD = np.radians(8.0)  # and about each of them


@dataclass(frozen=True)
class Candidates:
    """n grasps: T_world_grasp (n, 4, 4), widths and openings (n,) m, sampler (n,) uint8 into SAMPLERS."""

    poses: np.ndarray
    widths: np.ndarray
    openings: np.ndarray
    sampler: np.ndarray


class CandidateSampler:
    """shares: of each of SAMPLERS. What the planner does not find, antipodal grasps take the place of."""

    def __init__(self, shares: Mapping[str, float]) -> None:
        weights = np.array([shares.get(name, 0.0) for name in SAMPLERS])
        self._shares = weights / weights.sum()
        self._planner = CurvaturePlanner(ROBOTIQ_2F_140)

    def draw(
        self,
        model: ObjectModel,
        T_world_object: np.ndarray,
        points: np.ndarray,
        viewpoint: np.ndarray,
        count: int,
        rng: np.random.Generator,
    ) -> Candidates:
        """Up to `count` grasps on an object as it lies (4, 4), seen as points (N, 3) from a viewpoint (3,), world."""
        wanted = np.diff(np.round(np.concatenate([[0], np.cumsum(self._shares)]) * count).astype(int))
        planned = self._planned(points, viewpoint, wanted[_PLANNER], rng)
        rest = count - len(planned.widths) - wanted[_WORSENED]
        drawn = antipodal_grasps(model, T_world_object, rest, rng)
        openings = np.minimum(drawn.widths + OPEN_MARGIN_M, ROBOTIQ_2F_140.stroke)
        antipodal = Candidates(drawn.poses, drawn.widths, openings, np.full(len(openings), _ANTIPODAL, np.uint8))
        good = _joined(antipodal, planned)
        return _joined(good, _worsened(good, wanted[_WORSENED], rng))

    def _planned(self, points: np.ndarray, viewpoint: np.ndarray, count: int, rng: np.random.Generator) -> Candidates:
        """The best of the planner's grasps, and others of any rank."""
        found = self._planner.plan(points, up=UP, table=TABLE, viewpoint=viewpoint).candidates if count else []
        others = rng.permutation(np.arange(1, len(found)))
        chosen = [found[i] for i in np.concatenate([np.arange(min(1, len(found))), others]).astype(int)[:count]]
        openings = np.array([min(ROBOTIQ_2F_140.stroke, grasp.terms["opening"]) for grasp in chosen])
        poses = [clear_of_table(g.pose, opening, TABLE) for g, opening in zip(chosen, openings, strict=True)]
        widths = np.array([grasp.width for grasp in chosen])
        return Candidates(np.array(poses).reshape(-1, 4, 4), widths, openings, np.full(len(chosen), _PLANNER, np.uint8))


def _worsened(good: Candidates, count: int, rng: np.random.Generator) -> Candidates:
    """Copies that are shifted and turned in their own frames, and may so be in the table or in the object."""
    if not len(good.widths):
        return good
    which = rng.integers(len(good.widths), size=count)
    away = np.tile(np.eye(4), (count, 1, 1))
    away[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, _TURN_RAD, (count, 3))).as_matrix()
    away[:, :3, 3] = rng.normal(0, _SHIFT_M, (count, 3))
    sampler = np.full(count, _WORSENED, np.uint8)
    return Candidates(good.poses[which] @ away, good.widths[which], good.openings[which], sampler)


def _joined(first: Candidates, second: Candidates) -> Candidates:
    pairs = zip(vars(first).values(), vars(second).values(), strict=True)
    return Candidates(*(np.concatenate(pair) for pair in pairs))
