"""What the figures of the dissertation's chapter 5 show, asked of planners on the catalogue, whole and from one side.

Each claim is geometry in the object's frame. A planner gets the points alone, without table or up, as in the figures.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import NDArray

from grasping import ROBOTIQ_2F_140, Grasp, GraspPlan, GraspPlanner
from pec.common.atomic_files import write_json
from pec.metrics.proportions import wilson_interval
from pecgrasp_env.objects import make_object

FloatArray = NDArray[np.float64]
Side = Literal["whole", "one side"]
SIDES: tuple[Side, ...] = ("whole", "one side")

SAMPLES = 20_000  # on the surface of a mesh
PIXEL = 0.002  # m
CAMERA_ELEVATION = np.radians(50)
NEAR = 0.020  # m from the centre
MOSTLY = 0.5  # of what is between the pads


@dataclass(frozen=True)
class View:
    """What a planner sees of an instance, (M, 3), beside its whole outer surface (N, 3), m, in the object's frame."""

    side: Side
    points: FloatArray
    surface: FloatArray


# -------------------------------------------------------------------------------------------------------------- clouds


@lru_cache(maxsize=256)
def views_of(name: str, seed: int) -> dict[Side, View]:
    """An instance of the catalogue, or a "cylinder": seen from all sides, and by a camera above it and aside."""
    rng = np.random.default_rng([seed, 7])
    if name == "cylinder":
        mesh = trimesh.creation.cylinder(rng.uniform(0.020, 0.045), rng.uniform(0.08, 0.18), sections=48)
    else:
        mesh = make_object(name, seed).visual_mesh()
    samples, face = trimesh.sample.sample_surface(mesh, SAMPLES, seed=seed)
    points, normals = np.asarray(samples), np.asarray(mesh.face_normals[face])
    around = [np.array(direction, float) for direction in product((-1, 0, 1), repeat=3) if any(direction)]
    surface = points[np.any([_seen(points, normals, direction)[0] for direction in around], axis=0)]
    azimuth = rng.uniform(0, 2 * np.pi)
    level, up = np.cos(CAMERA_ELEVATION), np.sin(CAMERA_ELEVATION)
    camera = np.array([level * np.cos(azimuth), level * np.sin(azimuth), up])
    one_side = points[_seen(points, normals, camera)[1]]
    return {"whole": View("whole", surface[::4], surface), "one side": View("one side", one_side, surface)}


def _seen(points: FloatArray, normals: FloatArray, direction: FloatArray) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Which points (N,) nothing hides from an orthographic camera in this direction, and the indices of one a pixel."""
    direction = direction / np.linalg.norm(direction)
    right = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    right /= np.linalg.norm(right)
    pixel = np.floor(points @ np.column_stack([right, np.cross(direction, right)]) / PIXEL).astype(np.int64)
    pixel -= pixel.min(axis=0)
    index = pixel[:, 0] * (pixel[:, 1].max() + 1) + pixel[:, 1]
    depth, facing = points @ direction, normals @ direction
    order = np.lexsort((-depth, index))
    nearest = order[np.r_[True, np.diff(index[order]) > 0]]
    front = np.full(index.max() + 1, -np.inf)
    front[index[nearest]] = depth[nearest]
    return (depth > front[index] - 0.003) & (facing > 0.2), nearest[facing[nearest] > 0.05]


# --------------------------------------------------------------------------------------------------------------- parts


def held(grasp: Grasp, surface: FloatArray) -> NDArray[np.int64]:
    """Indices of the surface's points between the pads."""
    local = np.abs((surface - grasp.pose[:3, 3]) @ grasp.pose[:3, :3])
    reach = [grasp.width / 2 + 0.003, ROBOTIQ_2F_140.finger_width / 2, ROBOTIQ_2F_140.pad_length / 2]
    return np.flatnonzero((local <= reach).all(axis=1))


def parts_of_drill(surface: FloatArray) -> NDArray[np.int64]:
    """0 battery, 1 handle, 2 body: between the broad battery and the long body it is narrow along x."""
    layer = np.floor((surface[:, 2] - surface[:, 2].min()) / 0.006).astype(np.int64)
    long = np.array([np.ptp(surface[layer == i, 0]) for i in range(layer.max() + 1)])
    narrow = np.flatnonzero(long[: int(0.7 * len(long))] < 0.062)
    return (layer >= narrow.min()).astype(np.int64) + (layer > narrow.max())


def parts_of_pliers(surface: FloatArray) -> NDArray[np.int64]:
    """1 and 2 the handles, 0 the rest: from their ends, at -x, on, they are what falls apart along y."""
    layer = np.floor((surface[:, 0] - surface[:, 0].min()) / 0.006).astype(np.int64)
    part = np.where(layer == 0, np.where(surface[:, 1] < 0, 1, 2), 0)
    for i in range(1, layer.max() + 1):
        here = np.flatnonzero(layer == i)
        here = here[np.argsort(surface[here, 1])]
        gap = np.diff(surface[here, 1])
        split = int(gap.argmax()) + 1
        if gap[split - 1] < 0.004:
            break
        part[here[:split]], part[here[split:]] = 1, 2
    return part


def handles_held(grasp: Grasp, surface: FloatArray) -> tuple[float, float]:
    """Share of the one and of the other handle in what is between the pads, the lesser first."""
    part = parts_of_pliers(surface)[held(grasp, surface)]
    low, high = sorted((np.mean(part == 1), np.mean(part == 2))) if len(part) else (0.0, 0.0)
    return float(low), float(high)


def centre_of(surface: FloatArray) -> FloatArray:
    centre: FloatArray = 0.5 * (surface.min(axis=0) + surface.max(axis=0))
    return centre


# -------------------------------------------------------------------------------------------------------------- claims


def by_the_handle(grasp: Grasp, view: View) -> bool:
    part = parts_of_drill(view.surface)[held(grasp, view.surface)]
    return len(part) > 0 and float(np.mean(part == 1)) >= MOSTLY


def low_on_the_body(grasp: Grasp, view: View) -> bool:
    z = view.surface[:, 2]
    return grasp.kind == "region" and float(grasp.pose[2, 3] - z.min()) <= 0.35 * float(np.ptp(z))


def by_one_handle(grasp: Grasp, view: View) -> bool:
    low, high = handles_held(grasp, view.surface)
    return low < 0.05 and high >= MOSTLY


def by_both_handles(grasp: Grasp, view: View) -> bool:
    return handles_held(grasp, view.surface)[0] >= 0.1


def near_the_middle(grasp: Grasp, view: View) -> bool:
    """Of the joypad's long axis, x."""
    x = view.surface[:, 0]
    return abs(float(grasp.pose[0, 3] - centre_of(view.surface)[0])) <= 0.2 * float(np.ptp(x))


def one_primitive(grasp: Grasp, view: View) -> bool:
    """Held at the centroid of what is seen; where all is seen, that is near the object's centre as well."""
    offset = grasp.pose[:3, 3] - centre_of(view.surface)
    return grasp.kind == "primitive" and (view.side == "one side" or float(np.linalg.norm(offset)) < NEAR)


@dataclass(frozen=True)
class Claim:
    """What a figure shows of a class of objects."""

    name: str
    text: str
    holds: Callable[[Grasp, View], bool]


CLAIMS = (
    Claim("drill", "by its handle", by_the_handle),
    Claim("bottle", "low on its body", low_on_the_body),
    Claim("clamp", "by one handle", by_one_handle),
    Claim("can", "one primitive, at its centroid", one_primitive),
    Claim("cylinder", "one primitive, at its centroid", one_primitive),
    Claim("plug_adapter", "one primitive, at its centroid", one_primitive),
    Claim("pliers", "by both handles", by_both_handles),
    Claim("joypad", "near its centre", near_the_middle),
)


def outcomes(claim: Claim, planner: GraspPlanner, seeds: Sequence[int], side: Side) -> list[bool]:
    """Whether the claim holds for the best grasp on each instance; not where there is no grasp."""
    return [
        plan.best is not None and claim.holds(plan.best, view) for view, plan in plans(claim.name, planner, seeds, side)
    ]


def plans(name: str, planner: GraspPlanner, seeds: Sequence[int], side: Side) -> Iterator[tuple[View, GraspPlan]]:
    for seed in seeds:
        view = views_of(name, seed)[side]
        yield view, planner.plan(view.points)


# -------------------------------------------------------------------------------------------------------------- report


def measure_figures(
    planners: Mapping[str, GraspPlanner],
    *,
    first_seed: int,
    instances: int,
    output: Path,
    say: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Count for how many instances each claim holds; also written to OUTPUT/results.json, where it resumes by object.

    results: settings, and rows of object, claim, side, n and, of each planner, count, share and Wilson's 95 % interval.
    """
    settings = {"first_seed": first_seed, "instances": instances, "planners": list(planners)}
    path = output / "results.json"
    done = json.loads(path.read_text()) if path.exists() else {}
    rows = done["rows"] if done.get("settings") == settings else []
    for claim in CLAIMS:
        if any(row["object"] == claim.name for row in rows):
            continue
        for side in SIDES:
            row: dict[str, Any] = {"object": claim.name, "claim": claim.text, "side": side, "n": instances}
            for name, planner in planners.items():
                count = sum(outcomes(claim, planner, range(first_seed, first_seed + instances), side))
                row[name] = {
                    "count": count,
                    "share": count / instances,
                    "interval": wilson_interval(count, instances),
                }
            rows.append(row)
        write_json(path, {"settings": settings, "rows": rows})
        say(f"{claim.name}: done")
    results = {"settings": settings, "rows": rows}
    say(table_of(results))
    return results


def table_of(results: Mapping[str, Any]) -> str:
    """The results in Markdown: a row a claim and side, a column a planner, shares with their intervals in %."""
    planners = results["settings"]["planners"]
    lines = [f"| object | held | seen | {' | '.join(planners)} |", "|---" * (3 + len(planners)) + "|"]
    for row in results["rows"]:
        cells = []
        for name in planners:
            low, high = row[name]["interval"]
            cells.append(f"{row[name]['share']:.0%} ({100 * low:.0f}–{100 * high:.0f})".replace("%", ""))
        lines.append(f"| {row['object'].replace('_', ' ')} | {row['claim']} | {row['side']} | {' | '.join(cells)} |")
    return "\n".join(lines)
