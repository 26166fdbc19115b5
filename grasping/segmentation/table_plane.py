"""Which of a cloud's planes is the table: they are judged together, and refused where none can be one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.footprints import convex_outline
from grasping.segmentation.planes import MOST_TILT, Plane, basis, find_planes

FloatArray = NDArray[np.float64]

SAMPLED = 3000  # points that suffice for finding the table; the last fit is on all of its points
LEAST_SHARE = 0.15  # of the points in range, or of the middle of the view, that a table holds
LEAST_EXTENT = 0.20  # m, in both directions: less is the face of a box
ANOTHER_FLOOR = 0.2  # m: levels nearer than this are a table and what stands on it, the farther are a table and a floor
FLOOR = 0.2  # of its size counts where a level stands over it: under a table there is a floor
PARALLEL = np.radians(12)  # within which planes are level among themselves
WALL = np.radians(45)  # against a plane that is more likely level
FLATTER = np.radians(8)  # so much less it is turned against what a camera that is held upright sees of a floor
MIDDLE = 0.35  # rad from the view's centre, within which points count more
STANDING = 0.30  # m above a plane, within which things stand on it
WRONG_SIDE = 3.0  # times as many points within the outline under a plane as over it: it is seen from below
LEAST_UNDER = 0.005  # of the points, at least


@dataclass(frozen=True)
class View:
    """Of an upright camera at the cloud's origin: where its image's lower edge and its middle are, (3,) each."""

    down: FloatArray
    forward: FloatArray


@dataclass(frozen=True)
class Found:
    """table: the plane, its normal turned up, or a sentence on why none is one. others: what else there is, the largest
    first.
    """

    table: Plane | str
    others: list[OtherPlane]


@dataclass(frozen=True)
class OtherPlane:
    """A plane that is not the table, its normal on the table's side; the share of the points that it holds, and what it
    is to the table.
    """

    plane: Plane
    share: float
    where: str


def find_table(
    points: FloatArray,
    up: FloatArray | None,
    rng: np.random.Generator,
    *,
    coarse: float,
    band: tuple[float, float],
    view: View | None = None,
    seen_from_origin: bool = False,
) -> Found:
    """The table in a cloud (N, 3) and the planes beside it.

    coarse: RANSAC's inlier distance. band: least and greatest inlier distance after the refinement, in which it is
    three times the measured residual. Without `up` the normal is turned towards the frame's origin, where the camera
    is, unless that is not sure and things stand on the other side; or, for a plane that runs through the origin (a
    world frame), to the side on which more points lie. view: without `up`, says which planes are walls.
    seen_from_origin: the camera surely stands there.

    Of planes across each other the one that is more likely level is the table; of levels the highest that is large for
    what it is, at the view's centre, with things on it; of levels less than 0.2 m apart the lowest, on which the others
    stand.
    """
    if len(points) < 50:
        return Found(f"only {len(points)} points in range", [])
    planes = find_planes(points, up, rng, coarse, band)
    if not planes:
        return Found("no plane is level enough to be a table", [])
    weights = np.ones(len(points)) if view is None or len(planes) == 1 else _weights(points, view)
    candidates = [_Candidate(_upwards(plane, points, up), points, weights) for plane in planes]
    walls = [] if up is not None or view is None else _walls(candidates, view)
    upright = sum(each.share for each in walls), sum(each.weight for each in walls)
    left = [each for each in candidates if not any(each is wall for wall in walls)]
    eligible = [each for each in left if each.refusal(up, *upright) is None]
    if not eligible:
        return Found(
            left[0].refusal(up, *upright) or "", _others([each for each in candidates if each is not left[0]], left[0])
        )
    table = _highest(_level(eligible))
    if up is None and not seen_from_origin and table.plane.equation[3] > 0.1:
        over, under = over_outline(table.plane, points, table.members)
        if under > max(WRONG_SIDE * over, LEAST_UNDER):
            table.plane, table.normal = table.plane.turned(), -table.normal
    return Found(table.plane, _others([each for each in candidates if each is not table], table))


class _Candidate:
    def __init__(self, plane: Plane, points: FloatArray, weights: FloatArray) -> None:
        self.plane, self.points = plane, points
        self.normal = plane.equation[:3]
        self.distance = plane.distances(points)
        inside = np.abs(self.distance) <= plane.band
        self.members = points[inside]
        self.share = len(self.members) / len(points)
        self.weight = float(weights[inside].sum() / weights.sum())
        self.middle = self.members.mean(axis=0) if len(self.members) else np.zeros(3)

    @cached_property
    def width(self) -> float:
        """How wide its patch is across, m."""
        return _width(self.members)

    def refusal(self, up: FloatArray | None, walls: float = 0.0, weight_of_walls: float = 0.0) -> str | None:
        """Why this can be no table. walls: the share of the points on walls, and of their weights."""
        if max(self.share / (1.0 - walls + 1e-9), self.weight / (1.0 - weight_of_walls + 1e-9)) < LEAST_SHARE:
            return f"the largest plane holds only {100 * self.share:.0f} % of the points"
        if up is not None and self.normal @ up < np.cos(MOST_TILT):
            tilt = np.degrees(np.arccos(np.clip(self.normal @ up, -1, 1)))
            return f"the largest plane is tilted by {tilt:.0f}° against up"
        if self.width < LEAST_EXTENT:
            return f"the largest plane is only {self.width * 100:.0f} cm wide"
        return None

    @cached_property
    def standing(self) -> float:
        """The share of the points that stand on it."""
        return over_outline(self.plane, self.points, self.members)[0]


def over_outline(plane: Plane, points: FloatArray, members: FloatArray) -> tuple[float, float]:
    """The shares of the points that are over and under what is seen of a plane, no farther than things stand on it."""
    level = basis(plane.equation[:3])
    outline = convex_outline(members @ level)
    distance = plane.distances(points)
    near = np.flatnonzero((np.abs(distance) > 2 * plane.band) & (np.abs(distance) < STANDING))
    if outline is None or not len(near):
        return 0.0, 0.0
    within = (points[near] @ level @ outline[:, :2].T + outline[:, 2] < 0).all(axis=1)
    over = int(np.count_nonzero(within & (distance[near] > 0)))
    return over / len(points), (int(np.count_nonzero(within)) - over) / len(points)


def _walls(candidates: list[_Candidate], view: View) -> list[_Candidate]:
    """Those that stand across one that is more likely level."""
    wide = [each for each in candidates if each.width >= LEAST_EXTENT and each.plane.equation[3] > 0.1]
    turned = [_turned(each.normal, view) for each in wide]
    return [
        each
        for each, own in zip(wide, turned, strict=True)
        if any(
            own > less + FLATTER and each.normal @ other.normal < np.cos(WALL)
            for other, less in zip(wide, turned, strict=True)
        )
    ]


def _level(eligible: list[_Candidate]) -> list[_Candidate]:
    """Those that are level among themselves."""
    groups = [[other for other in eligible if other.normal @ each.normal > np.cos(PARALLEL)] for each in eligible]
    return max(groups, key=lambda group: sum(each.weight for each in group))


def _turned(normal: FloatArray, view: View) -> float:
    """By how much a plane is turned (rad) against any that is level for a camera held upright, whatever its pitch."""
    sideways = np.cross(view.down, view.forward)
    x, y, z = float(normal @ sideways), float(normal @ view.down), float(normal @ view.forward)
    if y <= 0 and z <= 0:
        return float(np.arcsin(min(abs(x), 1.0)))
    return float(np.arccos(np.clip(-z if y > 0 else -y, -1, 1)))


def _highest(level: list[_Candidate]) -> _Candidate:
    """Of levels one above the other the table."""
    if len(level) == 1:
        return level[0]
    upward = max(level, key=lambda each: each.weight).normal
    level = sorted(level, key=lambda each: float(each.middle @ upward))
    heights = [float(each.middle @ upward) for each in level]
    best, most = level[0], -1.0
    for i, each in enumerate(level):
        stands_on_another = i > 0 and heights[i] - heights[i - 1] < ANOTHER_FLOOR
        if stands_on_another:
            continue
        size = each.weight * (1.0 + min(1.0, 5.0 * each.standing))
        # What stands on it less than 0.2 m high is no level of its own, and chains of such are not either.
        above = [heights[k] - heights[k - 1] >= ANOTHER_FLOOR for k in range(i + 1, len(level))]
        size *= FLOOR if any(above) else 1.0
        if size > most:
            best, most = each, size
    return best


def _weights(points: FloatArray, view: View) -> FloatArray:
    """(N,) of points by their nearness to the view's centre, from 0.3 to 1.3."""
    cosine = points @ view.forward / np.maximum(np.linalg.norm(points, axis=1), 1e-9)
    return np.asarray(0.3 + np.exp(-((np.arccos(np.clip(cosine, -1, 1)) / MIDDLE) ** 2)))


def _others(candidates: list[_Candidate], table: _Candidate) -> list[OtherPlane]:
    found = []
    for each in sorted(candidates, key=lambda each: -each.share):
        if each.width < LEAST_EXTENT:
            continue  # the face of a thing
        cosine = float(each.normal @ table.normal)
        angle = float(np.degrees(np.arccos(min(abs(cosine), 1.0))))
        height = float(table.plane.distances(each.middle[None])[0])
        where = f"turned by {angle:.0f}° against the table"
        if abs(cosine) > np.cos(MOST_TILT):
            where = f"{abs(height):.2f} m {'above' if height > 0 else 'below'} the table, {where}"
        found.append(OtherPlane(each.plane if cosine >= 0 else each.plane.turned(), each.share, where))
    return found


def _width(inliers: FloatArray) -> float:
    """How wide a patch is across, m: 4 σ of a uniform strip is 1.15 times its width."""
    return 4.0 * float(np.sqrt(max(np.linalg.eigvalsh(np.cov(inliers.T))[1], 0.0)))


def _upwards(plane: Plane, points: FloatArray, up: FloatArray | None) -> Plane:
    distance = plane.distances(points)
    if up is not None:
        side = float(plane.equation[:3] @ up)
    elif abs(plane.equation[3]) > 0.1:
        side = float(plane.equation[3])
    else:
        side = float((distance > plane.band).sum()) - float((distance < -plane.band).sum())
    return plane if side >= 0 else plane.turned()
