"""Where objects lie at the start: dropped, come to rest, laid out apart on the table; `clutter` lays them closer.

Objects fall in a private scene, one metre from each other (`fall`), and only the poses they come to rest in are carried
over, turned about the vertical and shifted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.scene.settling import drop

_DROPS = 30
_PLACES = 60
_LAYOUTS = 40
_TRIAL_FALLS = 16  # of which so many must end at rest:
_RESTS = 3


class PlacementError(ValueError):
    """The objects do not come to rest, or do not fit on the table with the clearance that was asked for."""


@dataclass(frozen=True)
class Region:
    """An upright rectangle on the table, world frame, metres."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


REGION = Region(x_min=0.33, x_max=0.67, y_min=-0.25, y_max=0.25)
WIDE_REGION = Region(x_min=0.30, x_max=0.67, y_min=-0.33, y_max=0.33)  # for more objects than fit in the other


def arrange(
    models: Sequence[ObjectModel], resting: np.ndarray, rng: np.random.Generator, region: Region, clearance: float
) -> np.ndarray:
    """Poses (n, 7) in which the objects rest on z = 0 inside the region, at least ``clearance`` metres from each other.

    Their resting poses (n, 7) are turned about the vertical and shifted at random. Distances are those of the convex
    outlines seen from above, so the objects themselves are at least as far apart.

    Raises:
        PlacementError: the objects do not fit.
    """
    outlines = [outline_of(model, pose) for model, pose in zip(models, resting, strict=True)]
    for _ in range(_LAYOUTS):
        placed: list[np.ndarray] = []
        poses = []
        for pose, outline in zip(resting, outlines, strict=True):
            place = _find_place(outline, placed, rng, region, clearance)
            if place is None:
                break
            yaw, shift = place
            placed.append(turn(outline, yaw) + shift)
            poses.append(move(pose, yaw, shift))
        if len(poses) == len(models):
            return np.array(poses)
    names = ", ".join(model.instance for model in models)
    raise PlacementError(f"{len(models)} objects ({names}) do not fit in {region} with clearance={clearance} m")


def drop_each(models: Sequence[ObjectModel], rng: np.random.Generator) -> np.ndarray:
    """A resting pose (7,) of every object, alone, above the origin, after a fall in a random orientation.

    Raises:
        PlacementError: an object never comes to rest.
    """
    result = np.zeros((len(models), 7))
    pending = list(range(len(models)))
    for _ in range(_DROPS):
        # Normalised there: uniform over all orientations.
        orientations = Rotation.from_quat(rng.normal(size=(len(pending), 4)))
        ends, at_rest = drop([models[index] for index in pending], orientations)
        for row, index in enumerate(pending):
            result[index, 2:] = ends[row, 2:]
        pending = [index for row, index in enumerate(pending) if not at_rest[row]]
        if not pending:
            return result
    raise PlacementError(f"{', '.join(models[index].instance for index in pending)}: not at rest after {_DROPS} drops")


@lru_cache(maxsize=1024)
def can_rest(model: ObjectModel) -> bool:
    """Whether it comes to rest often enough for `drop_each`; balls roll on."""
    falls = Rotation.from_quat(np.random.default_rng(0).normal(size=(_TRIAL_FALLS, 4)))
    _, at_rest = drop([model] * _TRIAL_FALLS, falls)
    return int(at_rest.sum()) >= _RESTS


def outline_of(model: ObjectModel, pose: np.ndarray) -> np.ndarray:
    """The convex outline (K, 2) seen from above, counter-clockwise, of the object at this orientation."""
    points = Rotation.from_quat(np.roll(pose[3:], -1)).apply(np.concatenate(model.hulls))[:, :2]
    return points[ConvexHull(points).vertices]


def move(pose: np.ndarray, yaw: float, shift: np.ndarray) -> np.ndarray:
    """A resting pose (7,) turned about the vertical by ``yaw`` rad and put at ``shift`` (2,) m."""
    rotation = Rotation.from_euler("z", yaw) * Rotation.from_quat(np.roll(pose[3:], -1))
    return np.concatenate([shift, pose[2:3], np.roll(rotation.as_quat(), 1)])


def turn(outline: np.ndarray, yaw: float) -> np.ndarray:
    """An outline (K, 2) turned counter-clockwise by ``yaw`` rad."""
    c, s = np.cos(yaw), np.sin(yaw)
    return outline @ np.array([[c, s], [-s, c]])


def _find_place(
    outline: np.ndarray, placed: list[np.ndarray], rng: np.random.Generator, region: Region, clearance: float
) -> tuple[float, np.ndarray] | None:
    for _ in range(_PLACES):
        yaw = rng.uniform(-np.pi, np.pi)
        turned = turn(outline, yaw)
        low = np.array([region.x_min, region.y_min]) - turned.min(axis=0)
        high = np.array([region.x_max, region.y_max]) - turned.max(axis=0)
        shift = rng.uniform(size=2) * (high - low) + low
        if (high >= low).all() and all(separation(turned + shift, other) >= clearance for other in placed):
            return yaw, shift
    return None


def separation(a: np.ndarray, b: np.ndarray) -> float:
    """A lower bound of the distance between two convex polygons (K, 2), counter-clockwise.

    It is the widest strip between them that is parallel to an edge: exact but for vertex against vertex, and negative
    where they overlap.
    """
    widest = -np.inf
    for one, other in ((a, b), (b, a)):
        edges = np.roll(one, -1, axis=0) - one
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
        gaps = (other @ normals.T).min(axis=0) - (one * normals).sum(axis=1)
        widest = max(widest, float(gaps.max()))
    return widest
