"""GeoGrasp: known contacts on simple shapes, and its formulas against a plain reference."""

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, axis_angle, box_top, grid, moved, tips

from grasping import GeoGraspPlanner
from grasping.baselines import geograsp


def seen_can(radius: float, height: float, step: float = 0.004) -> np.ndarray:
    """Half of a can's wall, as a camera sees it that looks along +y; axis z."""
    wall = grid((-np.pi, 0.0), (0.0, height / radius), step=step / radius)
    return radius * np.column_stack([np.cos(wall[:, 0]), np.sin(wall[:, 0]), wall[:, 1]])


def test_a_lying_bar_is_held_across_its_middle() -> None:
    plan = GeoGraspPlanner().plan(box_top(0.16, 0.04, 0.03), up=UP, table=TABLE)
    assert plan.best is not None
    assert abs(plan.best.pose[0, 3]) < 0.012
    assert abs(plan.best.pose[0, 0]) < 0.32  # r1 ≥ 1 keeps the contact line within 0.3 of the plane
    assert abs(plan.best.pose[1, 0]) > 0.8
    assert plan.best.width == pytest.approx(0.04, abs=0.012)
    assert plan.best.pose[2, 2] < -0.6
    assert tips(plan.best.pose)[2] >= 0.0


def test_a_standing_can_is_held_across_the_line_of_sight() -> None:
    for scene in ({"up": UP}, {}):
        plan = GeoGraspPlanner().plan(seen_can(0.033, 0.13), **scene)
        assert plan.best is not None
        assert axis_angle(plan.best.pose[:3, 0], np.array([1.0, 0.0, 0.0])) < 0.35
        assert plan.best.width == pytest.approx(0.066, abs=0.008)
    assert plan.best.pose[1, 2] > 0.9  # from the camera's side


def test_the_region_is_the_band_about_the_middle() -> None:
    plan = GeoGraspPlanner().plan(box_top(0.16, 0.04, 0.03), up=UP)
    (region,) = plan.regions
    assert np.ptp(region.points[:, 0]) <= 2 * 0.007 + 1e-9
    assert region.verdict == "candidate"
    assert plan.best is not None
    assert plan.best.region == 0


def test_stray_points_change_nothing() -> None:
    cloud = box_top(0.16, 0.04, 0.03, step=0.0045)
    strays = np.array([[0.0, 0.12, 0.02], [0.001, -0.11, 0.02], [-0.002, 0.1, 0.05]])
    clean = GeoGraspPlanner().plan(cloud, up=UP).best
    dirty = GeoGraspPlanner().plan(np.vstack([cloud, strays]), up=UP).best
    assert clean is not None
    assert dirty is not None
    assert np.linalg.norm(clean.pose[:3, 3] - dirty.pose[:3, 3]) < 0.012
    assert dirty.width < 0.055


def test_contacts_too_far_apart_are_a_reason() -> None:
    plan = GeoGraspPlanner().plan(box_top(0.30, 0.18, 0.05, step=0.008), up=UP, table=TABLE)
    assert plan.best is None
    assert "140 mm" in str(plan.reason)
    assert plan.regions[0].verdict.startswith("too wide: 1")


def test_more_grasps_are_ranked_and_hold_the_published_conditions() -> None:
    cloud = box_top(0.16, 0.11, 0.04, step=0.004)
    cloud = cloud + np.random.default_rng(1).normal(scale=1e-3, size=cloud.shape)
    plan = GeoGraspPlanner(n_grasps=50).plan(cloud, up=UP)
    assert len(plan.candidates) > 1
    ranks = [grasp.terms["rank"] for grasp in plan.candidates]
    assert ranks == sorted(ranks, reverse=True)
    for grasp in plan.candidates:
        assert grasp.terms["rank"] == pytest.approx(1.5 * grasp.terms["r1"] + grasp.terms["r2"])
        assert grasp.terms["r1"] >= 1
        assert grasp.terms["r2"] >= 1
        assert grasp.terms["first"] == 0.0
        assert grasp.width >= 0.98 * plan.regions[0].width - 1e-6
    assert len(GeoGraspPlanner().plan(cloud, up=UP).candidates) == 1


def test_where_no_pair_is_left_the_first_contacts_are_held() -> None:
    cloud = box_top(0.14, 0.06, 0.05, step=0.004)
    cloud = cloud + np.random.default_rng(3).normal(scale=5e-4, size=cloud.shape)
    plan = GeoGraspPlanner(n_grasps=50).plan(cloud, up=UP)
    assert [grasp.terms["first"] for grasp in plan.candidates] == [1.0]
    assert plan.candidates[0].width == pytest.approx(plan.regions[0].width)


def described_plainly(cloud: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, float]:
    """Normal and σ of the points within 30 mm, by their definition."""
    near = cloud[np.linalg.norm(cloud - point, axis=1) <= 0.03]
    values, vectors = np.linalg.eigh(np.cov(near.T, bias=True))
    return vectors[:, 0], values[0] / values.sum()


def test_normals_and_curvatures_agree_with_their_definition() -> None:
    cloud = moved(box_top(0.08, 0.05, 0.04, step=0.006), x=0.7, y=-0.4)
    wanted = np.arange(len(cloud)) % 7 == 0
    surface, place = geograsp._described(cloud, wanted)
    np.testing.assert_array_equal(surface.points, cloud[wanted])
    for index in np.flatnonzero(wanted):
        normal, sigma = described_plainly(cloud, cloud[index])
        assert abs(normal @ surface.normals[place[index]]) == pytest.approx(1.0, abs=1e-6)
        assert surface.sigma[place[index]] == pytest.approx(sigma, abs=1e-9)


def test_the_best_pair_is_the_one_that_plain_loops_find() -> None:
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(20):
        sides = []
        for centre in (-0.03, 0.03):
            points = rng.normal((centre, 0.0, 0.0), 0.006, size=(9, 3))
            normals = rng.normal((1.0, 0.0, 0.0), 0.2, size=(9, 3))
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            sides.append(geograsp._Surface(points, normals, rng.uniform(0, 0.1, 9)))
        cut = geograsp._Cut(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
        one, other = sides
        i, j = int(np.argsort(one.points[:, 0])[4]), int(np.argsort(-other.points[:, 0])[4])
        first = geograsp._Surface(
            *(np.array([getattr(one, f)[i], getattr(other, f)[j]]) for f in ("points", "normals", "sigma"))
        )
        expected = best_by_loops(first.points, one, other, cut.axis)
        pairs = geograsp._best_pairs(first, (one, other), cut)
        assert (expected is None) == (not pairs)
        if expected is not None:
            found += 1
            assert pairs[0][1]["rank"] == pytest.approx(expected[0])
            np.testing.assert_allclose(pairs[0][0], expected[1])
    assert found > 5


def best_by_loops(first: np.ndarray, one, other, axis: np.ndarray) -> tuple[float, np.ndarray] | None:
    def scaled(values: np.ndarray, value: float) -> float:
        return (value - values.min()) / (values.max() - values.min())

    apart = np.linalg.norm(first[0] - first[1])
    far1, far2 = np.linalg.norm(one.points, axis=1), np.linalg.norm(other.points, axis=1)
    off1, off2 = np.abs(one.points @ axis), np.abs(other.points @ axis)
    best = None
    for a, p in enumerate(one.points):
        if far1[a] < np.linalg.norm(first[0]) - 1e-9 or np.linalg.norm(p - first[1]) < apart - 1e-9:
            continue
        for b, q in enumerate(other.points):
            if scaled(far2, far2[b]) < 0.98 * scaled(far2, np.linalg.norm(first[1])) - 1e-6:
                continue
            if np.linalg.norm(p - q) < 0.98 * apart or np.linalg.norm(q - first[0]) < 0.98 * apart:
                continue
            line = (q - p) / np.linalg.norm(q - p)
            a1, a2 = abs(line @ one.normals[a]), abs(line @ other.normals[b])
            r1 = 2 - scaled(off1, off1[a]) - scaled(off2, off2[b]) - 10 * (abs(line @ axis) - 0.20)
            r2 = 2 - scaled(one.sigma, one.sigma[a]) - scaled(other.sigma, other.sigma[b]) + a1 + a2 - abs(a1 - a2)
            if r1 >= 1 and r2 >= 1 and (best is None or 1.5 * r1 + r2 > best[0]):
                best = (1.5 * r1 + r2, np.array([p, q]))
    return best
