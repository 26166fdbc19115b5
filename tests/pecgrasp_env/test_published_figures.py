"""What the dissertation's figures show, asked of the published planner on the catalogue, whole and from one side.

Each claim is geometry in the object's frame. The planner does not do all that its figures show on our objects: what is
tested is the share of instances for which a claim holds, far enough below the share of 50 instances (in brackets) to
survive another draw, and why the others fail. Clouds have 256 points, spread by farthest-point sampling unless a test
says otherwise: independent random points scatter Δ and the lengths so much that regions of one shape are rarely alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import product

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from grasping import ROBOTIQ_2F_140, CentroidPlanner, Grasp, GraspPlan, PublishedPlanner
from pecgrasp_env.objects import make_object

INSTANCES = 10
JOYPADS = 4  # a second each to make
PIXEL = 0.002  # m
CAMERA_ELEVATION = np.radians(50)


# ------------------------------------------------------------------------------------------------------------- clouds


def seen_from(points: np.ndarray, normals: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which points (N,) nothing hides from an orthographic camera in this direction, and the indices of one a pixel."""
    direction = direction / np.linalg.norm(direction)
    right = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    right /= np.linalg.norm(right)
    pixel = np.floor(points @ np.column_stack([right, np.cross(direction, right)]) / PIXEL).astype(int)
    pixel -= pixel.min(axis=0)
    pixel = pixel[:, 0] * (pixel[:, 1].max() + 1) + pixel[:, 1]
    depth, facing = points @ direction, normals @ direction
    order = np.lexsort((-depth, pixel))
    nearest = order[np.r_[True, np.diff(pixel[order]) > 0]]
    front = np.full(pixel.max() + 1, -np.inf)
    front[pixel[nearest]] = depth[nearest]
    return (depth > front[pixel] - 0.003) & (facing > 0.2), nearest[facing[nearest] > 0.05]


def spread(points: np.ndarray, count: int) -> np.ndarray:
    """Farthest-point sampling."""
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())]
    distance = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        distance = np.minimum(distance, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(distance.argmax()))
    return points[chosen]


@cache
def clouds(name: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of an instance: its outer surface, densely; 256 points of that; 256 of what a camera above it and aside sees."""
    rng = np.random.default_rng([seed, 7])
    if name == "cylinder":
        mesh = trimesh.creation.cylinder(rng.uniform(0.020, 0.045), rng.uniform(0.08, 0.18), sections=48)
    else:
        mesh = make_object(name, seed).visual_mesh()
    points, face = trimesh.sample.sample_surface(mesh, 20_000, seed=seed)
    points, normals = np.asarray(points), np.asarray(mesh.face_normals[face])
    around = [np.array(direction, float) for direction in product((-1, 0, 1), repeat=3) if any(direction)]
    outer = points[np.any([seen_from(points, normals, direction)[0] for direction in around], axis=0)]
    azimuth = rng.uniform(0, 2 * np.pi)
    level, up = np.cos(CAMERA_ELEVATION), np.sin(CAMERA_ELEVATION)
    camera = np.array([level * np.cos(azimuth), level * np.sin(azimuth), up])
    one_side = points[seen_from(points, normals, camera)[1]]
    return outer, spread(outer[::4], 256), spread(one_side, 256)


def plans(name: str, whole: bool, planner: PublishedPlanner) -> Iterator[tuple[np.ndarray, GraspPlan]]:
    """Of each instance the outer surface (N, 3) and the plan on a cloud of it."""
    for seed in range(JOYPADS if name == "joypad" else INSTANCES):
        outer, all_sides, one_side = clouds(name, seed)
        yield outer, planner.plan(all_sides if whole else one_side)


def share(holds: list[bool]) -> float:
    return sum(holds) / len(holds)


# ------------------------------------------------------------------------------------------------- parts of the objects


def held(grasp: Grasp, surface: np.ndarray) -> np.ndarray:
    """Indices of the surface's points between the pads."""
    local = np.abs((surface - grasp.pose[:3, 3]) @ grasp.pose[:3, :3])
    reach = [grasp.width / 2 + 0.003, ROBOTIQ_2F_140.finger_width / 2, ROBOTIQ_2F_140.pad_length / 2]
    return np.flatnonzero((local <= reach).all(axis=1))


def parts_of_drill(surface: np.ndarray) -> np.ndarray:
    """0 battery, 1 handle, 2 body: between the broad battery and the long body it is narrow along x."""
    layer = np.floor((surface[:, 2] - surface[:, 2].min()) / 0.006).astype(int)
    long = np.array([np.ptp(surface[layer == i, 0]) for i in range(layer.max() + 1)])
    narrow = np.flatnonzero(long[: int(0.7 * len(long))] < 0.062)
    return (layer >= narrow.min()).astype(int) + (layer > narrow.max())


def parts_of_pliers(surface: np.ndarray) -> np.ndarray:
    """1 and 2 the handles, 0 the rest: from their ends, at -x, on, they are what falls apart along y."""
    layer = np.floor((surface[:, 0] - surface[:, 0].min()) / 0.006).astype(int)
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


def handles_held(grasp: Grasp, surface: np.ndarray) -> tuple[float, float]:
    """Share of the one and of the other handle in what is between the pads, the lesser first."""
    part = parts_of_pliers(surface)[held(grasp, surface)]
    low, high = sorted((np.mean(part == 1), np.mean(part == 2))) if len(part) else (0.0, 0.0)
    return float(low), float(high)


def centre_of(surface: np.ndarray) -> np.ndarray:
    return 0.5 * (surface.min(axis=0) + surface.max(axis=0))


# -------------------------------------------------------------------------------------------------------- the figures


def test_a_drill_seen_from_one_side_is_mostly_held_by_its_handle() -> None:
    """[0.60 from one side, 0.30 whole; the others by a flat side of the battery, some by the body]"""
    taken = []
    for outer, plan in plans("drill", False, PublishedPlanner()):
        assert plan.best is not None
        part = parts_of_drill(outer)[held(plan.best, outer)]
        taken.append(len(part) > 0 and np.mean(part == 1) >= 0.5)
    assert share(taken) >= 0.4


def test_a_bottle_is_held_low_on_its_body() -> None:
    """[0.68 from one side, in the lower third and more of its height; the others at the neck or the cap]"""
    low = []
    for outer, plan in plans("bottle", False, PublishedPlanner()):
        assert plan.best is not None
        low.append(plan.best.pose[2, 3] - outer[:, 2].min() <= 0.35 * np.ptp(outer[:, 2]))
        assert plan.best.kind == "region"
    assert share(low) >= 0.4


@pytest.mark.parametrize("whole", [True, False])
def test_a_clamp_is_held_by_one_handle(whole: bool) -> None:
    """[0.62 whole, 0.74 from one side]"""
    one = []
    for outer, plan in plans("clamp", whole, PublishedPlanner()):
        assert plan.best is not None
        low, high = handles_held(plan.best, outer)
        one.append(low < 0.05 and high >= 0.5)
    assert share(one) >= 0.4


@pytest.mark.parametrize(("name", "least"), [("cylinder", 0.7), ("can", 0.5), ("plug_adapter", 0.4)])
def test_a_simple_shape_is_one_primitive_held_at_its_centre(name: str, least: float) -> None:
    """[0.96, 0.84, 0.74 of whole clouds] with n = 4 and without a region of the rest below the last slab.

    With that rest, which has another length and is mostly the flat end, and with n = 6, at which Δ of a cylinder is on
    the border between cylinder and box: 0.02, 0.08, 0.10. From one side: at most 0.28, see the next test.
    """
    planner = PublishedPlanner(neighbour_divisor=4, partial_slab=False)
    right = []
    for outer, plan in plans(name, True, planner):
        assert plan.best is not None
        near = np.linalg.norm(plan.best.pose[:3, 3] - centre_of(outer)) < 0.02
        right.append(plan.best.kind == "primitive" and near)
    assert share(right) >= least
    rest = [
        plan.best is not None and plan.best.kind == "primitive" for _, plan in plans(name, True, PublishedPlanner())
    ]
    assert share(rest) < share(right)


def test_the_centre_of_what_is_seen_is_not_the_centre_of_the_object() -> None:
    """Why a can seen from one side is missed even where it is taken for a primitive: its unseen half."""
    for seed in range(INSTANCES):
        outer, _, one_side = clouds("can", seed)
        best = CentroidPlanner().plan(one_side, up=(0, 0, 1)).best
        assert best is not None
        assert np.linalg.norm(best.pose[:3, 3] - centre_of(outer)) > 0.005


def test_both_handles_of_pliers_and_each_alone_are_candidates() -> None:
    found = 0
    for outer, plan in plans("pliers", True, PublishedPlanner(curvature_floor=0.0)):
        part, tree = parts_of_pliers(outer), cKDTree(outer)
        for slab in {region.slab for region in plan.regions}:
            regions = [region for region in plan.regions if region.slab == slab and region.verdict == "candidate"]
            names = [set(part[tree.query(region.points)[1]].tolist()) - {0} for region in regions]
            found += all(wanted in names for wanted in ({1, 2}, {1}, {2}))
    assert found >= INSTANCES


def test_where_a_slab_falls_apart_its_parts_look_flatter_than_the_whole() -> None:
    """Why pliers are held by one handle: [both 0.08 and one 0.92 whole, 0.04 and 0.88 from one side].

    The neighbourhood of a side has 2 N / n points. The whole slab has twice those of a handle, so its neighbourhoods
    reach round the handle and P grows.
    """
    flatter = []
    for _, plan in plans("pliers", True, PublishedPlanner()):
        for whole in (region for region in plan.regions if region.cluster is None):
            parts = [region for region in plan.regions if region.slab == whole.slab and region.cluster is not None]
            if len(parts) == 2:
                flatter.append(min(part.curvature for part in parts) < whole.curvature)
    assert len(flatter) >= INSTANCES
    assert share(flatter) >= 0.8


@pytest.mark.parametrize("whole", [True, False])
def test_pliers_are_held_by_their_handles(whole: bool) -> None:
    """By one or by both."""
    by_handles = []
    for outer, plan in plans("pliers", whole, PublishedPlanner()):
        assert plan.best is not None
        by_handles.append(sum(handles_held(plan.best, outer)) >= 0.5)
    assert share(by_handles) >= 0.6


def test_pliers_whose_handles_are_one_cluster_are_more_often_held_by_both() -> None:
    """[0.44 whole with a tolerance of 50 mm, 0.08 with 20 mm: the handles are 30 mm apart]"""

    def both(tolerance: float) -> float:
        planner = PublishedPlanner(cluster_tolerance=tolerance)
        return share(
            [
                plan.best is not None and handles_held(plan.best, outer)[0] >= 0.1
                for outer, plan in plans("pliers", True, planner)
            ]
        )

    assert both(0.05) > both(0.02)


def test_the_middle_of_a_joypad_is_its_narrowest_region_but_not_its_flattest() -> None:
    """Why a joypad is held near an end instead of near its centre: [near it 0.00 whole, 0.24 from one side].

    The middle has the fewest points and thin, round edges, round which their neighbourhoods reach.
    """
    narrowest, flattest = [], []
    for outer, plan in plans("joypad", True, PublishedPlanner()):
        from_centre = [abs(region.points[:, 0].mean() - centre_of(outer)[0]) for region in plan.regions]
        middle = [distance <= 0.2 * np.ptp(outer[:, 0]) for distance in from_centre]
        narrowest.append(middle[int(np.argmin([region.width for region in plan.regions]))])
        flattest.append(middle[int(np.argmin([region.curvature for region in plan.regions]))])
    assert share(narrowest) == 1.0
    assert share(flattest) <= 0.5
