"""The table the robot stands on, the floor and the light: a few boxes, because what a scene draws costs more than the
pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs.actor import Actor

# Tabletop, world frame, metres: its upper face is z = 0 and the robot's base stands on it at the origin.
TABLE_X = (-0.30, 0.95)
TABLE_Y = (-0.65, 0.65)
_THICKNESS = 0.04
_HEIGHT = 0.75
FLOOR_Z = -_HEIGHT
_LEG = 0.05

_TOP_COLOR = (0.80, 0.76, 0.69, 1.0)
_LEG_COLOR = (0.32, 0.33, 0.35, 1.0)
_FLOOR_COLOR = (0.55, 0.57, 0.60, 1.0)


def build_table(scene: ManiSkillScene, x: tuple[float, float] = TABLE_X, y: tuple[float, float] = TABLE_Y) -> Actor:
    """A fixed table, top at z = 0, with the collision of its top only; x, y: where it begins and ends, m."""
    centre = np.array([np.mean(x), np.mean(y), -_THICKNESS / 2])
    half = np.array([np.ptp(x), np.ptp(y), _THICKNESS]) / 2
    builder = scene.create_actor_builder()
    builder.add_box_collision(pose=sapien.Pose(centre), half_size=half)
    builder.add_box_visual(pose=sapien.Pose(centre), half_size=half, material=_matt(_TOP_COLOR))
    leg_half = np.array([_LEG / 2, _LEG / 2, (_HEIGHT - _THICKNESS) / 2])
    for leg_x in (x[0] + _LEG, x[1] - _LEG):
        for leg_y in (y[0] + _LEG, y[1] - _LEG):
            foot = sapien.Pose([leg_x, leg_y, -(_HEIGHT + _THICKNESS) / 2])
            builder.add_box_visual(pose=foot, half_size=leg_half, material=_matt(_LEG_COLOR))
    builder.initial_pose = sapien.Pose()
    return builder.build_static(name="table")


def build_floor(scene: ManiSkillScene) -> Actor:
    """The floor of the room: drawn and solid, so that what falls off the table stays in sight."""
    pose = sapien.Pose([0, 0, FLOOR_Z - 0.05])
    builder = scene.create_actor_builder()
    builder.add_box_collision(pose=pose, half_size=[40, 40, 0.05])
    builder.add_box_visual(pose=pose, half_size=[40, 40, 0.05], material=_matt(_FLOOR_COLOR))
    builder.initial_pose = sapien.Pose()
    return builder.build_static(name="floor")


def light(scene: ManiSkillScene, shadow: bool, generators: Sequence[np.random.Generator] | None = None) -> None:
    """Soft light from above and a lamp from the side; the lamp casts shadows where they are asked for.

    generators: one for each sub-environment: the lamp's direction and the strength of all light are drawn; None: fixed.
    """
    scene.set_ambient_light([0.45, 0.45, 0.47])
    for i in range(scene.num_envs):
        direction, strength = np.array([-0.4, -0.5, -1.0]), 1.0
        if generators is not None:
            around, strength = generators[i].uniform(-np.pi, np.pi), generators[i].uniform(0.6, 1.4)
            direction = np.array([0.64 * np.cos(around), 0.64 * np.sin(around), -1.0])
        lamp, sky = strength * np.array([1.3, 1.27, 1.2]), strength * np.array([0.45, 0.46, 0.5])
        scene.add_directional_light(
            direction, lamp, shadow=shadow, shadow_scale=1.2, shadow_map_size=2048, scene_idxs=[i]
        )
        scene.add_directional_light([0.6, 0.5, -0.6], sky, scene_idxs=[i])


def _matt(color: tuple[float, float, float, float]) -> sapien.render.RenderMaterial:
    material = sapien.render.RenderMaterial()
    material.base_color = list(color)
    material.roughness = 0.9
    material.specular = 0.2
    return material
