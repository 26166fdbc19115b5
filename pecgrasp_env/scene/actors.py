"""The objects of a scene: drawn, given weight and surface, and built into every sub-environment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.structs.actor import Actor
from sapien.physx import PhysxMaterial
from scipy.spatial import ConvexHull

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.objects.model import LIGHTEST
from pecgrasp_env.objects.strangers import UNKNOWN, Strangers
from pecgrasp_env.scene import draw_objects as choice

# m/s at which PhysX may push overlapping bodies apart. Without a limit, its default, an object that a finger of the
# stiff arm comes down on is shot away at 6 m/s; at 0.5 m/s pads sink into thin objects and let them go.
MAX_DEPENETRATION_SPEED = 2.0


@dataclass(frozen=True)
class Wish:
    """What a sub-environment's reset asks for instead of drawing it.

    target: index of the asked-for class. objects: class and number of the instance (None: drawn) of every known object.
    strangers: numbers of the strangers. absent: whether the asked-for class is to be away.
    """

    target: int | None = None
    objects: tuple[tuple[str, int | None], ...] | None = None
    strangers: tuple[int, ...] | None = None
    absent: bool | None = None


@dataclass(frozen=True)
class Recipe:
    """What may lie on a table.

    source: a `Catalogue`, a `MeshFolder` or whatever has their ``classes``, ``names`` and ``load``. classes: those that
    are drawn from. n_objects: of these. twins: the asked-for class comes twice. friction, mass_scale: limits of uniform
    draws, one for each object, of both friction coefficients and of what its mass is multiplied by; None: the objects'
    own. n_strangers: further objects, drawn from ``strangers``. absent: the probability that the asked-for class is
    away, for which one class always stays away; None: it is always there.
    """

    source: Any
    classes: tuple[str, ...]
    n_objects: int
    twins: bool
    friction: tuple[float, float] | None
    mass_scale: tuple[float, float] | None
    n_strangers: int = 0
    strangers: Strangers | None = None
    absent: float | None = None

    @property
    def n_slots(self) -> int:
        """How many objects lie on a table in all."""
        return self.n_objects + self.n_strangers

    def draw(self, rng: np.random.Generator, wish: Wish) -> list[ObjectModel]:
        known = self._draw_known(rng, wish)
        if self.strangers is None or not self.n_strangers:
            return known
        return choice.mix_in(
            known, choice.draw_strangers(self.strangers, self.n_strangers, known, rng, wish.strangers), rng
        )

    def _draw_known(self, rng: np.random.Generator, wish: Wish) -> list[ObjectModel]:
        if wish.objects is not None:
            names, numbers = zip(*wish.objects, strict=True)
            return choice.draw_instances(self.source, names, rng, numbers)
        there, wanted = list(range(len(self.classes))), wish.target
        if self.absent is not None:
            there, wanted = choice.leave_out(len(there), rng, wanted, wish.absent, self.absent)
        slots = choice.draw_classes(len(there), self.n_objects, self.twins, rng, wanted)
        return choice.draw_instances(self.source, [self.classes[there[i]] for i in slots], rng)

    def draw_physics(self, rng: np.random.Generator) -> list[tuple[float, PhysxMaterial | None]]:
        """Of each object what its mass is multiplied by, and its surface; None: its own."""
        drawn: list[tuple[float, PhysxMaterial | None]] = []
        for _ in range(self.n_slots):
            scale = float(rng.uniform(*self.mass_scale)) if self.mass_scale else 1.0
            friction = float(rng.uniform(*self.friction)) if self.friction else None
            drawn.append((scale, None if friction is None else PhysxMaterial(friction, friction, 0.0)))
        return drawn


class SceneObjects:
    """Objects in N sub-environments, K in each; built once in a configuration of the scene.

    models: N lists of K. actors: K, each in all sub-environments. slot_class: (N, K) long, index of each object's
    class, `STRANGER` of strangers. askable: for each sub-environment which objects may be the asked-for one. instances:
    (N, K) long, numbers among all instances of the source and then all strangers. hull_vertices: (N, K, V, 3) m, in the
    objects' frames, for `outcome.air_below`.
    """

    def __init__(
        self,
        env: BaseEnv,
        recipe: Recipe,
        draws: Sequence[np.random.Generator],
        physics: Sequence[np.random.Generator],
        wishes: Sequence[Wish],
    ) -> None:
        """draws, physics, wishes: one for each sub-environment."""
        self.models = [recipe.draw(rng, wish) for rng, wish in zip(draws, wishes, strict=True)]
        self._physics = [recipe.draw_physics(rng) for rng in physics]
        self.actors = [self._build(env, slot) for slot in range(recipe.n_slots)]
        index = {name: k for k, name in enumerate(recipe.classes)} | {UNKNOWN: choice.STRANGER}
        classes = [[index[model.class_name] for model in models] for models in self.models]
        self.slot_class = torch.tensor(classes, device=env.device)
        self._n_classes = len(recipe.classes)
        # Of objects that were asked for by name, all may be where none is there as often as usual.
        usual = [choice.askable(np.array(row), recipe.twins) for row in classes]
        known = [np.flatnonzero(np.array(row) != choice.STRANGER) for row in classes]
        self.askable = [slots if len(slots) else any_of for slots, any_of in zip(usual, known, strict=True)]
        names = [(name, instance) for name in recipe.classes for instance in recipe.source.names(name)]
        names += [(UNKNOWN, name) for name in (recipe.strangers.names if recipe.strangers is not None else ())]
        numbers = [[names.index((model.class_name, model.instance)) for model in models] for models in self.models]
        self.instances = torch.tensor(numbers, device=env.device)
        hulls = [[_hull(np.concatenate(model.hulls)) for model in models] for models in self.models]
        most = max(len(hull) for row in hulls for hull in row)
        # Repeating the last vertex pads without moving the lowest point.
        padded = np.array([[np.pad(h, ((0, most - len(h)), (0, 0)), mode="edge") for h in row] for row in hulls])
        self.hull_vertices = torch.tensor(padded, dtype=torch.float32, device=env.device)

    def _build(self, env: BaseEnv, slot: int) -> Actor:
        parts = []
        for i, (models, physics) in enumerate(zip(self.models, self._physics, strict=True)):
            (scale, surface), model = physics[slot], models[slot]
            builder = env.scene.create_actor_builder()
            model.add_to(builder, material=surface)
            for record in builder.collision_records:
                record.density *= max(scale, LIGHTEST / model.mass)
            builder.set_scene_idxs([i])
            builder.initial_pose = sapien.Pose([0.5, 0.3 * slot, 0.5])
            parts.append(builder.build(name=f"object_{slot}_{i}"))
            for body in parts[-1]._bodies:
                body.max_depenetration_velocity = MAX_DEPENETRATION_SPEED
            env.remove_from_state_dict_registry(parts[-1])
        actor = Actor.merge(parts, name=f"object_{slot}")
        env.add_to_state_dict_registry(actor)
        return actor

    def away(self, env_index: int) -> list[int]:
        """The classes of which nothing lies there."""
        there = set(self.slot_class[env_index].tolist())
        return [k for k in range(self._n_classes) if k not in there]

    def poses(self) -> torch.Tensor:
        """(N, K, 7), world frame, m and quaternion wxyz."""
        return torch.stack([actor.pose.raw_pose for actor in self.actors], dim=1)


def _hull(points: np.ndarray) -> np.ndarray:
    return points[ConvexHull(points).vertices]
