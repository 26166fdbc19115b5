"""Golden items of `grasping`: plans, scenes, fused views, and what scripts/plan_grasp.py leaves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from golden_digest import Values
from golden_inputs import PlanCase, Solid, camera, frame, jolted, plan_cases, seen_of_solid, solids_on_table
from golden_tools import read_json, run_script, without_times

from grasping import (
    ROBOTIQ_2F_140,
    CentroidPlanner,
    CurvaturePlanner,
    GeoGraspPlanner,
    PublishedPlanner,
    Segmenter,
    SinglePrimitivePlanner,
    fuse,
)
from pecgrasp_env.objects import CLASSES, Catalogue


def cases(count: int) -> list[PlanCase]:
    return list(plan_cases(Catalogue(CLASSES, instances_per_class=4), count))


def plans(compiled: bool) -> Values:
    """Plans of the default planner, every seventh for a smaller gripper."""
    large = CurvaturePlanner(compiled=compiled)
    small = CurvaturePlanner(replace(ROBOTIQ_2F_140, stroke=0.085, finger_width=0.022), compiled=compiled)
    for number, case in enumerate(cases(200)):
        planner = small if number % 7 == 6 else large
        yield case.name, planner.plan(case.points, **case.surroundings)


def plans_of_others() -> Values:
    """The planners that the default one is measured against, which all get to know where up is."""
    planners = {
        "published": PublishedPlanner(),
        "released": PublishedPlanner.released(),
        "centroid": CentroidPlanner(),
        "geograsp": GeoGraspPlanner(),
        "single primitive": SinglePrimitivePlanner(),
    }
    known = [case for case in cases(40) if case.surroundings.keys() & {"up", "table"}][:20]
    for name, planner in planners.items():
        for case in known:
            yield f"{name} {case.name}", planner.plan(case.points, **case.surroundings)


def scenes() -> Values:
    """Frames, organised and loose, with and without a table; of a few, what the published segmenter makes of them."""
    ours, published = Segmenter(), Segmenter.published()
    for number in range(40):
        rng = np.random.default_rng([number, 2])
        T = camera(rng.uniform(0, 6), rng.uniform(0.7, 1.5), rng.uniform(0.45, 0.8))
        solids = solids_on_table(rng, int(rng.integers(1, 8)))
        if number % 6 == 2:  # too long for an object: an obstacle
            solids.append(Solid("box", np.array([0.0, 0.24, 0.03]), np.array([0.5, 0.04, 0.06])))
        cloud = frame(solids, T, rng, rng.choice([0.0, 0.001, 0.002]), table=number % 8 != 7)
        known: dict[str, np.ndarray] = {"up": T[2, :3]} if number % 2 else {}
        if number % 3 == 0:
            known["gripper"] = (solids[0].centre + rng.uniform(-0.03, 0.03, (200, 3)) - T[:3, 3]) @ T[:3, :3]
        if number % 5 == 4:
            cloud = cloud.reshape(-1, 3)[::2]
        yield f"{number:02d}", ours.segment(cloud, **known)
        if number % 10 == 1:
            yield f"{number:02d} published", published.segment(cloud.reshape(-1, 3)[::5], **known)


def fused() -> Values:
    """Sets of views: whole frames, objects with poses and without, a motion that stays open, one left out."""
    for name, kind, turns in (
        ("frames", "any", (0.3, 0.8, 1.4)),
        ("objects", "box", (0.3, 0.7, 1.1)),
        ("no poses", "box", (0.3, 0.6)),
        ("open motion", "can", (0.3, 0.9)),
        ("misfit", "ball", (0.3, 0.9, 3.4)),
    ):
        rng = np.random.default_rng([len(name), 3])
        solids = solids_on_table(rng, 6)
        chosen = solids if kind == "any" else [solid for solid in solids if solid.kind == kind]
        poses = [camera(turn, 0.9) for turn in turns]
        views = [frame(chosen, T, rng, 0.001, table=kind == "any") for T in poses]
        rough = [poses[0], *(jolted(T, rng) for T in poses[1:])]
        if name == "misfit":
            rough[-1][:3, 3] += 0.2
        if name == "no poses":
            yield name, fuse([view @ T[:3, :3].T + T[:3, 3] for view, T in zip(views, rough, strict=True)])
        else:
            yield name, fuse(views, poses=rough, table="find" if kind == "any" else None)


def planned_files(work: Path) -> Values:
    """results.json of scripts/plan_grasp.py on an object and on a scene."""
    rng = np.random.default_rng(4)
    (work / "clouds").mkdir(exist_ok=True)
    solids = solids_on_table(rng, 4)
    np.save(work / "clouds" / "object.npy", seen_of_solid(solids[0], rng).astype(np.float32))
    np.save(work / "clouds" / "scene.npy", frame(solids, camera(0.5), rng, 0.001, table=True))
    for name, choices in (("object", ["frame=world"]), ("scene", ["scene=true", "planner=published"])):
        run_script(work, "plan_grasp.py", f"cloud=clouds/{name}.npy", f"output=plans/{name}", *choices)
        yield name, without_times(read_json(work / "plans" / name / "results.json"))
