"""From single grasp candidates to clusters: the middle of all that are as good as the best around it.

Where an object can be held alike over some length, a millimetre of noise decides which candidate there scores best.
Their mean, each weighted by how near its score comes to the best one's, hardly moves; and a grasp in the middle of a
cluster is the one that forgives an arm most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.contact_refinement import Contacts
from grasping.curvature_planner.finger_scan import Candidates
from grasping.geometry import exact_math

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PLACE, HEADING, WIDTH = 0.016, math.radians(20), 0.015  # candidates nearer than this to the best one are of its cluster
SAME_PLACE, SAME_HEADING = 0.010, math.radians(12)  # middles nearer than this are one
SAG = 0.007  # of the score: a candidate that is worse by this counts e times less
SLIDE = 0.008  # m


@dataclass(frozen=True)
class RefinedCandidates:
    """Candidates looked at closely: contacts (M,), share of the slab between the pads, −inf or their score."""

    contacts: Contacts
    whole: FloatArray
    score: FloatArray

    def take(self, index: IntArray) -> RefinedCandidates:
        contacts = Contacts(**{name: getattr(self.contacts, name)[index] for name in Contacts.__dataclass_fields__})
        return RefinedCandidates(contacts, self.whole[index], self.score[index])

    def and_also(self, other: RefinedCandidates) -> RefinedCandidates:
        contacts = {
            name: np.concatenate([getattr(self.contacts, name), getattr(other.contacts, name)])
            for name in Contacts.__dataclass_fields__
        }
        whole, score = np.concatenate([self.whole, other.whole]), np.concatenate([self.score, other.score])
        return RefinedCandidates(Contacts(**contacts), whole, score)


@dataclass(frozen=True)
class Clusters:
    """Middles of clusters as candidates, best first; index of each one's best member; share of the slab."""

    candidates: Candidates
    best: IntArray
    whole: FloatArray


def cluster(refined: RefinedCandidates, most: int) -> Clusters:
    """The best clusters, at most so many: around the best candidate left, until none is left."""
    found = refined.contacts
    valid = np.isfinite(refined.score)
    left = valid.copy()
    middles: list[tuple[float, float, float, float, float, float]] = []
    best: list[int] = []
    while left.any() and len(middles) < most:
        top = int(np.where(left, refined.score, -np.inf).argmax())
        heading, x, y, tip = (float(values[top]) for values in (found.heading, found.x, found.y, found.tip))
        alike = valid & (found.tip == tip) & (np.abs(found.width - found.width[top]) < WIDTH)
        turn = _half_turn(found.heading - heading)
        near = alike & (np.abs(turn) < HEADING) & (_distance(found.x - x, found.y - y) < PLACE)
        left &= ~near
        weight = np.where(near, exact_math.exp(np.where(near, refined.score - refined.score[top], 0.0) / SAG), 0.0)
        weight /= exact_math.total(weight)
        heading += exact_math.total(weight * turn)
        x, y = exact_math.total(weight * found.x), exact_math.total(weight * found.y)
        if any(
            there[3] == tip
            and _distance(np.float64(there[1] - x), np.float64(there[2] - y)) < SAME_PLACE
            and abs(float(_half_turn(np.float64(there[0] - heading)))) < SAME_HEADING
            for there in middles
        ):
            continue
        whole = min(exact_math.total(weight * refined.whole), 1.0)
        middles.append((heading, x, y, tip, exact_math.total(weight * found.width), whole))
        best.append(top)
    columns = np.array(middles).reshape(-1, 6).T
    return Clusters(_candidates(*columns), np.array(best, dtype=np.int64), columns[5])


def to_either_side(there: Clusters) -> Clusters:
    """Candidates beside the middles, as far as a scan may have left out: along the pads, not along the closing axis."""
    middle = there.candidates
    offset = np.repeat([-SLIDE, SLIDE], len(middle))
    heading, x, y, tip, width, whole = (
        np.tile(values, 2) for values in (middle.heading, middle.x, middle.y, middle.tip, middle.width, there.whole)
    )
    x, y = x - offset * exact_math.sin(heading), y + offset * exact_math.cos(heading)
    return Clusters(_candidates(heading, x, y, tip, width, whole), np.tile(there.best, 2), whole)


def _candidates(
    heading: FloatArray, x: FloatArray, y: FloatArray, tip: FloatArray, width: FloatArray, whole: FloatArray
) -> Candidates:
    """Candidates to be looked at: what only the scan measures is not known of them."""
    unknown = np.full(len(x), np.nan)
    return Candidates(heading, x, y, tip, width, unknown, unknown, unknown, whole > 0.5)


def _distance(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.sqrt(x * x + y * y)


def _half_turn(angle: FloatArray) -> FloatArray:
    """Angles between axes without a sign, in [−π/2, π/2)."""
    return (angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
