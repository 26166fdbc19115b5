"""Grasps tried: come in, close, lift, shake, many hands in one PhysX scene on the CPU.

Every hand has a cell of its own with a copy of the object, apart from all others by distance and by collision groups,
on one table. The hands' flanges stand still in the world but for the slides; to lift, the table sinks away below them,
and to shake, the objects feel the inertial forces of a hand that does: the same motion seen from the hand.

- In: from where the tips are clear of the object straight along the approach, at the opening to come in with. A hand
  that is kept from its grasp, or that moves the object, has collided.
- Close as `policy.ScriptedPolicy` does: at 0.15 m/s, drawn back by what the pads advance, with its force.
- Lift by 0.25 m. Lifted is, as in the task, what both pads press on with 0.15 m of air below.
- Shake: one period of 4 Hz along each of the hand's axes, then rest. Held is what is still lifted.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import sapien
import torch
from sapien import physx
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.capture.grasps.hands import CONTROL_S, Hands
from pecgrasp_env.envs.task_state import LIFT_HEIGHT
from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.robot.pad_contact import both_press
from pecgrasp_env.scene.actors import MAX_DEPENETRATION_SPEED
from pecgrasp_env.scene.settling import CONTACT_OFFSET_M, add_object, poses_of, task_physics

__all__ = ["OUTCOMES", "TrialBench"]

OUTCOMES = ("held", "lost in the shake", "not lifted", "collided on the way in")
_HELD, _LOST, _NOT_LIFTED, _COLLIDED = range(len(OUTCOMES))

_STEP_S = 0.01
_STEPS = round(CONTROL_S / _STEP_S)
_CELL_M = 1.0
_TABLE = 0xFFFFFFFF  # touches what is in any cell
_CELL_BITS = 30  # cells of one bit are that many apart
_IN_S, _SETTLED_S = 0.40, 0.10
_CLEAR_M = 0.01  # between object and tips before the hand comes in
_KEPT_AWAY_M, _OPENING_OFF_M = 0.002, 0.0015
_MOVED_M, _TURNED_RAD = 0.003, np.radians(3.0)
_CLOSING_SPEED, _CLOSING_S = 0.15, 0.70
_LEAD_STEPS = 1.5  # of opening by which the slide goes ahead, as the policy's arm
_LIFT_M, _LIFT_S, _HUNG_S = 0.25, 0.70, 0.10
_SHAKE_HZ, _SHAKE_ACCELERATION, _AFTER_S = 4.0, 10.0, 0.20  # Hz, m/s², s


class TrialBench:
    """Cells for trials on one object; made anew for each shard, so that what was tried before changes nothing."""

    def __init__(self, model: ObjectModel, cells: int) -> None:
        points = np.concatenate(model.hulls).astype(float)
        self._hull = points[ConvexHull(points).vertices]
        side = int(np.ceil(np.sqrt(cells)))
        self._cells = np.array([[k // side, k % side, 0] for k in range(cells)]) * _CELL_M
        groups = [1 << (1 + k % _CELL_BITS) for k in range(cells)]
        with task_physics() as surface:
            physx.set_shape_config(CONTACT_OFFSET_M, 0.0)
            self._scene = sapien.Scene([physx.PhysxCpuSystem()])
            self._scene.physx_system.timestep = _STEP_S
            self._table = _table(self._scene, surface, (side + 1) * _CELL_M)
            self._hands = Hands(self._scene, groups)
            at = np.array([0.0, 0, 0, 1, 0, 0, 0])
            self._objects = [add_object(self._scene, model, at) for _ in groups]
        for body, group in zip(self._objects, groups, strict=True):
            body.max_depenetration_velocity = MAX_DEPENETRATION_SPEED
            for shape in body.collision_shapes:
                shape.set_collision_groups([group, group, 0, 0])
        self._finger = {
            int(i): (k, side) for k, pair in enumerate(self._hands.finger_ids) for side, i in enumerate(pair)
        }
        self._lying: dict[int, np.ndarray] = {}  # T_world_object of what no hand has touched yet, by cell
        self._cell_of = {body.entity.per_scene_id: k for k, body in enumerate(self._objects)}

    def run(
        self, T_world_object: np.ndarray, T_world_grasp: np.ndarray, openings: np.ndarray, forces: np.ndarray
    ) -> np.ndarray:
        """What becomes of n trials, (n,) uint8 into OUTCOMES.

        T_world_object: (n, 4, 4), at rest on z = 0. T_world_grasp: (n, 4, 4). openings: (n,) m, to come in with.
        forces: (n,) N, of the grip. More trials than cells are done one lot after the other.
        """
        n, cells = len(forces), len(self._objects)
        outcomes = np.zeros(n, np.uint8)
        for first in range(0, n, cells):
            here = np.arange(first, min(first + cells, n))
            filled = np.resize(here, cells)  # cells that are left over try the same once more
            outcome = self._lot(*(rows[filled] for rows in (T_world_object, T_world_grasp, openings, forces)))
            outcomes[here] = outcome[: len(here)]
        return outcomes

    def _lot(self, T_object: np.ndarray, T_grasp: np.ndarray, openings: np.ndarray, forces: np.ndarray) -> np.ndarray:
        T_object, T_grasp = T_object.astype(float), T_grasp.astype(float)
        shift = self._cells - T_object[:, :3, 3] * (1, 1, 0)
        T_object[:, :3, 3] += shift
        T_grasp[:, :3, 3] += shift
        self._put(T_object, T_grasp, openings)
        collided = self._come_in(T_object, T_grasp, openings, forces)
        self._hands.take_away(collided)
        self._grip(openings, forces)
        self._lift(forces)
        lifted = self._is_lifted(T_grasp)
        self._shake(T_grasp, forces)
        held = lifted & self._is_lifted(T_grasp)
        return np.select([collided, ~lifted, ~held], [_COLLIDED, _NOT_LIFTED, _LOST], _HELD).astype(np.uint8)

    def _put(self, T_object: np.ndarray, T_grasp: np.ndarray, openings: np.ndarray) -> None:
        """Everything where it starts, at rest; the tips of each hand are clear of its object."""
        self._table.entity.set_pose(sapien.Pose())
        self._table.set_kinematic_target(sapien.Pose())
        for body, T in zip(self._objects, T_object, strict=True):
            body.entity.set_pose(sapien.Pose(T))
            body.linear_velocity = body.angular_velocity = np.zeros(3)
            body.wake_up()
        self._lying = dict(enumerate(T_object))
        corners = np.einsum("nij,kj->nki", T_object[:, :3, :3], self._hull) + T_object[:, None, :3, 3]
        ahead = np.einsum("nki,ni->nk", corners - T_grasp[:, None, :3, 3], T_grasp[:, :3, 2])
        self._standoffs = np.maximum(ROBOTIQ_2F_140.pad_length / 2 + _CLEAR_M - ahead.min(axis=1), _CLEAR_M)
        self._hands.place(T_grasp, openings, self._standoffs)

    def _come_in(
        self, T_object: np.ndarray, T_grasp: np.ndarray, openings: np.ndarray, forces: np.ndarray
    ) -> np.ndarray:
        """(n,) bool: the hand was kept away or moved the object."""
        there = np.zeros(len(openings))
        for share in _evenly(_IN_S):
            self._hands.slide_to(openings, self._standoffs * (1 - share))
            self._control(openings, forces)
        for _ in _evenly(_SETTLED_S):
            self._control(openings, forces)
        kept = self._hands.lag(openings, there) > _KEPT_AWAY_M
        kept |= np.abs(self._hands.opening() - openings) > _OPENING_OFF_M
        poses = poses_of(self._objects)
        moved = np.linalg.norm(poses[:, :3] - T_object[:, :3, 3], axis=1) > _MOVED_M
        turn = Rotation.from_matrix(T_object[:, :3, :3]).inv() * Rotation.from_quat(np.roll(poses[:, 3:], -1, axis=1))
        return kept | moved | (turn.magnitude() > _TURNED_RAD)

    def _grip(self, openings: np.ndarray, forces: np.ndarray) -> None:
        stride = _CLOSING_SPEED * CONTROL_S
        wish, before, moved = openings.copy(), self._hands.opening(), np.full(len(openings), stride)
        for _ in _evenly(_CLOSING_S):
            wish = np.maximum(wish - stride, 0.0)
            self._hands.slide_to(np.maximum(wish, before - _LEAD_STEPS * moved), np.zeros(len(wish)))
            self._control(wish, forces)
            now = self._hands.opening()
            before, moved = now, before - now

    def _lift(self, forces: np.ndarray) -> None:
        """The table sinks as half a cosine; what that motion of the hand does to the object is added."""
        self._lying.clear()
        amplitude, rate = _LIFT_M / 2, np.pi / _LIFT_S
        for start in np.arange(0, _LIFT_S + _HUNG_S - 1e-9, CONTROL_S):
            self._hands.squeeze_to(np.zeros(len(forces)), forces)
            for k in range(_STEPS):
                t = min(start + k * _STEP_S, _LIFT_S)
                upwards = amplitude * rate**2 * np.cos(rate * t) * (start < _LIFT_S)
                self._accelerate(np.tile([0.0, 0.0, -upwards], (len(forces), 1)))
                depth = amplitude * (1 - np.cos(rate * min(t + _STEP_S, _LIFT_S)))
                self._table.set_kinematic_target(sapien.Pose([0, 0, -depth]))
                self._scene.step()

    def _shake(self, T_grasp: np.ndarray, forces: np.ndarray) -> None:
        period = 1 / _SHAKE_HZ
        for axis in range(3):
            for start in np.arange(0, period - 1e-9, CONTROL_S):
                self._hands.squeeze_to(np.zeros(len(forces)), forces)
                for k in range(_STEPS):
                    swing = np.sin(2 * np.pi * _SHAKE_HZ * (start + k * _STEP_S))
                    self._accelerate(-_SHAKE_ACCELERATION * swing * T_grasp[:, :3, axis])
                    self._scene.step()
        for _ in _evenly(_AFTER_S):
            self._control(np.zeros(len(forces)), forces)

    def _control(self, wishes: np.ndarray, forces: np.ndarray) -> None:
        """One control step."""
        self._hands.squeeze_to(wishes, forces)
        for _ in range(_STEPS):
            self._scene.step()
        self._keep_still()

    def _keep_still(self) -> None:
        """Put back what no hand has touched: PhysX has no rolling friction, and a can on its side would roll away."""
        for contact in self._scene.get_contacts() if self._lying else ():
            first, second = contact.bodies
            if self._table not in (first, second) and any(point.impulse.any() for point in contact.points):
                for body in (first, second):
                    self._lying.pop(self._cell_of.get(body.entity.per_scene_id, -1), None)
        for cell, T in self._lying.items():
            body = self._objects[cell]
            body.entity.set_pose(sapien.Pose(T))
            body.linear_velocity = body.angular_velocity = np.zeros(3)

    def _accelerate(self, accelerations: np.ndarray) -> None:
        """Over the next physics step, m/s² (n, 3)."""
        for body, acceleration in zip(self._objects, accelerations, strict=True):
            body.add_force_torque(acceleration, [0, 0, 0], "acceleration")

    def _is_lifted(self, T_grasp: np.ndarray) -> np.ndarray:
        """(n,) bool: both pads press on the object, and there is air below it."""
        poses = poses_of(self._objects)
        turned = Rotation.from_quat(np.roll(poses[:, 3:], -1, axis=1)).as_matrix()
        lowest = (self._hull @ turned[:, 2, :].T).min(axis=0) + poses[:, 2] + _LIFT_M
        closing = T_grasp[:, :3, 0]
        outward = torch.from_numpy(np.stack([-closing, closing], axis=1))
        forces = torch.from_numpy(self._pad_forces())
        pressed = both_press(forces[:, :, None], outward)[:, 0].numpy()
        return pressed & (lowest >= LIFT_HEIGHT)

    def _pad_forces(self) -> np.ndarray:
        """(n, 2, 3) N, by the objects on the left and the right finger, mean of two steps: they alternate."""
        forces = np.zeros((len(self._objects), 2, 3))
        for _ in range(2):
            self._scene.step()
            for contact in self._scene.get_contacts():
                ids = [body.entity.per_scene_id for body in contact.bodies]
                for sign, finger, other in ((1, *ids), (-1, *ids[::-1])):
                    if finger in self._finger and other in self._cell_of:
                        forces[self._finger[finger]] += sign * sum(point.impulse for point in contact.points)
        return forces / (2 * _STEP_S)


def _evenly(seconds: float) -> Iterator[float]:
    """Shares of so many seconds that have passed after each control step."""
    steps = round(seconds / CONTROL_S)
    return ((k + 1) / steps for k in range(steps))


def _table(scene: sapien.Scene, surface: physx.PhysxMaterial, side: float) -> physx.PhysxRigidDynamicComponent:
    table = physx.PhysxRigidDynamicComponent()
    table.kinematic = True
    slab = physx.PhysxCollisionShapeBox(half_size=[side, side, 0.1], material=surface)
    slab.local_pose = sapien.Pose([0, 0, -0.1])
    slab.set_collision_groups([_TABLE, _TABLE, 0, 0])
    table.attach(slab)
    entity = sapien.Entity()
    entity.add_component(table)
    scene.add_entity(entity)
    return table
