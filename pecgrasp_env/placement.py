"""Where objects lie at the start of an episode: dropped, come to rest, laid out apart on the table.

Objects are dropped in a small private PhysX scene on the CPU, one metre from each other, and only the poses they come
to rest in are carried over. So the agent never sees the fall, every sub-environment is laid out by its own generator
whatever the number of environments or the simulation backend, and a reset costs milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import sapien
from sapien import physx
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import ObjectModel

_STEP_S = 0.01
_LONGEST_FALL_S = 4.0
_REST_WINDOW_S = 0.2
_REST_TRAVEL_M = 1e-4
_PROOF_S = 1.0
_PROOF_TRAVEL_M = 3e-4
_FALL_DAMPING = 2.0  # 1/s, stands for rolling friction, which PhysX lacks: without it a can rolls for ever
_USUAL_DAMPING = 0.05  # PhysX's default
_DROP_HEIGHT_M = 0.02
_FRICTION = 0.6
_SCENE_SETTINGS = {
    "gravity": np.array([0.0, 0.0, -9.81], np.float32),
    "bounce_threshold": 2.0,
    "enable_pcm": True,
    "enable_tgs": True,
    "enable_ccd": False,
    "enable_enhanced_determinism": False,
    "enable_friction_every_iteration": True,
}
_PRIVATE_SPACING_M = 1.0
_DROPS = 10
_PLACES = 60
_LAYOUTS = 40


class PlacementError(ValueError):
    """The objects do not come to rest, or do not fit on the table with the clearance that was asked for."""


@dataclass(frozen=True)
class Region:
    """An upright rectangle on the table, world frame, metres."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


@contextmanager
def _task_physics() -> Iterator[physx.PhysxMaterial]:
    """The task's physics inside, whoever's it was before afterwards; yields the table's material.

    SAPIEN's settings belong to the process, and ManiSkill changes them with every environment: a fall would depend on
    what the process did before.
    """
    body, shape, scene = physx.get_body_config(), physx.get_shape_config(), physx.get_scene_config()
    iterations = body.solver_position_iterations, body.solver_velocity_iterations, body.sleep_threshold
    offsets = shape.contact_offset, shape.rest_offset
    switches = {name: getattr(scene, name) for name in _SCENE_SETTINGS}
    physx.set_body_config(15, 1, 0.005)
    physx.set_shape_config(0.02, 0.0)
    physx.set_scene_config(**_SCENE_SETTINGS)
    try:
        yield physx.PhysxMaterial(_FRICTION, _FRICTION, 0.0)
    finally:
        physx.set_body_config(*iterations)
        physx.set_shape_config(*offsets)
        physx.set_scene_config(**switches)


def settle(models: Sequence[ObjectModel], poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drop objects on the plane z = 0 and wait until they rest.

    Args:
        models: k objects.
        poses: (k, 7) start poses, position [m] and quaternion wxyz; objects may touch, they share one scene.

    Returns:
        (k, 7) poses at the end, and (k,) bool: at rest there, above the plane.
    """
    with _task_physics() as material:
        return _settle(models, poses, material)


def _settle(
    models: Sequence[ObjectModel], poses: np.ndarray, material: physx.PhysxMaterial
) -> tuple[np.ndarray, np.ndarray]:
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.physx_system.timestep = _STEP_S
    floor = physx.PhysxRigidStaticComponent()
    slab = physx.PhysxCollisionShapeBox(
        half_size=[_PRIVATE_SPACING_M * (len(models) + 1)] * 2 + [0.1], material=material
    )
    slab.local_pose = sapien.Pose([0, 0, -0.1])
    floor.attach(slab)
    _add(scene, floor, sapien.Pose())
    bodies = []
    for model, pose in zip(models, poses, strict=True):
        builder = sapien.ActorBuilder()
        model.add_to(builder)
        builder.visual_records.clear()  # this scene has no renderer
        body = builder.build_physx_component()
        _add(scene, body, sapien.Pose(pose[:3], pose[3:]))
        bodies.append(body)

    for body in bodies:
        body.angular_damping = _FALL_DAMPING
    for _ in range(round(_LONGEST_FALL_S / _REST_WINDOW_S)):
        before = _poses(bodies)
        _step(scene, _REST_WINDOW_S)
        if (_travel(before, _poses(bodies)) < _REST_TRAVEL_M).all():
            break
    # Damping also slows what still tips over or rolls: without it, and from a standstill, the pose must last.
    for body in bodies:
        body.angular_damping = _USUAL_DAMPING
        body.linear_velocity = body.angular_velocity = np.zeros(3)
    before = _poses(bodies)
    _step(scene, _PROOF_S)
    ends = _poses(bodies)
    return ends, (_travel(before, ends) < _PROOF_TRAVEL_M) & (ends[:, 2] > 0)


def _step(scene: sapien.Scene, seconds: float) -> None:
    for _ in range(round(seconds / _STEP_S)):
        scene.step()


def _poses(bodies: Sequence[physx.PhysxRigidDynamicComponent]) -> np.ndarray:
    return np.array([np.concatenate([body.entity.pose.p, body.entity.pose.q]) for body in bodies])


def _travel(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far each object's origin has moved (k,), m."""
    return np.linalg.norm(after[:, :3] - before[:, :3], axis=1)


def lay_out(models: Sequence[ObjectModel], rng: np.random.Generator, region: Region, clearance: float) -> np.ndarray:
    """Poses (n, 7) in which the objects rest on z = 0 inside the region, at least ``clearance`` metres from each other.

    Each object falls in a random orientation, so it may lie on any face it can lie on; its resting pose is then turned
    about the vertical and shifted at random. Distances are those of the convex outlines seen from above, so the objects
    themselves are at least as far apart.

    Raises:
        PlacementError: an object never comes to rest, or the objects do not fit.
    """
    return arrange(models, _drop_each(models, rng), rng, region, clearance)


def arrange(
    models: Sequence[ObjectModel], resting: np.ndarray, rng: np.random.Generator, region: Region, clearance: float
) -> np.ndarray:
    """The same for objects whose resting poses (n, 7) are known: turned about the vertical and shifted.

    Raises:
        PlacementError: the objects do not fit.
    """
    outlines = [_outline(model, pose) for model, pose in zip(models, resting, strict=True)]
    for _ in range(_LAYOUTS):
        placed: list[np.ndarray] = []
        poses = []
        for pose, outline in zip(resting, outlines, strict=True):
            place = _find_place(outline, placed, rng, region, clearance)
            if place is None:
                break
            yaw, shift = place
            placed.append(_turn(outline, yaw) + shift)
            rotation = Rotation.from_euler("z", yaw) * Rotation.from_quat(np.roll(pose[3:], -1))
            poses.append(np.concatenate([shift, pose[2:3], np.roll(rotation.as_quat(), 1)]))
        if len(poses) == len(models):
            return np.array(poses)
    names = ", ".join(model.instance for model in models)
    raise PlacementError(f"{len(models)} objects ({names}) do not fit in {region} with clearance={clearance} m")


def _add(scene: sapien.Scene, component: physx.PhysxRigidBaseComponent, pose: sapien.Pose) -> None:
    entity = sapien.Entity()
    entity.add_component(component)
    entity.pose = pose
    scene.add_entity(entity)


def _drop_each(models: Sequence[ObjectModel], rng: np.random.Generator) -> np.ndarray:
    """A resting pose (7,) of every object, alone, above the origin."""
    result = np.zeros((len(models), 7))
    pending = list(range(len(models)))
    for _ in range(_DROPS):
        poses = np.zeros((len(pending), 7))
        for row, index in enumerate(pending):
            rotation = Rotation.from_quat(rng.normal(size=4))  # normalised there: uniform over all orientations
            lowest = min(rotation.apply(hull)[:, 2].min() for hull in models[index].hulls)
            poses[row, :3] = (row * _PRIVATE_SPACING_M, 0.0, _DROP_HEIGHT_M - lowest)
            poses[row, 3:] = np.roll(rotation.as_quat(), 1)
        ends, at_rest = settle([models[index] for index in pending], poses)
        for row, index in enumerate(pending):
            result[index, 2:] = ends[row, 2:]
        pending = [index for row, index in enumerate(pending) if not at_rest[row]]
        if not pending:
            return result
    raise PlacementError(f"{', '.join(models[index].instance for index in pending)}: not at rest after {_DROPS} drops")


def _outline(model: ObjectModel, pose: np.ndarray) -> np.ndarray:
    """The convex outline (K, 2) seen from above, counter-clockwise, of the object at this orientation."""
    points = Rotation.from_quat(np.roll(pose[3:], -1)).apply(np.concatenate(model.hulls))[:, :2]
    return points[ConvexHull(points).vertices]


def _turn(outline: np.ndarray, yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return outline @ np.array([[c, s], [-s, c]])


def _find_place(
    outline: np.ndarray, placed: list[np.ndarray], rng: np.random.Generator, region: Region, clearance: float
) -> tuple[float, np.ndarray] | None:
    for _ in range(_PLACES):
        yaw = rng.uniform(-np.pi, np.pi)
        turned = _turn(outline, yaw)
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
