"""Which grasps two arms try: a pair that balances the weight, and what it is compared with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from grasping import ROBOTIQ_2F_140, Arm, CurvaturePlanner, Grasp, plan_pair
from grasping.pair_planner.pair_planner import candidates, couple
from pecgrasp_env.motion.two_arms import can_reach
from pecgrasp_env.policy.two_arms.looking import Seen
from pecgrasp_env.robot.two_arm_bases import T_WORLD_BASE

Holds = dict[int, Grasp]  # of each arm that is to hold it, 0 or 1, its grasp, world frame


@dataclass(frozen=True)
class Choice:
    """What to try, the best first; or why there is nothing. centre: (3,) m, where the weight is thought to be."""

    holds: list[Holds] = field(default_factory=list)
    reason: str | None = None
    centre: np.ndarray | None = None


Choose = Callable[[Seen, np.ndarray, np.random.Generator], Choice]


def pair(seen: Seen, goal: np.ndarray, rng: np.random.Generator) -> Choice:
    """Of `plan_pair`, the pairs in its order."""
    plan = plan_pair(seen.points, table=seen.plane, viewpoint=seen.viewpoint, arms=_arms(seen, goal))
    reason = None if plan.reason is None else f"{plan.reason.kind}: {plan.reason.text}"
    return Choice([dict(enumerate(each.grasps)) for each in plan.pairs], reason, plan.outline.centre)


def random_pair(seen: Seen, goal: np.ndarray, rng: np.random.Generator) -> Choice:
    """Two of the same grasps that two arms can take at once, drawn without a look at the weight."""
    grasps, reasons, outline = candidates(seen.points, table=seen.plane, viewpoint=seen.viewpoint)
    pairs, refusal = couple(grasps, reasons, outline, _arms(seen, goal))
    reason = None if refusal is None else f"{refusal.kind}: {refusal.text}"
    order = rng.permutation(len(pairs))
    return Choice([dict(enumerate(pairs[k].grasps)) for k in order], reason, outline.centre)


def single(seen: Seen, goal: np.ndarray, rng: np.random.Generator) -> Choice:
    """The default planner's grasps on the whole thing for one arm, the best first: the nearer arm, then the other."""
    plan = CurvaturePlanner(ROBOTIQ_2F_140).plan(
        seen.points, up=seen.plane[:3], table=seen.plane, viewpoint=seen.viewpoint
    )
    holds: list[Holds] = []
    for grasp in plan.candidates:
        distances = np.linalg.norm(T_WORLD_BASE[:, :3, 3] - grasp.pose[:3, 3], axis=1)
        near = int(distances.argmin())
        holds += [{arm: grasp} for arm in (near, 1 - near) if can_reach(grasp, seen.plane, goal, arm)]
    reason = plan.reason if holds or plan.reason else "out_of_reach: no arm reaches any of the grasps"
    return Choice(holds, reason)


METHODS: dict[str, Choose] = {"pair": pair, "single": single, "random": random_pair}


def _arms(seen: Seen, goal: np.ndarray) -> list[Arm]:
    return [Arm(T_WORLD_BASE[arm][:3, 3], partial(can_reach, plane=seen.plane, goal=goal, arm=arm)) for arm in (0, 1)]
