"""Do grasps that hands alone have tried end the same with the whole robot?

Grasps of a set of labels are tried again in SelectiveGrasp-v1: the object lies where it lay, and `ScriptedPolicy` looks
at it, moves the arm there past all that it saw, comes in, closes and lifts. Its planner knows that one grasp alone.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import sapien
from numpy.typing import ArrayLike

from grasping import Grasp, GraspPlan
from pec.grasps.labels import GraspLabels, GraspScene
from pecgrasp_env.capture.grasps.antipodal import TABLE
from pecgrasp_env.capture.shard_plan import known_source
from pecgrasp_env.evaluation.episode import run_episode
from pecgrasp_env.evaluation.run import Protocol
from pecgrasp_env.motion.grasp_approach import clear_of_table
from pecgrasp_env.policy.scripted import ScriptedPolicy

__all__ = ["Compared", "compare_with_arm", "drawn_evenly"]

_SAME_M = 1e-4
LIFTED, NOT_LIFTED, REFUSED = "lifted", "not lifted", "refused"


@dataclass(frozen=True)
class Compared:
    """One grasp. alone: its label, an outcome by name. with_arm: "lifted", "not lifted", or "refused": the arm does not
    reach it, or its motion planner finds something in the way, or nothing was seen. why: what the policy said."""

    thing: str
    sampler: str
    alone: str
    with_arm: str
    why: str | None


def drawn_evenly(labels: GraspLabels, count: int, seed: int = 0) -> list[tuple[GraspScene, int]]:
    """Up to `count` grasps, scene and index, of each outcome equally many as far as there are; only such whose tips are
    clear of the table, as the policy draws others back and so would try other grasps."""
    rng = np.random.default_rng(seed)
    of_outcome: list[list[tuple[GraspScene, int]]] = [[] for _ in labels.outcomes]
    for scene in labels.scenes():
        for i, outcome in enumerate(scene.outcome.tolist()):
            pose = scene.T_world_grasp[i].astype(float)
            if np.allclose(clear_of_table(pose, float(scene.openings[i]), TABLE), pose, atol=_SAME_M):
                of_outcome[outcome].append((scene, i))
    chosen: list[tuple[GraspScene, int]] = []
    for left, outcome in enumerate(sorted(of_outcome, key=len)):
        share = (count - len(chosen)) // (len(of_outcome) - left)
        chosen += [outcome[i] for i in rng.permutation(len(outcome))[:share]]
    return chosen


def compare_with_arm(
    directory: str | os.PathLike[str],
    chosen: Sequence[tuple[GraspScene, int]],
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Compared]:
    """Try grasps of the labels in a folder again, with the whole robot; one after the other, as they are done.

    Raises DatasetError where there are no labels.
    """
    labels = GraspLabels(directory)
    source = known_source(labels.manifest)
    task = Protocol({"objects": source, "classes": tuple(source.classes), "n_objects": 1}, None, {}, {}).make_env()
    task.unwrapped.pictures_on_demand = True
    env, planner = _AsItLay(task), _OneGrasp()
    policy = ScriptedPolicy(None, planner, attempts=1)
    try:
        for number, (scene, i) in enumerate(chosen):
            if progress is not None:
                progress(number, len(chosen))
            env.scene = scene
            terms = {"opening": float(scene.openings[i])}
            pose = scene.T_world_grasp[i].astype(float)
            planner.grasp = Grasp(pose, float(scene.widths[i]), 1.0, "region", None, terms)
            episode = run_episode(env, policy, seed=number)
            ended = {"success": LIFTED, "no_grasp": REFUSED, "no_object": REFUSED}.get(episode.outcome, NOT_LIFTED)
            names = labels.samplers[scene.sampler[i]], labels.outcomes[scene.outcome[i]]
            yield Compared(scene.thing, *names, ended, episode.reason or episode.outcome)
    finally:
        env.close()


class _OneGrasp:
    """A planner that finds one grasp on whatever it is given."""

    grasp: Grasp

    def plan(self, points: ArrayLike, **_: Any) -> GraspPlan:
        return GraspPlan(self.grasp, [self.grasp], [], None)


class _AsItLay(gym.Wrapper):
    """The task with one object, which at each reset lies as in `scene`."""

    scene: GraspScene

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        obs, info = self.env.reset(seed=seed, options={"objects": [self.scene.thing]})
        self.unwrapped.objects[0].set_pose(sapien.Pose(self.scene.T_world_object))
        return obs, info
