"""What the dissertation's figures show, asked of the published planner on the catalogue, whole and from one side.

Not all of it comes true on our objects. What is tested is the share of instances for which a claim holds, far enough
below the share of 50 instances (docs/published_figures.md) to survive another draw, and why the others fail.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from grasping import CentroidPlanner, PublishedPlanner
from pecgrasp_env.experiments.published_figures import (
    CLAIMS,
    SIDES,
    Side,
    centre_of,
    handles_held,
    measure_figures,
    outcomes,
    parts_of_pliers,
    plans,
    table_of,
    views_of,
)

CLAIM = {claim.name: claim for claim in CLAIMS}
QUICK_TO_MAKE, INSTANCES = 5, 3
SLOW_TO_MAKE = {"clamp": 2, "joypad": 4}
# Of 50 instances, seeds 0 to 49: whole, from one side; None where the claim mostly fails.
MEASURED: dict[str, tuple[float | None, float | None]] = {
    "drill": (0.54, 0.56),
    "bottle": (None, 0.52),
    "clamp": (0.74, 0.88),
    "can": (0.98, None),
    "cylinder": (0.92, 0.42),
    "plug_adapter": (0.88, None),
    "joypad": (0.88, 0.80),
}
PRIMITIVES = "can", "cylinder", "plug_adapter"
KEPT = [(name, side, share) for name, shares in MEASURED.items() for side, share in zip(SIDES, shares, strict=True)]
KEPT = [(name, side, share) for name, side, share in KEPT if share is not None]


def seeds(name: str) -> range:
    return range(QUICK_TO_MAKE if name in PRIMITIVES else SLOW_TO_MAKE.get(name, INSTANCES))


def share(holds: list[bool]) -> float:
    return sum(holds) / len(holds)


@pytest.mark.parametrize(("name", "side", "measured"), KEPT)
def test_what_a_figure_shows_holds_for_about_as_many_instances_as_measured(
    name: str, side: Side, measured: float
) -> None:
    assert share(outcomes(CLAIM[name], PublishedPlanner(), seeds(name), side)) >= measured - 0.4


@pytest.mark.slow
@pytest.mark.parametrize(("name", "side", "measured"), KEPT)
def test_what_a_figure_shows_holds_for_other_instances_too(name: str, side: Side, measured: float) -> None:
    assert share(outcomes(CLAIM[name], PublishedPlanner(), range(100, 125), side)) >= measured - 0.25


@pytest.mark.parametrize("name", PRIMITIVES)
def test_a_simple_shape_is_one_primitive_more_often_than_with_the_values_of_the_release(name: str) -> None:
    """Its last slab is the flat end and less high, and every k-th point scatters Δ and the lengths."""
    ours, release = (
        share(outcomes(CLAIM[name], planner, seeds(name), "whole"))
        for planner in (PublishedPlanner(), PublishedPlanner.released())
    )
    assert release < ours


def test_the_centre_of_what_is_seen_is_not_the_centre_of_the_object() -> None:
    """A can that is one primitive is held at the centroid of its seen half."""
    for seed in seeds("can"):
        view = views_of("can", seed)["one side"]
        best = CentroidPlanner().plan(view.points, up=(0, 0, 1)).best
        assert best is not None
        assert np.linalg.norm(best.pose[:3, 3] - centre_of(view.surface)) > 0.005


def test_both_handles_of_pliers_and_each_alone_are_candidates() -> None:
    found = 0
    for view, plan in plans("pliers", PublishedPlanner(), seeds("pliers"), "whole"):
        part, tree = parts_of_pliers(view.surface), cKDTree(view.surface)
        for slab in {region.slab for region in plan.regions}:
            regions = [region for region in plan.regions if region.slab == slab and region.verdict == "candidate"]
            names = [set(part[tree.query(region.points)[1]].tolist()) - {0} for region in regions]
            found += all(wanted in names for wanted in ({1, 2}, {1}, {2}))
    assert found >= INSTANCES


def test_where_a_slab_falls_apart_its_parts_look_flatter_than_the_whole() -> None:
    """Why pliers are held by one handle: the whole slab has twice its points, and N / n of them reach round it."""
    flatter = []
    for _, plan in plans("pliers", PublishedPlanner(), seeds("pliers"), "whole"):
        for whole in (region for region in plan.regions if region.cluster is None):
            parts = [region for region in plan.regions if region.slab == whole.slab and region.cluster is not None]
            if len(parts) == 2:
                flatter.append(min(part.curvature for part in parts) < whole.curvature)
    assert len(flatter) >= INSTANCES
    assert share(flatter) >= 0.8


def test_pliers_are_held_by_both_handles_only_with_neighbourhoods_too_large_for_a_clamp_and_a_joypad() -> None:
    """[0.52 whole with half of a region as neighbourhood, 0.00 with a quarter; the clamp by one handle: 0.02, 0.74]

    A quarter reaches round a handle from one side of the whole slab, half does from a side of one handle too.
    """
    quarter, half = PublishedPlanner(), PublishedPlanner(neighbour_divisors=(4, 2))
    both, one, near = (
        [share(outcomes(CLAIM[name], planner, seeds(name), "whole")) for planner in (quarter, half)]
        for name in ("pliers", "clamp", "joypad")
    )
    assert both[0] < both[1]
    assert one[0] > one[1]
    assert near[0] > near[1]


def test_a_bottle_seen_from_one_side_is_held_on_its_body() -> None:
    """[0.96, half of them in the lower third; a whole one 0.28, most at the shoulder]"""
    for view, plan in plans("bottle", PublishedPlanner(), seeds("bottle"), "one side"):
        assert plan.best is not None
        assert plan.best.kind == "region"
        z = view.surface[:, 2]
        assert plan.best.pose[2, 3] - z.min() < 0.65 * np.ptp(z)


@pytest.mark.parametrize("side", SIDES)
def test_pliers_are_held_by_their_handles(side: Side) -> None:
    """By one or by both."""
    by_handles = []
    for view, plan in plans("pliers", PublishedPlanner(), seeds("pliers"), side):
        assert plan.best is not None
        by_handles.append(sum(handles_held(plan.best, view.surface)) >= 0.5)
    assert share(by_handles) >= 0.6


def test_the_figures_are_counted_and_resumed(tmp_path: Path) -> None:
    said: list[str] = []
    planners = {"ours": PublishedPlanner(), "release": PublishedPlanner.released()}
    results = measure_figures(planners, first_seed=0, instances=1, output=tmp_path, say=said.append)
    assert [(row["object"], row["side"]) for row in results["rows"]] == [(c.name, s) for c in CLAIMS for s in SIDES]
    for row in results["rows"]:
        assert row["ours"]["count"] in (0, 1)
        low, high = row["ours"]["interval"]
        assert low <= row["ours"]["share"] <= high
    assert json.loads((tmp_path / "results.json").read_text())["rows"] == json.loads(json.dumps(results["rows"]))
    assert table_of(results).count("\n") == 1 + len(results["rows"])
    assert sum("done" in line for line in said) == len(CLAIMS)
    measure_figures(planners, first_seed=0, instances=1, output=tmp_path, say=said.append)
    assert sum("done" in line for line in said) == len(CLAIMS)
