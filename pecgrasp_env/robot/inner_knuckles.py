"""The 2F-140's inner knuckles, drawn only: the parallels of the cranks, which the physics replaces by a constraint."""

from __future__ import annotations

from pathlib import Path

import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Articulation

from pecgrasp_env.robot import gripper_linkage as lk


class InnerKnuckles:
    """Render bodies without physics, put where the cranks say. CPU simulation only: on a GPU they would stand still."""

    def __init__(self, scene: ManiSkillScene, robot: Articulation, mesh: Path) -> None:
        links = {name: link._objs[0] for name, link in robot.links_map.items()}
        self._palm = links["gripper_base"]
        self._drawn: list[tuple[sapien.Entity, sapien.Pose, sapien.physx.PhysxArticulationLinkComponent]] = []
        for side, name in ((-1, "left"), (1, "right")):
            builder = scene.create_actor_builder()
            builder.add_visual_from_file(str(mesh))
            entity = sapien.Entity()
            entity.add_component(builder.build_render_component())
            entity.name = f"{name}_inner_knuckle"
            scene.sub_scenes[0].add_entity(entity)
            pin = sapien.Pose([0, side * lk.KNUCKLE_PIVOT_Y, lk.KNUCKLE_PIVOT_Z])
            self._drawn.append((entity, pin, links[f"{name}_crank"]))
        self.follow()

    def follow(self) -> None:
        """Each knuckle turns with its crank, about its own pin in the palm."""
        palm = self._palm.entity_pose
        for entity, pin, crank in self._drawn:
            entity.set_pose(sapien.Pose((palm * pin).p, crank.entity_pose.q))
