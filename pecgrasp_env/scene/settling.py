"""A private PhysX scene on the CPU in which objects fall, come to rest, and are pushed against each other.

Only the poses they come to rest in are carried over. So the agent never sees the fall, every sub-environment is laid
out by its own generator whatever the number of environments or the simulation backend, and a reset costs milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import sapien
from sapien import physx
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import ObjectModel

SPACING_M = 1.0  # between objects that shall not meet
# From how far PhysX looks for contacts. At ManiSkill's 20 mm, convex pairs of a few centimetres are at times reported
# 40 mm deep in each other although centimetres lie between them, and fly apart: of 60 scenes of five objects 30 mm
# apart two, before anything has touched them. Below 30 mm its persistent manifolds have to be off, too.
CONTACT_OFFSET_M = 0.005

_DROP_HEIGHT_M = 0.02
_STEP_S = 0.01
_LONGEST_FALL_S = 4.0
_REST_WINDOW_S = 0.2
_REST_TRAVEL_M = 1e-4
_PROOF_S = 1.0
_PROOF_TRAVEL_M = 3e-4
_FALL_DAMPING = 2.0  # 1/s, stands for rolling friction, which PhysX lacks: without it a can rolls for ever
_USUAL_DAMPING = 0.05  # PhysX's default
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

# How objects are pushed together: slowly, over ice, which keeps tall ones from tipping over.
_ICE = 0.05
_PUSH_SPEED = 0.02  # m/s
_PUSH_S = 1.0
_TOUCHING_M = 1e-3  # PhysX keeps bodies that lean on each other apart or together by less


@contextmanager
def _task_physics(near: bool = False) -> Iterator[physx.PhysxMaterial]:
    """The task's physics inside, whoever's it was before afterwards; yields the table's material.

    SAPIEN's settings belong to the process, and ManiSkill changes them with every environment: a fall would depend on
    what the process did before. near: objects lie within centimetres of each other, see CONTACT_OFFSET_M.
    """
    body, shape, scene = physx.get_body_config(), physx.get_shape_config(), physx.get_scene_config()
    iterations = body.solver_position_iterations, body.solver_velocity_iterations, body.sleep_threshold
    offsets = shape.contact_offset, shape.rest_offset
    switches = {name: getattr(scene, name) for name in _SCENE_SETTINGS}
    physx.set_body_config(15, 1, 0.005)
    physx.set_shape_config(CONTACT_OFFSET_M if near else 0.02, 0.0)
    physx.set_scene_config(**{**_SCENE_SETTINGS, "enable_pcm": not near})
    try:
        yield physx.PhysxMaterial(_FRICTION, _FRICTION, 0.0)
    finally:
        physx.set_body_config(*iterations)
        physx.set_shape_config(*offsets)
        physx.set_scene_config(**switches)


def drop(models: Sequence[ObjectModel], orientations: Rotation) -> tuple[np.ndarray, np.ndarray]:
    """Drop objects side by side, each alone, on the plane z = 0 and wait until they rest.

    Args:
        models: k objects.
        orientations: k, in which they start to fall.

    Returns:
        As `settle`; the objects lie along the x axis.
    """
    starts = np.zeros((len(models), 7))
    for row, (model, orientation) in enumerate(zip(models, orientations, strict=True)):
        lowest = min(orientation.apply(hull)[:, 2].min() for hull in model.hulls)
        starts[row, :3] = (row * SPACING_M, 0.0, _DROP_HEIGHT_M - lowest)
        starts[row, 3:] = np.roll(orientation.as_quat(), 1)
    return settle(models, starts)


def settle(models: Sequence[ObjectModel], poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drop objects on the plane z = 0 and wait until they rest.

    Args:
        models: k objects.
        poses: (k, 7) start poses, position [m] and quaternion wxyz; objects may touch, they share one scene.

    Returns:
        (k, 7) poses at the end, and (k,) bool: at rest there, above the plane.
    """
    with _task_physics() as material:
        scene, bodies = _build(models, poses, floor=material)
        _calm(scene, bodies)
        return _prove(scene, bodies)


def push_together(models: Sequence[ObjectModel], poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Push objects that rest on z = 0 towards their common centre, gently, until they lean against each other.

    Args:
        models: k objects.
        poses: (k, 7), position [m] and quaternion wxyz; near each other, not touching.

    Returns:
        (k, 7) poses at the end; (k,) bool, at rest there, above the plane; and (k,) bool, touching another object.
    """
    with _task_physics(near=True) as material:
        scene, bodies = _build(models, poses, floor=material, surface=material)
        material.static_friction = material.dynamic_friction = _ICE
        for body in bodies:
            body.angular_damping = _FALL_DAMPING
        for _ in range(round(_PUSH_S / _STEP_S)):
            places = _poses(bodies)[:, :2]
            for body, inwards in zip(bodies, places.mean(axis=0) - places, strict=True):
                # At a set speed instead of by a force: whatever is in the way, nothing gathers momentum.
                along = _PUSH_SPEED * inwards / max(float(np.linalg.norm(inwards)), _PUSH_SPEED * _STEP_S)
                body.linear_velocity = np.append(along, body.linear_velocity[2])
            scene.step()
        material.static_friction = material.dynamic_friction = _FRICTION
        for body in bodies:
            body.linear_velocity = body.angular_velocity = np.zeros(3)
        _calm(scene, bodies)
        ends, at_rest = _prove(scene, bodies)
        return ends, at_rest, _touching(scene, bodies)


def _build(
    models: Sequence[ObjectModel],
    poses: np.ndarray,
    *,
    floor: physx.PhysxMaterial,
    surface: physx.PhysxMaterial | None = None,
) -> tuple[sapien.Scene, list[physx.PhysxRigidDynamicComponent]]:
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.physx_system.timestep = _STEP_S
    ground = physx.PhysxRigidStaticComponent()
    slab = physx.PhysxCollisionShapeBox(half_size=[SPACING_M * (len(models) + 1)] * 2 + [0.1], material=floor)
    slab.local_pose = sapien.Pose([0, 0, -0.1])
    ground.attach(slab)
    _add(scene, ground, sapien.Pose())
    bodies = []
    for model, pose in zip(models, poses, strict=True):
        builder = sapien.ActorBuilder()
        model.add_to(builder, material=surface)
        builder.visual_records.clear()  # this scene has no renderer
        body = builder.build_physx_component()
        _add(scene, body, sapien.Pose(pose[:3], pose[3:]))
        bodies.append(body)
    return scene, bodies


def _calm(scene: sapien.Scene, bodies: Sequence[physx.PhysxRigidDynamicComponent]) -> None:
    """Wait until nothing moves any more, at most some seconds."""
    for body in bodies:
        body.angular_damping = _FALL_DAMPING
    for _ in range(round(_LONGEST_FALL_S / _REST_WINDOW_S)):
        before = _poses(bodies)
        _step(scene, _REST_WINDOW_S)
        if (_travel(before, _poses(bodies)) < _REST_TRAVEL_M).all():
            break


def _prove(scene: sapien.Scene, bodies: Sequence[physx.PhysxRigidDynamicComponent]) -> tuple[np.ndarray, np.ndarray]:
    """The poses a second later, and which of them lasted."""
    # Damping also slows what still tips over or rolls: without it, and from a standstill, the pose must last.
    for body in bodies:
        body.angular_damping = _USUAL_DAMPING
        body.linear_velocity = body.angular_velocity = np.zeros(3)
    before = _poses(bodies)
    _step(scene, _PROOF_S)
    ends = _poses(bodies)
    return ends, (_travel(before, ends) < _PROOF_TRAVEL_M) & (ends[:, 2] > 0)


def _touching(scene: sapien.Scene, bodies: Sequence[physx.PhysxRigidDynamicComponent]) -> np.ndarray:
    """Which of the bodies lean on another one, (k,) bool."""
    number = {body.entity.per_scene_id: k for k, body in enumerate(bodies)}
    result = np.zeros(len(bodies), bool)
    for contact in scene.get_contacts():
        pair = [k for body in contact.bodies if (k := number.get(body.entity.per_scene_id)) is not None]
        if len(pair) == 2 and any(point.separation < _TOUCHING_M for point in contact.points):
            result[pair] = True
    return result


def _step(scene: sapien.Scene, seconds: float) -> None:
    for _ in range(round(seconds / _STEP_S)):
        scene.step()


def _poses(bodies: Sequence[physx.PhysxRigidDynamicComponent]) -> np.ndarray:
    return np.array([np.concatenate([body.entity.pose.p, body.entity.pose.q]) for body in bodies])


def _travel(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far each object's origin has moved (k,), m."""
    return np.linalg.norm(after[:, :3] - before[:, :3], axis=1)


def _add(scene: sapien.Scene, component: physx.PhysxRigidBaseComponent, pose: sapien.Pose) -> None:
    entity = sapien.Entity()
    entity.add_component(component)
    entity.pose = pose
    scene.add_entity(entity)
