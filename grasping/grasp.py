"""What every planner does and returns: a ranked list of grasps, a report on each region, and why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Primitive = Literal["sphere", "cylinder", "box"]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Grasp:
    """A grasp of a two-finger gripper, in the frame of the cloud that was planned on.

    pose: (4, 4) float64, maps the grasp frame into the cloud's frame. Origin midway between the pads at the pads'
        centre, +z the approach direction, +x the closing direction.
    width: opening between the pads at contact, m.
    score: higher is better; within [0, 1].
    kind: "primitive" where the whole object is one primitive and is held at its centre, else "region".
    region: index into `GraspPlan.regions`, or None.
    terms: the parts of the score, and measures that a policy may use (each planner documents its own).
    """

    pose: FloatArray
    width: float
    score: float
    kind: Literal["primitive", "region"]
    region: int | None = None
    terms: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RegionReport:
    """A slab of the object, or one cluster of a slab, and what became of it.

    points: (M, 3) float64 in the cloud's frame. primitive: the shape its share of flat neighbourhoods stands for.
    width: extent along the closing axis, m. curvature: sum of the two lateral curvatures, P.
    verdict: "candidate", or why it is none. slab: index of the slab. cluster: index in the slab; None for a whole slab.
    """

    points: FloatArray
    primitive: Primitive
    width: float
    curvature: float
    verdict: str
    slab: int
    cluster: int | None = None


@dataclass(frozen=True)
class GraspPlan:
    """The outcome of planning: `best` is `candidates[0]`, or None with a sentence in `reason`.

    source: what a planner with models planned on, and why; None: the cloud.
    """

    best: Grasp | None
    candidates: list[Grasp]
    regions: list[RegionReport]
    reason: str | None
    source: str | None = None


class GraspPlanner(Protocol):
    """What every planner of this package does, and yours where it is given to a policy, an evaluation or a page."""

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
        """Plan on the cloud (N, 3) of one object, m, in any frame.

        up: (3,) away from the table. table: plane (4,), n·p + d = 0. obstacles: (K, 3) points of other things.
        viewpoint: (3,) where the camera stood, or (V, 3) the cameras of a merged cloud; None: the cloud's origin, where
        that can be a camera's place. unseen: (U, 3) far ends of lines of sight from the viewpoint, of several the last,
        on which nothing was measured. All in the cloud's frame. A planner may ignore what it has no use for.
        """


def plan_from(candidates: list[Grasp], regions: list[RegionReport], reason: str) -> GraspPlan:
    """Rank the candidates (stable, best first); `reason` is kept only where there are none."""
    ranked = sorted(candidates, key=lambda grasp: -grasp.score)
    return GraspPlan(ranked[0] if ranked else None, ranked, regions, None if ranked else reason)
