"""From the candidates of the coarse scan to a ranked few: refined, judged, moved to the middle of a cluster."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.approach_view import ApproachView
from grasping.curvature_planner.contact_refinement import FEWEST, Contacts, measured, refine
from grasping.curvature_planner.finger_scan import Candidates
from grasping.curvature_planner.grasp_clusters import SAG, RefinedCandidates, cluster, to_either_side
from grasping.curvature_planner.line_of_sight import doubt
from grasping.curvature_planner.scoring import (
    ASSUMED,
    FAR_FROM_CENTRE,
    WEIGHTS,
    best_unlike,
    bite_term,
    centre_term,
    clip,
    narrow_term,
    overlap_term,
    weigh,
)
from grasping.geometry import exact_math

FloatArray = NDArray[np.float64]
Terms = dict[str, FloatArray]

LEAST_OVERLAP = 0.004  # m
PARALLEL = math.radians(5)  # a contact turned by less than this against the pad is as good as parallel
BLUR = 0.15  # rad, by which the scan's resolution blurs angles
LEAST_CONTACT = 0.3  # share of a pad's width
LEAST_AREA = 30e-6  # m² of either pad
LEAST_MEASURED, LEAST_BREADTH = 8, 0.004  # points between the pads, and m across them, where others are only assumed
BLIND = 0.1  # of a finger's way was seen: with less it goes in blind, which is done only where nothing else holds
WAY_ACROSS = (-0.4, 0.0, 0.4)  # of a pad's width, where the way of a finger is looked at
WAY_OUTWARD = (0.25, 0.75)  # likewise, of the room that it needs
WAY_LEVELS, COARSE_LEVELS = 4, 2  # from the tips up, evenly below the object's top
MOST_CLEARANCE = 0.015  # m beside each pad on the way in, where there is room
SLID, CENTRED, CANDIDATES = 3, 4, 8  # best places that are looked at on either side, in the middle, at all

TOUCHES_NOTHING = "the pads would touch almost nothing"
PROBLEMS = (
    "too few points between the pads",
    TOUCHES_NOTHING,
    "too wide",
    "no room for the fingers",
    "the pads would touch a slope",
    "the contacts slip",
    "the pads would touch a corner",
)


@dataclass(frozen=True)
class Rules:
    """What a gripper and its user ask of a grasp. Lengths in m; friction: coefficient between pad and object."""

    pad_width: float
    stroke: float
    finger_thickness: float
    finger_room: float
    wished_room: float
    greatest_width: float
    reach: float  # from the tips to the palm
    friction: float
    least_overlap: float = LEAST_OVERLAP
    least_points: int = FEWEST  # near a pad
    least_reach: float = 0.0  # of what was measured between the pads, where others are only assumed
    far_from_centre: float = FAR_FROM_CENTRE  # at which the term "centre" is 0
    weight_of_centre: float = WEIGHTS["centre"]

    @property
    def coarse_weight_of_centre(self) -> float:
        """As for what is light, so that not all of the places that are looked at closely are nearest to the centre."""
        return WEIGHTS["centre"] * (self.far_from_centre / FAR_FROM_CENTRE)

    @property
    def steepest(self) -> float:
        """Greatest angle (rad) of a contact against its pad that friction holds."""
        return math.atan(self.friction)

    @property
    def parallel(self) -> float:
        """Angle (rad) up to which a contact is as good as parallel."""
        return min(PARALLEL, 0.5 * self.steepest)


@dataclass(frozen=True)
class Ranked:
    """M candidates, or of each that was looked at the first thing that speaks against it.

    terms: (M,) each; those of the score; `opening`: to come in with, m; `assumed`: of the width what no measured point
    stands for, m. score: (M,), not in its order.
    """

    contacts: Contacts
    terms: Terms
    score: FloatArray
    problems: list[str]


def rank(view: ApproachView, candidates: Candidates, rules: Rules) -> Ranked:
    """The middle of each of the best clusters, or its best member if that is better; of the others the best member.

    This is the reference of `compiled_backend.rank`, which repeats its arithmetic.
    """
    chosen = candidates.take(best_unlike(candidates, _coarse_score(view, candidates, rules)))
    refined = _try(view, chosen, chosen.whole.astype(np.float64), rules)
    if not np.isfinite(refined.score).any():
        first = np.array(_against(refined.contacts, rules)).argmax(axis=0).tolist()
        nothing = refined.take(np.empty(0, dtype=np.int64))
        return Ranked(nothing.contacts, {}, nothing.score, [PROBLEMS[index] for index in first])
    beside = to_either_side(cluster(refined, SLID))
    refined = refined.and_also(_try(view, beside.candidates, beside.whole, rules))
    clusters = cluster(refined, CANDIDATES)
    best = refined.take(clusters.best)
    leading = np.arange(min(CENTRED, len(clusters.best)))
    middles = _try(view, clusters.candidates.take(leading), clusters.whole[leading], rules)
    centred = np.flatnonzero(middles.score >= best.score[leading] - SAG)
    kept = middles.take(centred).and_also(best.take(np.setdiff1d(np.arange(len(clusters.best)), centred)))
    return _held_by_what_was_seen(view, kept, rules)


def _held_by_what_was_seen(view: ApproachView, found: RefinedCandidates, rules: Rules) -> Ranked:
    """Those between whose pads enough was measured, and none with a blind finger where there are others.

    What is only assumed costs.
    """
    contacts, score = found.contacts, found.score
    terms = {**_terms(view, contacts, found.whole, rules), "assumed": np.zeros(len(score))}
    kept = terms["seen"] >= BLIND
    if not kept.any():
        kept[:] = True
    looked_at = int(np.count_nonzero(kept))
    if view.measured is not None:
        number, reach, breadth = measured(view.measured, view.axes, view.origin, contacts, rules.pad_width)
        terms["assumed"] = np.maximum(contacts.width - reach, 0.0)
        score = score * (1.0 - ASSUMED * (terms["assumed"] / contacts.width))
        kept &= (number >= LEAST_MEASURED) & (breadth >= LEAST_BREADTH) & (reach >= rules.least_reach)
    index = np.flatnonzero(kept)
    problems = [] if len(index) else [TOUCHES_NOTHING] * looked_at
    terms = {name: values[index] for name, values in terms.items()} if len(index) else {}
    return Ranked(found.take(index).contacts, terms, score[index], problems)


def _try(view: ApproachView, candidates: Candidates, whole: FloatArray, rules: Rules) -> RefinedCandidates:
    """Look closely at candidates, of which `whole` (M,) is the share of their slabs that is between the pads."""
    contacts = refine(
        view.points,
        view.obstacles,
        candidates,
        pad_width=rules.pad_width,
        wished_room=rules.wished_room,
        reach=rules.reach,
        fewest=rules.least_points,
    )
    refused = np.any(_against(contacts, rules), axis=0)
    score = weigh(_terms(view, contacts, whole, rules), rules.weight_of_centre)
    return RefinedCandidates(contacts, whole, np.where(refused, -np.inf, score))


def _against(contacts: Contacts, rules: Rules) -> list[NDArray[np.bool_]]:
    """Of which of the candidates each of the PROBLEMS is true."""
    return [
        contacts.empty,
        contacts.area < LEAST_AREA,
        contacts.width > rules.greatest_width,
        contacts.gap < rules.finger_room,
        contacts.overlap < rules.least_overlap,
        contacts.angle > rules.steepest,
        contacts.contact < LEAST_CONTACT,
    ]


def _coarse_score(view: ApproachView, candidates: Candidates, rules: Rules) -> FloatArray:
    # A slope only costs here and does not exclude, and of what is deep enough not all may hold when looked at closely.
    score = weigh(
        {
            "angle": clip(1.0 - candidates.angle / (rules.steepest + BLUR)),
            "overlap": overlap_term(candidates.overlap),
            "centre": centre_term(candidates.x, candidates.y, view.centre, rules.far_from_centre),
            "room": candidates.room,
            "narrow": narrow_term(candidates.width, rules.stroke),
            "whole": candidates.whole.astype(np.float64),
            "seen": _seen_share(view, candidates, candidates.width, rules, WAY_ACROSS[1:2], COARSE_LEVELS),
        },
        rules.coarse_weight_of_centre,
    )
    return np.where(candidates.overlap >= rules.least_overlap, score, score - 1.0)


def _terms(view: ApproachView, contacts: Contacts, whole: FloatArray, rules: Rules) -> Terms:
    spare = (contacts.gap - rules.finger_room) / (rules.wished_room - rules.finger_room)
    clear = np.minimum(np.maximum(contacts.gap - rules.finger_thickness, 0.0), MOST_CLEARANCE)
    return {
        "contact": contacts.contact,
        "bite": bite_term(contacts.overlap),
        "angle": clip((rules.steepest - contacts.angle) / (rules.steepest - rules.parallel)),
        "overlap": overlap_term(contacts.overlap),
        "centre": centre_term(contacts.x, contacts.y, view.centre, rules.far_from_centre),
        "room": clip(spare),
        "narrow": narrow_term(contacts.width, rules.stroke),
        "whole": whole,
        "seen": _seen_share(view, contacts, contacts.width, rules, WAY_ACROSS, WAY_LEVELS),
        "opening": np.minimum(rules.stroke, contacts.width + 2.0 * clear),
    }


def _seen_share(
    view: ApproachView,
    held: Candidates | Contacts,
    width: FloatArray,
    rules: Rules,
    across: tuple[float, ...],
    levels: int,
) -> FloatArray:
    """(M,) share of the fingers' way down beside the object that was seen, the worse side; 1 where nothing is known.

    What lies behind a surface was not seen; where nothing was measured, half of it counts as seen: as a rule that is a
    shadow of the sensor's own beside the object.
    """
    if not len(view.sight.lenses):
        return np.ones(len(width))
    cos, sin = exact_math.cos(held.heading), exact_math.sin(held.heading)
    above = view.points[2, -1] - held.tip
    shares, sight = [], view.sight.within(view.axes, view.origin)
    for side in (1.0, -1.0):
        seen = np.zeros(len(width), dtype=np.int64)
        for outward in WAY_OUTWARD:
            u = side * (0.5 * width + outward * rules.finger_room)
            for line in across:
                v = line * rules.pad_width
                x, y = (held.x + cos * u) - sin * v, (held.y + sin * u) + cos * v
                for level in range(levels):
                    seen += 2 - doubt(sight, x, y, held.tip + above * (level / levels))
        shares.append(seen / (2 * len(WAY_OUTWARD) * levels * len(across)))
    return np.minimum(*shares)
