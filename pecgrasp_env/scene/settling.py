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
FALL_DAMPING = 2.0  # 1/s, stands for rolling friction, which PhysX lacks: without it a can rolls for ever
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
def task_physics(near: bool = False) -> Iterator[physx.PhysxMaterial]:
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
    with task_physics() as material:
        scene, bodies = build(models, poses, floor=material)
        calm(scene, bodies)
        return prove(scene, bodies)


def push_together(models: Sequence[ObjectModel], poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Push objects that rest on z = 0 towards their common centre, gently, until they lean against each other.

    Args:
        models: k objects.
        poses: (k, 7), position [m] and quaternion wxyz; near each other, not touching.

    Returns:
        (k, 7) poses at the end; (k,) bool, at rest there, above the plane; and (k,) bool, touching another object.
    """
    with task_physics(near=True) as material:
        scene, bodies = build(models, poses, floor=material, surface=material)
        material.static_friction = material.dynamic_friction = _ICE
        for body in bodies:
            body.angular_damping = FALL_DAMPING
        for _ in range(round(_PUSH_S / _STEP_S)):
            places = poses_of(bodies)[:, :2]
            for body, inwards in zip(bodies, places.mean(axis=0) - places, strict=True):
                # At a set speed instead of by a force: whatever is in the way, nothing gathers momentum.
                along = _PUSH_SPEED * inwards / max(float(np.linalg.norm(inwards)), _PUSH_SPEED * _STEP_S)
                body.linear_velocity = np.append(along, body.linear_velocity[2])
            scene.step()
        material.static_friction = material.dynamic_friction = _FRICTION
        for body in bodies:
            body.linear_velocity = body.angular_velocity = np.zeros(3)
        calm(scene, bodies)
        ends, at_rest = prove(scene, bodies)
        touching, _ = contacts_of(scene, bodies)
        return ends, at_rest, touching


def build(
    models: Sequence[ObjectModel],
    poses: np.ndarray,
    *,
    floor: physx.PhysxMaterial,
    surface: physx.PhysxMaterial | None = None,
) -> tuple[sapien.Scene, list[physx.PhysxRigidDynamicComponent]]:
    """A scene with the plane z = 0 and the objects at their poses (k, 7)."""
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.physx_system.timestep = _STEP_S
    ground = physx.PhysxRigidStaticComponent()
    slab = physx.PhysxCollisionShapeBox(half_size=[SPACING_M * (len(models) + 1)] * 2 + [0.1], material=floor)
    slab.local_pose = sapien.Pose([0, 0, -0.1])
    ground.attach(slab)
    _add(scene, ground, sapien.Pose())
    bodies = [add_object(scene, model, pose, surface) for model, pose in zip(models, poses, strict=True)]
    return scene, bodies


def add_object(
    scene: sapien.Scene, model: ObjectModel, pose: np.ndarray, surface: physx.PhysxMaterial | None = None
) -> physx.PhysxRigidDynamicComponent:
    """An object at a pose (7,) in a scene of `build`."""
    builder = sapien.ActorBuilder()
    model.add_to(builder, material=surface)
    builder.visual_records.clear()  # this scene has no renderer
    body = builder.build_physx_component()
    _add(scene, body, sapien.Pose(pose[:3], pose[3:]))
    return body


def add_boxes(scene: sapien.Scene, boxes: Sequence[tuple[np.ndarray, sapien.Pose]], floor: physx.PhysxMaterial) -> None:
    """Fixed boxes (half size (3,) m, pose) in a scene of `build`."""
    fixed = physx.PhysxRigidStaticComponent()
    for half_size, pose in boxes:
        shape = physx.PhysxCollisionShapeBox(half_size=half_size, material=floor)
        shape.local_pose = pose
        fixed.attach(shape)
    _add(scene, fixed, sapien.Pose())


def calm(
    scene: sapien.Scene, bodies: Sequence[physx.PhysxRigidDynamicComponent], longest_s: float = _LONGEST_FALL_S
) -> None:
    """Wait until nothing moves any more, at most so long."""
    for body in bodies:
        body.angular_damping = FALL_DAMPING
    for _ in range(round(longest_s / _REST_WINDOW_S)):
        before = poses_of(bodies)
        step(scene, _REST_WINDOW_S)
        if (_travel(before, poses_of(bodies)) < _REST_TRAVEL_M).all():
            break


def prove(
    scene: sapien.Scene, bodies: Sequence[physx.PhysxRigidDynamicComponent], travel: float = _PROOF_TRAVEL_M
) -> tuple[np.ndarray, np.ndarray]:
    """The poses a second later, and which of them lasted: moved less than ``travel`` m, above the plane."""
    # Damping also slows what still tips over or rolls: without it, and from a standstill, the pose must last.
    for body in bodies:
        body.angular_damping = _USUAL_DAMPING
        body.linear_velocity = body.angular_velocity = np.zeros(3)
    before = poses_of(bodies)
    step(scene, _PROOF_S)
    ends = poses_of(bodies)
    return ends, (_travel(before, ends) < travel) & (ends[:, 2] > 0)


def contacts_of(
    scene: sapien.Scene, bodies: Sequence[physx.PhysxRigidDynamicComponent]
) -> tuple[np.ndarray, np.ndarray]:
    """Which of the bodies lean on another one, (k,) bool; and how deep each is in anything, (k,) m, 0 or more."""
    number = {body.entity.per_scene_id: k for k, body in enumerate(bodies)}
    touching, depth = np.zeros(len(bodies), bool), np.zeros(len(bodies))
    for contact in scene.get_contacts():
        ours = [k for body in contact.bodies if (k := number.get(body.entity.per_scene_id)) is not None]
        nearest = min((point.separation for point in contact.points), default=np.inf)
        depth[ours] = np.maximum(depth[ours], -nearest)
        if len(ours) == 2 and nearest < _TOUCHING_M:
            touching[ours] = True
    return touching, depth


def step(scene: sapien.Scene, seconds: float) -> None:
    """Let the scene run."""
    for _ in range(round(seconds / _STEP_S)):
        scene.step()


def poses_of(bodies: Sequence[physx.PhysxRigidDynamicComponent]) -> np.ndarray:
    """(k, 7), position [m] and quaternion wxyz."""
    return np.array([np.concatenate([body.entity.pose.p, body.entity.pose.q]) for body in bodies])


def _travel(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far each object's origin has moved (k,), m."""
    return np.linalg.norm(after[:, :3] - before[:, :3], axis=1)


def _add(scene: sapien.Scene, component: physx.PhysxRigidBaseComponent, pose: sapien.Pose) -> None:
    entity = sapien.Entity()
    entity.add_component(component)
    entity.pose = pose
    scene.add_entity(entity)
