"""How the objects of a scene lie: one function a kind, each ends with what physics makes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.objects.procedural.primitives import CONTAINERS
from pecgrasp_env.scene.clutter import lay_out
from pecgrasp_env.scene.piles import Bin, drop_at, fill_bin, pile
from pecgrasp_env.scene.placement import PlacementError, Region, drop_each, move, outline_of, separation
from pecgrasp_env.scene.settling import push_together

__all__ = ["KINDS", "Arrangement", "arrange_scene"]

_MOST_TOUCHING = 8  # more are seldom pushed together without one falling over
_GAP_M = 0.002
_BISECTIONS = 11


@dataclass(frozen=True)
class Arrangement:
    """A scene at rest on the plane z = 0, round the origin of the world frame.

    models: n objects. poses: (n, 7), m and quaternion wxyz. box: the bin that they lie in, or None.
    """

    models: tuple[ObjectModel, ...]
    poses: np.ndarray
    box: Bin | None = None


def arrange_scene(kind: str, models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """The objects, or the first of them where not all find room, laid out as a kind of `KINDS`.

    Raises:
        PlacementError: not even one of them does.
    """
    count = len(models)
    while True:
        try:
            arrangement = KINDS[kind](models[:count], rng)
            return replace(arrangement, models=tuple(arrangement.models))
        except PlacementError:
            if count == 1:
                raise
            count = (2 * count + 1) // 3


def _apart(models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """Each alone, a hand's breadth or a finger's from the next."""
    clearance = rng.choice([0.01, 0.03, 0.06])
    return Arrangement(tuple(models), lay_out(models, rng, _room(models, 2.2), "apart", clearance))


def _touching(models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """Side by side, pushed together until they lean on each other."""
    models = models[:_MOST_TOUCHING]
    flush = rng.random() < 0.5
    yaw = rng.uniform(-np.pi, np.pi)
    poses: list[np.ndarray] = []
    placed: list[np.ndarray] = []
    for model, resting in zip(models, drop_each(models, rng), strict=True):
        # Those with straight sides stand parallel in half of the scenes.
        turn = yaw + rng.integers(4) * np.pi / 2 if flush else rng.uniform(-np.pi, np.pi)
        pose = move(resting, turn, np.zeros(2))
        outline = outline_of(model, pose)
        pose[:2] = _up_to(outline, placed, rng)
        poses.append(pose)
        placed.append(outline + pose[:2])
    ends, at_rest, _ = push_together(models, np.array(poses))
    if not at_rest.all():
        raise PlacementError(f"{len(models)} objects do not come to rest")
    return Arrangement(tuple(models), ends - np.append(ends[:, :2].mean(axis=0), np.zeros(5)))


def _piled(models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """Dropped onto each other, in any orientation."""
    return Arrangement(tuple(models), pile(models, rng, _room(models, 3.0)))


def _bin(models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """Dropped into a box."""
    size = rng.uniform(0.2, 0.36), rng.uniform(0.25, 0.45), rng.uniform(0.06, 0.16)
    box = Bin(0.0, 0.0, rng.uniform(-np.pi, np.pi), size)
    small = tuple(model for model in models if np.sort(model.extents)[1] < size[0])
    if not small:
        raise PlacementError("no object is small enough for the bin")
    return Arrangement(small, fill_bin(small, rng, box), box)


def _stacked(models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """Put upon each other with care, the flattest side down, in towers that may stand wall to wall."""
    order = sorted(models, key=lambda model: -np.sort(model.extents)[1:].prod() * rng.uniform(0.6, 1.4))
    flush = rng.random() < 0.5
    towers: list[tuple[np.ndarray, float, np.ndarray]] = []  # centre, yaw, half size of the lowest
    n_towers = int(rng.integers(1, max(2, len(order) // 2 + 1)))
    starts = []
    for k, model in enumerate(order):
        lying = _lying(model, rng)
        if k < n_towers:
            yaw = towers[0][1] if flush and towers else float(rng.uniform(-np.pi, np.pi))
            turned = Rotation.from_euler("z", yaw) * lying
            half = np.ptp(_outline(model, turned), axis=0) / 2
            towers.append((_beside(towers, half, rng, flush), yaw, half))
            at = towers[-1][0]
        else:
            centre, yaw, below = towers[int(rng.integers(n_towers))]
            turn = yaw + (rng.normal(0, 0.06) if rng.random() < 0.6 else rng.uniform(-np.pi, np.pi))
            turned = Rotation.from_euler("z", turn) * lying
            at = centre + rng.uniform(-0.35, 0.35, 2) * below
        starts.append(_start(at, turned))
    return _dropped(order, np.array(starts), rng)


def _leaning(models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """Stood aslant against things that stand, so that they lean on them, or fall over."""
    tallest_first = sorted(models, key=lambda model: -model.extents.max() * rng.uniform(0.5, 1.5))
    n_posts = max(1, len(models) // 3)
    order = tallest_first[:n_posts] + [tallest_first[i] for i in n_posts + rng.permutation(len(models) - n_posts)]
    posts: list[tuple[np.ndarray, np.ndarray]] = []
    starts = []
    for k, model in enumerate(order):
        if k < n_posts:
            lying = _lying(model, rng) if model.extents.max() > 3.5 * np.median(model.extents) else Rotation.identity()
            turned = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)) * lying
            outline = _outline(model, turned)
            at = np.zeros(2) if not posts else posts[0][0] + _direction(rng) * rng.uniform(0.15, 0.3)
            posts.append((at, np.ptp(outline, axis=0) / 2))
        else:
            # Its longest side up, tipped towards the post.
            centre, half = posts[int(rng.integers(n_posts))]
            axis = np.eye(3)[int(np.argmax(model.extents))]
            upright = Rotation.align_vectors([[0, 0, 1]], [axis])[0]
            towards = -_direction(rng)
            tip = Rotation.from_rotvec(rng.uniform(0.2, 0.7) * np.array([-towards[1], towards[0], 0.0]))
            turned = tip * Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)) * upright
            own = np.ptp(_outline(model, turned), axis=0) / 2
            # Beside it, out of the way of its outline.
            along = np.abs(towards)
            far = min((half + own + _GAP_M) / np.maximum(along, 1e-6))
            at = centre - far * towards
        starts.append(_start(at, turned))
    return _dropped(order, np.array(starts), rng)


def _contained(models: Sequence[ObjectModel], rng: np.random.Generator) -> Arrangement:
    """Some in a bowl, a pot or a tray that is one of the objects, the others round it."""
    vessels = [model for model in models if model.class_name in (*CONTAINERS, "bowl")]
    if not vessels:
        return _piled(models, rng)
    outer = max(vessels, key=lambda model: model.extents[0] * model.extents[1])
    inside = np.sort(outer.extents[:2]) * 0.8
    others = [model for model in models if model is not outer]
    fits = [model for model in others if np.sort(model.extents)[1] < inside[0] and model.extents.max() < 2 * inside[1]]
    fits = fits[: int(rng.integers(1, 6))]
    rest = [model for model in others if not any(model is other for other in fits)]
    starts = [_start(np.zeros(2), Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)))]
    for _ in fits:
        starts.append(_start(rng.uniform(-0.2, 0.2, 2) * inside[0], Rotation.from_quat(rng.normal(size=4))))
    for model in rest:
        reach = outer.extents[:2].max() / 2 + model.extents.max() / 2
        at = _direction(rng) * reach * rng.uniform(0.8, 2.0)
        starts.append(_start(at, Rotation.from_quat(rng.normal(size=4))))
    return _dropped([outer, *fits, *rest], np.array(starts), rng)


KINDS: dict[str, Callable[[Sequence[ObjectModel], np.random.Generator], Arrangement]] = {
    "apart": _apart,
    "touching": _touching,
    "leaning": _leaning,
    "stacked": _stacked,
    "contained": _contained,
    "piled": _piled,
    "bin": _bin,
}


def _dropped(models: Sequence[ObjectModel], starts: np.ndarray, rng: np.random.Generator) -> Arrangement:
    poses = drop_at(models, starts, rng)
    if poses is None:
        raise PlacementError(f"{len(models)} objects do not come to rest")
    return Arrangement(tuple(models), poses)


def _room(models: Sequence[ObjectModel], spacious: float) -> Region:
    """A square about the origin, `spacious` times as wide as one that all footprints would fill."""
    sizes = np.array([np.sort(model.extents)[1:] for model in models])
    half = max(spacious * np.sqrt(sizes.prod(axis=1).sum()) / 2, 0.7 * float(np.hypot(*sizes.T).max()))
    return Region(-half, half, -half, half)


def _lying(model: ObjectModel, rng: np.random.Generator) -> Rotation:
    """Its shortest side upright, either end up; what is round or hollow stands as it is made."""
    if model.class_name in (*CONTAINERS, "bowl", "mug", "cup", "cylinder", "can", "plate") and rng.random() < 0.8:
        return Rotation.identity()
    axis = np.eye(3)[int(np.argmin(model.extents))]
    return Rotation.align_vectors([[0, 0, rng.choice([-1.0, 1.0])]], [axis])[0]


def _beside(
    towers: Sequence[tuple[np.ndarray, float, np.ndarray]], half: np.ndarray, rng: np.random.Generator, flush: bool
) -> np.ndarray:
    """A place (2,) for a box of half size (2,), along an axis of the last tower: touching it, or a little off."""
    if not towers:
        return np.zeros(2)
    centre, _, other = towers[-1]
    gap = _GAP_M if flush else rng.uniform(0.005, 0.06)
    along = np.zeros(2)
    axis, side = int(rng.integers(2)), rng.choice([-1, 1])
    along[axis] = side * (half[axis] + other[axis] + gap)
    along[1 - axis] = rng.uniform(-0.5, 0.5) * other[1 - axis]
    return centre + along


def _up_to(outline: np.ndarray, placed: Sequence[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Where (2,) an outline (K, 2) that comes in from a random side almost touches one of those there."""
    if not placed:
        return np.zeros(2)
    anchor, inwards = placed[int(rng.integers(len(placed)))].mean(axis=0), _direction(rng)
    near, far = 0.0, max(float(np.ptp(np.concatenate([*placed, outline]), axis=0).sum()), 0.01) * 2
    for _ in range(_BISECTIONS):
        middle = (near + far) / 2
        here = outline + anchor - middle * inwards
        clear = all(separation(here, other) >= _GAP_M for other in placed)
        near, far = (near, middle) if clear else (middle, far)
    return anchor - far * inwards


def _outline(model: ObjectModel, orientation: Rotation) -> np.ndarray:
    return outline_of(model, _start(np.zeros(2), orientation))


def _direction(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _start(at: np.ndarray, orientation: Rotation) -> np.ndarray:
    """(7,) of a place (2,) and an orientation."""
    return np.concatenate([at, [0.0], np.roll(orientation.as_quat(), 1)])
