"""Two regions of one object for two hands: their grasps balance its weight, fit the grippers, and keep the arms apart.

Two hands that lift straight up bear a weight without turning it where its centre is between them: on the line from one
to the other, seen from above, and not near either end of it. What is off that line, the pads must hold by not turning.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.curvature_planner.planner import CurvaturePlanner
from grasping.errors import ConfigError, require_between
from grasping.grasp import Grasp, GraspPlanner
from grasping.gripper import ROBOTIQ_2F_140
from grasping.pair_planner.centre_of_mass import Footprint, footprint
from grasping.pair_planner.regions import grasps_by_region
from grasping.validation import object_cloud, position, workspace

FloatArray = NDArray[np.float64]
Kind = Literal["no_grasp", "one_region", "out_of_reach", "too_near", "unbalanced"]

LEAST_DISTANCE = 0.20  # m between two hands: a palm is 80 mm wide, a camera beside it reaches 165 mm to one side
LEAST_SHARE = 0.2  # of the weight that either hand bears
MOST_OFF = 0.03  # m of the centre of mass from the line between the hands
WIDE = 0.40  # m between the hands, from which on they are no steadier for being farther apart
WEIGHTS = {"grasp": 0.35, "share": 0.30, "line": 0.25, "apart": 0.10}
CROSSED = 0.10  # of the score that it costs where each arm reaches past the other's grasp
PAIRS = 40  # that are returned


@dataclass(frozen=True)
class Arm:
    """One of the two arms: where its base stands, (3,) m in the cloud's frame, and which grasps it can carry out."""

    base: ArrayLike
    reaches: Callable[[Grasp], bool]


@dataclass(frozen=True)
class GraspPair:
    """One grasp for each arm, in the order of the arms; without arms in the order along the object.

    shares: of the weight that each bears, as the estimate has it. off: m of the centre of mass from the line between
    the hands. apart: m between them, both seen from above. score: higher is better, at most 1.
    """

    grasps: tuple[Grasp, Grasp]
    shares: tuple[float, float]
    off: float
    apart: float
    score: float


@dataclass(frozen=True)
class NoPair:
    """Why there is no pair: the first thing that left none. kind: for programs; text: for people, with numbers."""

    kind: Kind
    text: str


@dataclass(frozen=True)
class PairPlan:
    """best: `pairs[0]`, or None with the reason. grasps: all candidates of one hand. outline: the object over the table
    with its estimated centre of mass.
    """

    best: GraspPair | None
    pairs: list[GraspPair]
    grasps: list[Grasp]
    outline: Footprint
    reason: NoPair | None


def plan_pair(
    points: ArrayLike,
    *,
    table: ArrayLike,
    up: ArrayLike | None = None,
    obstacles: ArrayLike | None = None,
    viewpoint: ArrayLike | None = None,
    arms: Sequence[Arm] | None = None,
    planner: GraspPlanner | None = None,
    least_distance: float = LEAST_DISTANCE,
) -> PairPlan:
    """Plan on the cloud (N, 3) of one object, m, in any frame.

    Args:
        points: of the object, from one side or from all.
        table: plane (4,) on which it lies, n·p + d = 0. up: (3,) away from it; by itself the normal says so.
        obstacles: (K, 3) of other things.
        viewpoint: (3,) where the camera stood; None: nothing counts as hidden.
        arms: the two; None: everything is in reach.
        planner: of the grasps of one hand; the default is a `CurvaturePlanner` for the 2F-140 that comes straight down.
        least_distance: m between the hands.

    Raises CloudError for a cloud, ConfigError for a scene, a distance or a number of arms that is none.
    """
    grasps, reasons, outline = candidates(
        points, table=table, up=up, obstacles=obstacles, viewpoint=viewpoint, planner=planner
    )
    pairs, reason = couple(grasps, reasons, outline, arms, least_distance)
    if reason is None:
        balanced = [pair for pair in pairs if min(pair.shares) >= LEAST_SHARE and pair.off <= MOST_OFF]
        if not balanced:
            nearest = min(pairs, key=lambda pair: (max(0.0, LEAST_SHARE - min(pair.shares)), pair.off))
            reason = NoPair(
                "unbalanced",
                f"of {len(pairs)} pairs none has the centre of mass between its hands; in the nearest one hand bears "
                f"{min(nearest.shares):.0%}, and it is {1e3 * nearest.off:.0f} mm off the line between them",
            )
        pairs = balanced
    pairs = sorted(pairs, key=lambda pair: -pair.score)[:PAIRS]
    return PairPlan(pairs[0] if pairs else None, pairs, grasps, outline, reason)


def candidates(
    points: ArrayLike,
    *,
    table: ArrayLike,
    up: ArrayLike | None = None,
    obstacles: ArrayLike | None = None,
    viewpoint: ArrayLike | None = None,
    planner: GraspPlanner | None = None,
) -> tuple[list[Grasp], list[str], Footprint]:
    """The grasps of one hand all over the object, why regions have none, and its outline. Arguments as `plan_pair`."""
    cloud = object_cloud(points)
    _, plane, others = workspace(up, table, obstacles)
    assert plane is not None
    eye = None if viewpoint is None else position(viewpoint, name="viewpoint")
    outline = footprint(cloud, plane, eye)
    own = CurvaturePlanner(ROBOTIQ_2F_140, max_tilt=0.0) if planner is None else planner
    found, reasons = grasps_by_region(cloud, outline, own, table=plane, obstacles=others, viewpoint=eye)
    return found, reasons, outline


def couple(
    grasps: Sequence[Grasp],
    reasons: Sequence[str],
    outline: Footprint,
    arms: Sequence[Arm] | None,
    least_distance: float = LEAST_DISTANCE,
) -> tuple[list[GraspPair], NoPair | None]:
    """All pairs that two arms can take at once, whether they balance or not; or why there are none. grasps, reasons,
    outline: of `candidates`.

    Raises ConfigError for a distance below zero, or another number of arms than two.
    """
    require_between("least_distance", least_distance, 0.0, 2.0)
    if arms is not None and len(arms) != 2:
        raise ConfigError(f"arms: {len(arms)} of them; a pair is for two")
    if len(grasps) < 2:
        few: Kind = "one_region" if grasps else "no_grasp"
        text = "one hand alone finds a place" if grasps else "no hand finds a place"
        why = Counter(reasons).most_common(1)
        return [], NoPair(few, f"{text}: {why[0][0]}" if why else text)
    # Along the object, so that the order without arms means something.
    ordered = sorted(grasps, key=lambda grasp: float(grasp.pose[:3, 3] @ outline.axes[:, 0]))
    level = outline.axes[:, :2]
    at = np.array([grasp.pose[:3, 3] @ level for grasp in ordered])
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    if apart.max() < least_distance:
        farthest = f"{1e3 * apart.max():.0f} mm apart at most, two hands need {1e3 * least_distance:.0f} mm"
        return [], NoPair("too_near", f"the grasps are {farthest}")
    reached = np.ones((2, len(ordered)), bool)
    if arms is not None:
        reached = np.array([[arm.reaches(grasp) for grasp in ordered] for arm in arms])
        bases = np.array([position(arm.base, name="base") @ level for arm in arms])
        way = np.linalg.norm(at[None] - bases[:, None], axis=2)
    pairs = []
    for i, j in combinations(range(len(ordered)), 2):
        if apart[i, j] < least_distance:
            continue
        for first, second in ((i, j), (j, i)) if arms is not None else ((i, j),):
            if not (reached[0, first] and reached[1, second]):
                continue
            crossed = 0.0
            if arms is not None:
                crossed = max(0.0, float(way[0, first] + way[1, second] - way[0, second] - way[1, first]))
            pairs.append(_pair((ordered[first], ordered[second]), at[[first, second]], outline, crossed))
    if not pairs:
        each = ", ".join(str(int(row.sum())) for row in reached)
        return [], NoPair(
            "out_of_reach", f"of {len(ordered)} grasps the arms reach {each}, and no two far enough apart"
        )
    return pairs, None


def _pair(grasps: tuple[Grasp, Grasp], at: FloatArray, outline: Footprint, crossed: float) -> GraspPair:
    """at: (2, 2) m seen from above. crossed: m that the arms' ways are longer than the other way round."""
    line = at[1] - at[0]
    apart = float(np.linalg.norm(line))
    to_centre = outline.centre @ outline.axes[:, :2] - at[0]
    second = float(to_centre @ line) / apart**2
    off = abs(float(line[0] * to_centre[1] - line[1] * to_centre[0])) / apart
    terms = {
        "grasp": min(grasp.score for grasp in grasps),
        "share": max(0.0, 1.0 - abs(2.0 * second - 1.0)),
        "line": max(0.0, 1.0 - off / MOST_OFF),
        "apart": min(1.0, apart / WIDE),
    }
    score = sum(WEIGHTS[name] * value for name, value in terms.items()) - CROSSED * min(1.0, crossed / apart)
    return GraspPair(grasps, (1.0 - second, second), off, apart, score)
