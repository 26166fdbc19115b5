"""How good a grasp candidate is, as one number, and which candidates of the coarse scan are worth a closer look."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.finger_scan import Candidates

FloatArray = NDArray[np.float64]

# Weights of the terms, each in [0, 1]; a score is their weighted mean.
WEIGHTS = {
    "contact": 0.18,  # share of the pads' width that touches: one minus the contour's lateral curvature
    "bite": 0.08,  # whether the pads reach deep enough to hold
    "angle": 0.17,  # how far within the friction cone the contacts are
    "overlap": 0.25,  # how deep the pads reach beside the surface that they touch
    "centre": 0.20,  # nearness to the centre of mass
    "room": 0.10,  # free space for the fingers beyond what they need
    "narrow": 0.05,  # across the narrow side, though not across almost nothing
    "whole": 0.02,  # around all of the slab and not around a part of it
    "seen": 0.40,  # share of the fingers' way that the camera looked through
}
ASSUMED = 0.15  # share of the score that it costs when all of the width is only assumed
OVERLAP = ((0.5, 0.015), (0.1, 0.045), (0.4, 0.130))  # shares of the term, earned up to these depths, m
# m at which the term "bite" begins and is whole. Of 1,981 candidates on wide instances of the catalogue that a hand
# alone tried, 48 % held with an overlap of 4 to 6 mm, 75 with 6 to 8, 86 with 8 to 10, 95 with 10 to 15, no more with
# more. With 0.12 for a weight fingers begin to go into what was not seen of real things, for the deeper grasp.
SHALLOW, DEEP_ENOUGH = 0.008, 0.012
REFINED = 16  # candidates of the coarse scan that are looked at closely
ALIKE_PLACE, ALIKE_HEADING = 0.008, math.radians(20)  # candidates nearer than this are one
ALIKE_TIP = 0.0225  # m
NARROWEST = 0.010  # m: what is narrower is no better for it
FAR_FROM_CENTRE = 0.10  # m at which the term "centre" is 0
DENSITY, GRAVITY = 500.0, 9.81  # kg/m³, of a household thing, part plastic, part air
HELD_TORQUE, MOST_TORQUE = 0.2, 3.0  # N·m that pads hold against turning about them at 20 N; times that


def weights_of(weight_of_centre: float) -> dict[str, float]:
    """WEIGHTS, but for that of the term "centre"."""
    return {**WEIGHTS, "centre": weight_of_centre}


def leverage(farthest: float, volume: float) -> tuple[float, float]:
    """How far from the centre of mass the term "centre" is 0, m, and its weight, for an object that reaches so far (m).

    The term falls by as much a metre on a long object as on a short one, to its far end. Where the weight of what is
    filled down to the table (volume, m³), held there, would turn the object between the pads, it counts more by how
    many times it would.
    """
    far = max(FAR_FROM_CENTRE, farthest)
    turning = DENSITY * volume * GRAVITY * farthest / HELD_TORQUE
    return far, WEIGHTS["centre"] * (far / FAR_FROM_CENTRE) * min(max(turning, 1.0), MOST_TORQUE)


def weigh(terms: dict[str, FloatArray], weight_of_centre: float) -> FloatArray:
    """Weighted mean of those terms that have a weight."""
    known = weights_of(weight_of_centre)
    weights = {name: known[name] for name in terms if name in known}
    return sum((weight * terms[name] for name, weight in weights.items()), np.zeros(())) / sum(weights.values())


def overlap_term(overlap: FloatArray) -> FloatArray:
    """1 from 130 mm beside the surface; half of it is earned with the first 15 mm, most of the rest goes to depth."""
    (first, shallow), (second, deep), (third, deepest) = OVERLAP
    return first * clip(overlap / shallow) + second * clip(overlap / deep) + third * clip(overlap / deepest)


def bite_term(overlap: FloatArray) -> FloatArray:
    """0 for pads that reach so little beside the surface that what they hold may slip out, 1 for those that hold it."""
    return clip((overlap - SHALLOW) / (DEEP_ENOUGH - SHALLOW))


def centre_term(x: FloatArray, y: FloatArray, centre: FloatArray, far: float) -> FloatArray:
    """1 at the centre of mass, 0 as far (m) from it."""
    x, y = x - centre[0], y - centre[1]
    return clip(1.0 - np.sqrt(x * x + y * y) / far)


def narrow_term(width: FloatArray, stroke: float) -> FloatArray:
    """1 for what is narrow beside the stroke, and less again towards nothing at all."""
    return np.minimum(clip(1.0 - width / stroke), clip(width / NARROWEST))


def clip(share: FloatArray) -> FloatArray:
    """Cut to [0, 1]."""
    return np.minimum(np.maximum(share, 0.0), 1.0)


def best_unlike(candidates: Candidates, score: FloatArray) -> NDArray[np.int64]:
    """The best candidates, each unlike those before it in place, heading or depth."""
    chosen: list[int] = []
    score = score.copy()
    for _ in range(REFINED):
        best = int(score.argmax())
        if score[best] == -np.inf:
            break
        chosen.append(best)
        turn = np.abs(candidates.heading - candidates.heading[best])
        turn = np.minimum(turn, np.pi - turn)
        place = np.square(candidates.x - candidates.x[best]) + np.square(candidates.y - candidates.y[best])
        alike = (place < ALIKE_PLACE**2) & (turn < ALIKE_HEADING)
        score[alike & (np.abs(candidates.tip - candidates.tip[best]) < ALIKE_TIP)] = -np.inf
    return np.array(chosen)
