"""One episode, recorded: its film, what the policy saw and planned, and how it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasping import GraspPlan
from pecgrasp_env.episode_record import ClassifiedObject, EpisodeRecord, save_record
from pecgrasp_env.evaluation import Protocol, run_episode
from pecgrasp_env.film import Film, compose
from pecgrasp_env.perception import Percept, SeenObject, read_observation
from pecgrasp_env.policy import PolicyLog, ScriptedPolicy
from pecgrasp_env.report import OUTCOME_WORDS
from pecgrasp_env.sensor import deproject

_FIRST_PICTURE_S, _LAST_PICTURE_S = 1.0, 1.6  # long enough to read what is asked for, and how it ended
_MARGIN_M = 0.12  # of table that is shown around the objects


@dataclass(frozen=True)
class _Sight:
    """What the policy had before it when it planned, or looked last."""

    percept: Percept
    objects: list[SeenObject]
    chosen: int | None = None
    plan: GraspPlan | None = None


class _Watched:
    """A policy, and what it looked at: it does what the policy does."""

    def __init__(self, policy: ScriptedPolicy) -> None:
        self._policy = policy
        self.sight: _Sight | None = None
        self.depth: np.ndarray | None = None

    @property
    def log(self) -> PolicyLog:
        return self._policy.log

    @property
    def done(self) -> bool:
        return self._policy.done

    def reset(self, target: str) -> None:
        self._policy.reset(target)
        self.sight = self.depth = None

    def act(self, obs: Mapping[str, Any]) -> np.ndarray:
        views, plan = self.log.views, self.log.plan
        action = self._policy.act(obs)
        log, percept = self.log, read_observation(obs)
        self.depth = percept.depth
        if log.plan is not plan:
            self.sight = _Sight(percept, list(log.objects), log.chosen, log.plan)
        elif log.views != views and (self.sight is None or self.sight.plan is None):
            self.sight = _Sight(percept, list(log.objects))
        return action


class EpisodeRecorder:
    """Runs episodes in one environment and leaves SEED.mp4 and SEED.npz of each in a folder.

    film: steps_per_frame, width and height of the pictures (pixels), eye and target of the camera (metres, world
    frame), its field of view fov (radians). total: number of episodes, for the caption.
    """

    def __init__(self, protocol: Protocol, folder: Path, film: Mapping[str, Any], total: int) -> None:
        from mani_skill.utils import sapien_utils

        camera = {
            "pose": sapien_utils.look_at(film["eye"], film["target"]),
            "width": film["width"],
            "height": film["height"],
            "fov": film["fov"],
        }
        self._env = protocol.make_env(render_mode="rgb_array", human_render_camera_configs=camera, enable_shadow=True)
        self._policy = _Watched(protocol.make_policy())
        self._folder, self._stride, self._total = folder, int(film["steps_per_frame"]), total

    def record(self, seed: int, number: int) -> tuple[int, str, str]:
        """Run the episode of a seed. Returns the seed, the asked-for class and the outcome."""
        policy, env = self._policy, self._env
        pictures: list[np.ndarray] = []
        steps = 0
        target = ""
        fps = round(env.unwrapped.control_freq / self._stride)
        with Film(self._folder / f"{seed}.mp4", fps) as film:

            def caption(badge: tuple[str, str] | None = None) -> np.ndarray:
                heading = f"Episode {number} of {self._total}: the {target.replace('_', ' ')} is asked for"
                return compose(pictures[-1], heading, policy.log.doing, depth=policy.depth, badge=badge)

            def on_step(env: Any) -> None:
                nonlocal steps, target
                if steps % self._stride == 0:
                    target = env.unwrapped.target_names[0]
                    pictures[1:] = [np.asarray(env.render()[0].cpu(), np.uint8)]
                    film.add(caption(), _FIRST_PICTURE_S if steps == 0 else None)
                steps += 1

            episode = run_episode(env, policy, seed, on_step)  # type: ignore[arg-type]
            pictures.append(np.asarray(env.render()[0].cpu(), np.uint8))
            film.add(caption(OUTCOME_WORDS[episode.outcome]), _LAST_PICTURE_S)
        calls = {name: list(seconds) for name, seconds in policy.log.stages.items()}
        record = EpisodeRecord(episode, picture=pictures[0], calls=calls)
        if policy.sight is not None:
            record = _with_sight(record, policy.sight)
        save_record(self._folder / f"{seed}.npz", record)
        return seed, episode.target, OUTCOME_WORDS[episode.outcome][0]


def _with_sight(record: EpisodeRecord, sight: _Sight) -> EpisodeRecord:
    percept = sight.percept
    cloud = deproject(percept.depth, percept.intrinsics).reshape(-1, 3)
    T = percept.T_base_camera
    cloud = cloud[np.isfinite(cloud).all(axis=1)] @ T[:3, :3].T + T[:3, 3]
    objects = []
    for index, seen in enumerate(sight.objects):
        likely = max(seen.probabilities().items(), key=lambda item: item[1], default=("not classified", 0.0))
        objects.append(ClassifiedObject(seen.points.astype(np.float32), *likely, index == sight.chosen))
    if objects:
        corners = np.concatenate([seen.points for seen in objects])
        low, high = corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M
        cloud = cloud[((cloud > low) & (cloud < high)).all(axis=1)]
    return replace(record, objects=objects, cloud=cloud.astype(np.float32), plan=sight.plan)
