"""Planners' first grasps that were tried on the same scenes, set against each other."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from grasping import GraspPlanner
from grasping.pose.model_planner import told_class
from pec.grasps.labels import HELD, GraspLabels, GraspScene
from pec.metrics.proportions import mcnemar, wilson_interval
from pecgrasp_env.capture.grasps.antipodal import TABLE
from pecgrasp_env.robot.kinematics import UP

__all__ = ["NO_GRASP", "compare_planners", "plan_times_ms"]

NO_GRASP = "no grasp"
_DRAWS = 2000  # of the bootstrap over objects
_TIMED = 20  # clouds


def compare_planners(labels: GraspLabels, reference: str) -> dict[str, Any]:
    """planners, a row each: `held` of `scenes`, `share`, `interval` (Wilson, 95 %), `interval_over_objects` (95 %,
    bootstrap over instances), `outcomes` (counts; a scene without a grasp is one). comparisons of `reference` with each
    other one: `both`, `only_first`, `only_second`, `neither`, `p` (McNemar, exact).
    """
    scenes = list(labels.scenes())
    outcomes = np.array([_outcomes(scene, len(labels.samplers), len(labels.outcomes)) for scene in scenes])
    held, things = outcomes == HELD, np.array([scene.thing for scene in scenes])
    names = (*labels.outcomes, NO_GRASP)
    rows = {}
    for code, planner in enumerate(labels.samplers):
        wins = int(held[:, code].sum())
        rows[planner] = {
            "held": wins,
            "scenes": len(scenes),
            "share": wins / len(scenes),
            "interval": wilson_interval(wins, len(scenes)),
            "interval_over_objects": _over_objects(held[:, code], things),
            "outcomes": {name: int((outcomes[:, code] == k).sum()) for k, name in enumerate(names)},
        }
    first = held[:, labels.samplers.index(reference)]
    comparisons = []
    for code, planner in enumerate(labels.samplers):
        if planner != reference:
            second = held[:, code]
            counts = {
                "both": int((first & second).sum()),
                "only_first": int((first & ~second).sum()),
                "only_second": int((~first & second).sum()),
                "neither": int((~first & ~second).sum()),
            }
            p = mcnemar(counts["only_first"], counts["only_second"])
            comparisons.append({"first": reference, "second": planner, **counts, "p": p})
    return {"objects": len(set(things)), "planners": rows, "comparisons": comparisons}


def plan_times_ms(planners: Mapping[str, GraspPlanner], scenes: Sequence[GraspScene]) -> dict[str, float]:
    """The median time of a plan on this machine, ms, over the first 20 of the scenes, after one that does not count."""
    clouds = [(scene.class_name, scene.points.astype(float), scene.T_world_camera[:3, 3]) for scene in scenes[:_TIMED]]
    medians = {}
    for name, planner in planners.items():
        times = []
        for label, points, viewpoint in [clouds[0], *clouds]:
            told = told_class(planner, label)
            begin = time.perf_counter()
            told.plan(points, up=UP, table=TABLE, viewpoint=viewpoint)
            times.append(time.perf_counter() - begin)
        medians[name] = 1e3 * float(np.median(times[1:]))
    return medians


def _outcomes(scene: GraspScene, n_planners: int, none: int) -> np.ndarray:
    """(n_planners,) the outcome of each one's grasp, `none` where it had none."""
    found = np.full(n_planners, none)
    found[scene.sampler] = scene.outcome
    return found


def _over_objects(held: np.ndarray, things: np.ndarray) -> tuple[float, float]:
    """Of the share held (S,): objects are drawn with all their scenes."""
    _, place = np.unique(things, return_inverse=True)
    wins, counts = np.bincount(place, held), np.bincount(place)
    drawn = np.random.default_rng(0).integers(len(counts), size=(_DRAWS, len(counts)))
    shares = wins[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(shares, [0.025, 0.975])
    return float(low), float(high)
