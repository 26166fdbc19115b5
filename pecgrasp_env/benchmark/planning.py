"""How fast the planner is: beside a k-d tree of the cloud, its NumPy reference, its rivals and its limits."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from grasping import CurvaturePlanner, GraspPlanner, PublishedPlanner, baselines
from pecgrasp_env.benchmark.timing import Row, Timing, limited, rows_of, side_by_side
from pecgrasp_env.objects import make_object

_ON_TABLE = {"up": np.array([0.0, 0.0, 1.0]), "table": np.array([0.0, 0.0, 1.0, 0.0])}
_BEST = ("default", "default, table unknown")  # what must keep the limits

# Seconds on the clock and of the processor since the process began to import, then of two plans.
_FRESH = """
import json, time
spent = {}
def note(name, wall, cpu):
    spent[name] = (time.perf_counter() - wall, time.process_time() - cpu)
start = (time.perf_counter(), time.process_time())
import numpy as np
note("import numpy", *start)
from grasping import CurvaturePlanner
note("import grasping, with numpy", *start)
points = np.random.default_rng(0).uniform([-0.06, -0.02, 0.0], [0.06, 0.02, 0.05], (1000, 3))
planner = CurvaturePlanner()
for name in ("first plan", "second plan"):
    start = (time.perf_counter(), time.process_time())
    planner.plan(points, up=(0, 0, 1), table=(0, 0, 1, 0))
    note(name, *start)
print(json.dumps(spent))
"""


def planning(settings: Mapping[str, Any]) -> list[Row]:
    """One object on a table in clouds of several sizes; then how the times grow, and what a fresh process takes."""
    mesh = make_object("stapler", settings["seed"]).visual_mesh()
    limits = {int(n): most for n, most in settings.get("plan_at_most", {}).items()}
    rows: list[Row] = []
    for n in settings["cloud_sizes"]:
        points = np.asarray(mesh.sample(n, seed=settings["seed"]), float)
        points[:, 2] -= points[:, 2].min()
        routines: dict[str, Callable[[], Any]] = {"k-d tree": partial(cKDTree, points)}
        for name, planner in _planners().items():
            routines[name] = partial(planner.plan, points, **_ON_TABLE)
        routines[_BEST[1]] = partial(CurvaturePlanner().plan, points)
        of_size = rows_of(side_by_side(routines, settings["repeats"], warm=True), "k-d tree", f"{n:,} points")
        for row in of_size:
            rows.append(limited(row, limits.get(n) if row["name"] in _BEST else None) | {"points": n})
    growth = _growth(rows) if len(settings["cloud_sizes"]) > 1 else []
    return rows + growth + _start_up(settings.get("start_repeats", 1))


def _planners() -> dict[str, GraspPlanner]:
    """By the name that each goes by in the report, the default one first."""
    named: dict[str, GraspPlanner] = {
        _BEST[0]: CurvaturePlanner(),
        "published": PublishedPlanner(),
        "default in NumPy": CurvaturePlanner(compiled=False),
    }
    for name in (name for name in baselines.__all__ if name != "LearnedPlanner"):  # which needs a trained network
        named[name.removesuffix("Planner")] = getattr(baselines, name)()
    return named


def _growth(rows: list[Row]) -> list[Row]:
    """How each routine's processor time grows from the smallest cloud to the largest: 1 is linear."""
    grown = []
    for name in dict.fromkeys(row["name"] for row in rows):
        own = [row for row in rows if row["name"] == name]
        n, ms = np.array([(row["points"], row["cpu_ms"]) for row in own]).T
        exponent = float(np.polyfit(np.log(n), np.log(ms), 1)[0])
        what = f"growth, {own[0]['what'].removesuffix(' points')} to {own[-1]['what']}"
        grown.append({"what": what, "name": name, "exponent": exponent, "times_longer": ms[-1] / ms[0]})
    return grown


def _start_up(repeats: int) -> list[Row]:
    """Imports and the first plan in fresh processes, of which there is one more that does not count."""
    seconds: dict[str, list[list[float]]] = {}
    for repeat in range(repeats + 1):
        child = subprocess.run([sys.executable, "-c", _FRESH], capture_output=True, text=True, check=True, timeout=120)
        for name, spent in json.loads(child.stdout).items():
            if repeat:
                seconds.setdefault(name, []).append(spent)
    times = {name: Timing(*np.median(each, axis=0).tolist()) for name, each in seconds.items()}
    return rows_of(times, "import numpy", "a fresh process")
