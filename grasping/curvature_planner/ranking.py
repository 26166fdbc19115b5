"""From the candidates of the coarse scan to a ranked few: refined, judged, moved to the middle of a cluster."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.approach_view import ApproachView
from grasping.curvature_planner.contact_refinement import Contacts, refine
from grasping.curvature_planner.finger_scan import Candidates
from grasping.curvature_planner.grasp_clusters import SAG, RefinedCandidates, cluster, to_either_side
from grasping.curvature_planner.scoring import (
    FAR_FROM_CENTRE,
    WEIGHTS,
    best_unlike,
    centre_term,
    clip,
    overlap_term,
    weigh,
)

FloatArray = NDArray[np.float64]
Terms = dict[str, FloatArray]

LEAST_OVERLAP = 0.004  # m
PARALLEL = math.radians(5)  # a contact turned by less than this against the pad is as good as parallel
BLUR = 0.15  # rad, by which the scan's resolution blurs angles
LEAST_CONTACT = 0.3  # share of a pad's width
MOST_CLEARANCE = 0.015  # m beside each pad on the way in, where there is room
SLID, CENTRED, CANDIDATES = 3, 4, 8  # best places that are looked at on either side, in the middle, at all

PROBLEMS = (
    "too few points between the pads",
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
    far_from_centre: float = FAR_FROM_CENTRE  # at which the term "centre" is 0
    weight_of_centre: float = WEIGHTS["centre"]

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

    terms: (M,) each; those of the score, and `opening`: to come in with, m. score: (M,), not in its order.
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
    return Ranked(kept.contacts, _terms(view, kept.contacts, kept.whole, rules), kept.score, [])


def _try(view: ApproachView, candidates: Candidates, whole: FloatArray, rules: Rules) -> RefinedCandidates:
    """Look closely at candidates, of which `whole` (M,) is the share of their slabs that is between the pads."""
    contacts = refine(
        view.points,
        view.obstacles,
        candidates,
        pad_width=rules.pad_width,
        wished_room=rules.wished_room,
        reach=rules.reach,
    )
    refused = np.any(_against(contacts, rules), axis=0)
    score = weigh(_terms(view, contacts, whole, rules), rules.weight_of_centre)
    return RefinedCandidates(contacts, whole, np.where(refused, -np.inf, score))


def _against(contacts: Contacts, rules: Rules) -> list[NDArray[np.bool_]]:
    """Of which of the candidates each of the PROBLEMS is true."""
    return [
        contacts.empty,
        contacts.width > rules.greatest_width,
        contacts.gap < rules.finger_room,
        contacts.overlap < rules.least_overlap,
        contacts.angle > rules.steepest,
        contacts.contact < LEAST_CONTACT,
    ]


def _coarse_score(view: ApproachView, candidates: Candidates, rules: Rules) -> FloatArray:
    # A slope only costs here and does not exclude.
    score = weigh(
        {
            "angle": clip(1.0 - candidates.angle / (rules.steepest + BLUR)),
            "overlap": overlap_term(candidates.overlap),
            "centre": centre_term(candidates.x, candidates.y, view.centre, rules.far_from_centre),
            "room": candidates.room,
            "narrow": 1.0 - candidates.width / rules.stroke,
            "whole": candidates.whole.astype(np.float64),
        },
        rules.weight_of_centre,
    )
    return np.where(candidates.overlap >= rules.least_overlap, score, score - 1.0)


def _terms(view: ApproachView, contacts: Contacts, whole: FloatArray, rules: Rules) -> Terms:
    spare = (contacts.gap - rules.finger_room) / (rules.wished_room - rules.finger_room)
    clear = np.minimum(np.maximum(contacts.gap - rules.finger_thickness, 0.0), MOST_CLEARANCE)
    return {
        "contact": contacts.contact,
        "angle": clip((rules.steepest - contacts.angle) / (rules.steepest - rules.parallel)),
        "overlap": overlap_term(contacts.overlap),
        "centre": centre_term(contacts.x, contacts.y, view.centre, rules.far_from_centre),
        "room": clip(spare),
        "narrow": clip(1.0 - contacts.width / rules.stroke),
        "whole": whole,
        "opening": np.minimum(rules.stroke, contacts.width + 2.0 * clear),
    }
