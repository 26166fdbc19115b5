"""Objects that fall onto each other: a pile on the table, or a bin full of them.

>>> poses = pile(models, np.random.default_rng(0), REGION)      # (n, 7) on the plane z = 0
>>> poses = fill_bin(models, np.random.default_rng(0), Bin())   # (n, 7) in the bin
>>> poses = drop_at(models, starts, rng)                        # each above a place and in an orientation of one's own

The objects fall one after another in a private PhysX scene on the CPU (`settling`), so the poses do not depend on
the simulation they are carried into, and one seed gives one pile. In it, or in any bare SAPIEN scene or ManiSkill
environment, the bin itself is what ``Bin().add_to(builder).build_static(name)`` builds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.scene.placement import PlacementError, Region, outline_of
from pecgrasp_env.scene.settling import (
    FALL_DAMPING,
    add_boxes,
    add_object,
    build,
    calm,
    contacts_of,
    poses_of,
    prove,
    step,
    task_physics,
)

_GAP_M = 0.01  # that an object falls through before it meets what lies beneath it
_FASTEST = 0.6  # m/s of a fall: at 10 ms a step, faster things would pass through thin ones
_WAITS_S = (0.15, 0.5)  # until the next one is let go; the last may still move
_SPREAD = (0.15, 0.5)  # of the places from which a pile's objects fall: their distance, in radii of all the footprints
_CALM_S = 1.6
_CREEP_M = 1.5e-3  # in a second: friction holds a heap of many convex parts, but not to a hair
_ROUNDS = 12  # in which what rolled away is dropped once more
_PILES = 5
_TOUCH_SHARE = 0.5  # of the objects that must touch another for a pile to be one
_DEEPEST_M = 0.002  # that one object may be found in another
_WALL_M = 0.006
_CARDBOARD = (0.62, 0.47, 0.31, 1.0)


@dataclass(frozen=True)
class Bin:
    """A box without a lid that stands on z = 0: world frame, metres, rad.

    x, y: its centre. yaw: its turn about the vertical. size: of its inside along its own x and y, and its height.
    """

    x: float = 0.5
    y: float = 0.0
    yaw: float = 0.0
    size: tuple[float, float, float] = (0.25, 0.35, 0.12)

    def boxes(self) -> list[tuple[np.ndarray, sapien.Pose]]:
        """Half size (3,) and pose of its bottom and its four walls."""
        (a, b), height, wall = np.array(self.size[:2]) / 2, self.size[2], _WALL_M / 2
        parts = [((a + 2 * wall, b + 2 * wall, wall), (0.0, 0.0, wall))]
        for side in (-1, 1):
            parts.append(((wall, b + 2 * wall, height / 2), (side * (a + wall), 0.0, height / 2)))
            parts.append(((a, wall, height / 2), (0.0, side * (b + wall), height / 2)))
        place = sapien.Pose([self.x, self.y, 0.0], [np.cos(self.yaw / 2), 0, 0, np.sin(self.yaw / 2)])
        return [(np.array(half_size), place * sapien.Pose(centre)) for half_size, centre in parts]

    def add_to(self, builder: Any) -> Any:
        """Give collision and looks to an actor builder of SAPIEN's or ManiSkill's; returns the builder."""
        material = sapien.render.RenderMaterial(base_color=_CARDBOARD, roughness=0.9, specular=0.2)
        for half_size, pose in self.boxes():
            builder.add_box_collision(pose=pose, half_size=half_size)
            builder.add_box_visual(pose=pose, half_size=half_size, material=material)
        builder.initial_pose = sapien.Pose()
        return builder

    def local(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 2) in its own axes, from its centre."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return (points - (self.x, self.y)) @ np.array([[c, -s], [s, c]])

    def world(self, points: np.ndarray) -> np.ndarray:
        """The inverse of `local`."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return points @ np.array([[c, s], [-s, c]]) + (self.x, self.y)


def pile(models: Sequence[ObjectModel], rng: np.random.Generator, region: Region) -> np.ndarray:
    """Poses (n, 7), world frame, in which the objects rest on z = 0 and on each other.

    They fall one after another, in random orientations, round a place in the middle of the region; what rolls out of
    the region falls once more. At least half of them touch another one, and most lie or lean on others.

    Raises:
        PlacementError: they do not come to rest so, as things do that roll away or that the region is too small for.
    """
    low, high = np.array([region.x_min, region.y_min]), np.array([region.x_max, region.y_max])
    touch_share = _TOUCH_SHARE if len(models) > 1 else 0.0
    footprints = [model.extents[0] * model.extents[1] for model in models]
    radius = float(np.sqrt(np.sum(footprints) / np.pi))

    def attempt() -> np.ndarray | None:
        centre = low + rng.uniform(0.4, 0.6, 2) * (high - low)
        spread = radius * rng.uniform(*_SPREAD)

        def start(model: ObjectModel) -> np.ndarray:
            orientation = _any_orientation(rng)
            angle, far = rng.uniform(-np.pi, np.pi), spread * np.sqrt(rng.uniform())
            at = centre + far * np.array([np.cos(angle), np.sin(angle)])
            return _inside(_start(at, orientation), model, low, high)

        def stays(model: ObjectModel, pose: np.ndarray) -> bool:
            outline = outline_of(model, pose) + pose[:2]
            return bool((outline >= low).all() and (outline <= high).all())

        return _drop_in_turn(models, start, stays, rng, boxes=(), touch_share=touch_share)

    return _first(attempt, models, f"are not at rest in a pile in {region}")


def fill_bin(models: Sequence[ObjectModel], rng: np.random.Generator, box: Bin) -> np.ndarray:
    """Poses (n, 7), world frame, in which the objects rest in the bin and on each other, as they fell into it.

    The origin of each is inside the bin and its lowest point below the rim; what is long may stick out.

    Raises:
        PlacementError: they do not all stay in it.
    """
    half = np.array(box.size[:2]) / 2

    def attempt() -> np.ndarray | None:
        def start(model: ObjectModel) -> np.ndarray:
            orientation = _any_orientation(rng)
            pose = _inside(_start(rng.uniform(-half, half), orientation), model, -half, half)
            return _start(box.world(pose[:2]), Rotation.from_euler("z", box.yaw) * orientation)

        def stays(model: ObjectModel, pose: np.ndarray) -> bool:
            return bool((np.abs(box.local(pose[:2])) <= half).all() and _lowest(model, pose) < box.size[2])

        return _drop_in_turn(models, start, stays, rng, boxes=box.boxes())

    return _first(attempt, models, f"do not stay in a bin of {' x '.join(map(str, box.size))} m")


def drop_at(
    models: Sequence[ObjectModel], starts: np.ndarray, rng: np.random.Generator, boxes: Sequence[Any] = ()
) -> np.ndarray | None:
    """Poses (n, 7) of objects that fell one after another, each from a little above what lay beneath it then.

    Args:
        models: n objects, in the order in which they fall.
        starts: (n, 7), m and quaternion wxyz, of which z is not read.
        rng: draws how long each waits for the one before.
        boxes: fixed ones, (half size (3,), pose), such as `Bin.boxes`.

    Returns None where they do not come to rest.
    """
    places = iter(starts)
    return _drop_in_turn(models, lambda model: next(places), lambda model, pose: True, rng, boxes)


def _drop_in_turn(
    models: Sequence[ObjectModel],
    start: Callable[[ObjectModel], np.ndarray],
    stays: Callable[[ObjectModel, np.ndarray], bool],
    rng: np.random.Generator,
    boxes: Sequence[tuple[np.ndarray, sapien.Pose]],
    touch_share: float = 0.0,
) -> np.ndarray | None:
    """Let each fall from above its start (7,), then again whatever does not stay; None where it never ends at rest."""
    with task_physics(near=True) as material:
        scene, bodies = build([], np.zeros((0, 7)), floor=material)
        if boxes:
            add_boxes(scene, boxes, material)
        solids = [_box_corners(half_size, pose) for half_size, pose in boxes]
        for k, model in enumerate(models):
            body = add_object(scene, model, _raised(model, start(model), models[:k], poses_of(bodies), solids))
            body.max_linear_velocity = _FASTEST
            body.angular_damping = FALL_DAMPING
            bodies.append(body)
            step(scene, rng.uniform(*_WAITS_S))
        for _ in range(_ROUNDS):
            calm(scene, bodies, _CALM_S)
            poses, at_rest = prove(scene, bodies, _CREEP_M)
            touching, depth = contacts_of(scene, bodies)
            away = np.array([not stays(model, pose) for model, pose in zip(models, poses, strict=True)])
            if not away.any() and at_rest.all():
                return poses if (depth < _DEEPEST_M).all() and touching.mean() >= touch_share else None
            for k in np.flatnonzero(away).tolist():  # whatever only still moves gets time
                others = [i for i in range(len(models)) if i != k]
                now = poses_of(bodies)
                lifted = _raised(models[k], start(models[k]), [models[i] for i in others], now[others], solids)
                bodies[k].entity.pose = sapien.Pose(lifted[:3], lifted[3:])
                bodies[k].linear_velocity = bodies[k].angular_velocity = np.zeros(3)
                step(scene, rng.uniform(*_WAITS_S))
    return None


def _first(attempt: Callable[[], np.ndarray | None], models: Sequence[ObjectModel], failure: str) -> np.ndarray:
    for _ in range(_PILES):
        poses = attempt()
        if poses is not None:
            return poses
    raise PlacementError(f"{len(models)} objects ({', '.join(model.instance for model in models)}) {failure}")


def _raised(
    model: ObjectModel,
    pose: np.ndarray,
    others: Sequence[ObjectModel],
    poses: np.ndarray,
    solids: Sequence[np.ndarray],
) -> np.ndarray:
    """The pose (7,) lifted until a little air lies between the object and all that is beneath it."""
    own = np.concatenate(_placed(model, pose))
    low, high = own.min(axis=0), own.max(axis=0)
    top = 0.0
    for points in [hull for other, at in zip(others, poses, strict=True) for hull in _placed(other, at)] + list(solids):
        if (points[:, :2].max(axis=0) > low[:2]).all() and (points[:, :2].min(axis=0) < high[:2]).all():
            top = max(top, float(points[:, 2].max()))
    lifted = pose.copy()
    lifted[2] += top + _GAP_M - low[2]
    return lifted


def _placed(model: ObjectModel, pose: np.ndarray) -> list[np.ndarray]:
    """Its hulls' vertices (K, 3) at a pose (7,)."""
    rotation = Rotation.from_quat(np.roll(pose[3:], -1)).as_matrix()
    return [hull @ rotation.T + pose[:3] for hull in model.hulls]


def _lowest(model: ObjectModel, pose: np.ndarray) -> float:
    return min(float(points[:, 2].min()) for points in _placed(model, pose))


def _box_corners(half_size: np.ndarray, pose: sapien.Pose) -> np.ndarray:
    """(8, 3), world frame."""
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    matrix = pose.to_transformation_matrix()
    return (signs * half_size) @ matrix[:3, :3].T + matrix[:3, 3]


def _inside(pose: np.ndarray, model: ObjectModel, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The pose (7,) shifted into a rectangle of corners (2,), or to its middle where the object is too large for it."""
    outline = outline_of(model, pose)
    least, most = low - outline.min(axis=0), high - outline.max(axis=0)
    middle = (least + most) / 2
    pose[:2] = np.where(least <= most, np.clip(pose[:2], least, most), middle)
    return pose


def _any_orientation(rng: np.random.Generator) -> Rotation:
    return Rotation.from_quat(rng.normal(size=4))  # normalised there: uniform over all orientations


def _start(at: np.ndarray, orientation: Rotation) -> np.ndarray:
    """(7,) of a place (2,) and an orientation."""
    return np.concatenate([at, [0.0], np.roll(orientation.as_quat(), 1)])
