"""One episode, recorded: its film, what the policy saw and planned, and how it ended."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.common.outcomes import OUTCOME_WORDS
from pecgrasp_env.common.video import Film, compose
from pecgrasp_env.demo.episode_record import ClassifiedObject, EpisodeRecord, save_record
from pecgrasp_env.evaluation.episode import run_episode
from pecgrasp_env.evaluation.recording_policy import Sight, Watched
from pecgrasp_env.evaluation.run import Protocol
from pecgrasp_env.sensor import deproject

_FIRST_PICTURE_S, _LAST_PICTURE_S = 1.0, 1.6  # long enough to read what is asked for, and how it ended
_MARGIN_M = 0.12  # of table that is shown around the objects


class EpisodeRecorder:
    """Runs episodes in one environment and leaves SEED.mp4 and SEED.npz of each in a folder.

    film: steps_per_frame, width and height of the pictures (pixels), eye and target of the camera (metres, world
    frame), its field of view fov (radians). seeds: those of all episodes, which captions count.
    """

    def __init__(self, protocol: Protocol, folder: Path, film: Mapping[str, Any], seeds: Sequence[int]) -> None:
        import torch
        from mani_skill.utils import sapien_utils

        warnings.filterwarnings("ignore", message=".*Box (low|high)'s precision lowered")  # ManiSkill's float64 limits
        torch.set_num_threads(1)
        camera = {
            "pose": sapien_utils.look_at(film["eye"], film["target"]),
            "width": film["width"],
            "height": film["height"],
            "fov": film["fov"],
        }
        self._env = protocol.make_env(render_mode="rgb_array", human_render_camera_configs=camera, enable_shadow=True)
        self._policy = Watched(protocol.make_policy())
        self._folder, self._stride, self._seeds = folder, int(film["steps_per_frame"]), seeds

    def run(self, seed: int) -> tuple[int, str, str]:
        """Run the episode of a seed. Returns the seed, the asked-for class and the outcome."""
        policy, env = self._policy, self._env
        place = f"{self._seeds.index(seed) + 1} of {len(self._seeds)}"
        pictures: list[np.ndarray] = []
        steps = 0
        target = ""
        fps = round(env.unwrapped.control_freq / self._stride)
        with Film(self._folder / f"{seed}.mp4", fps) as film:

            def caption(badge: tuple[str, str] | None = None) -> np.ndarray:
                heading = f"Episode {place}: the {target.replace('_', ' ')} is asked for"
                depth = None if policy.observation is None else policy.observation.frame.depth
                return compose(pictures[-1], heading, policy.log.doing, depth=depth, badge=badge)

            def on_step(env: Any) -> None:
                nonlocal steps, target
                if steps % self._stride == 0:
                    target = env.unwrapped.target_names[0]
                    pictures[1:] = [np.asarray(env.render()[0].cpu(), np.uint8)]
                    film.add(caption(), _FIRST_PICTURE_S if steps == 0 else None)
                steps += 1

            episode = run_episode(env, policy, seed, on_step)
            pictures.append(np.asarray(env.render()[0].cpu(), np.uint8))
            film.add(caption(OUTCOME_WORDS[episode.outcome]), _LAST_PICTURE_S)
        record = EpisodeRecord(episode, picture=pictures[0])
        if policy.sight is not None:
            record = _with_sight(record, policy.sight)
        save_record(self._folder / f"{seed}.npz", record)
        return seed, episode.target, OUTCOME_WORDS[episode.outcome][0]

    def close(self) -> None:
        self._env.close()


def _with_sight(record: EpisodeRecord, sight: Sight) -> EpisodeRecord:
    observation = sight.observation
    cloud = deproject(*observation.frame).reshape(-1, 3)
    T = observation.T_base_camera
    cloud = cloud[np.isfinite(cloud).all(axis=1)] @ T[:3, :3].T + T[:3, 3]
    objects = []
    for index, seen in enumerate(sight.objects):
        likely = ("not classified", 0.0)
        if seen.evidence:
            likely = max(seen.probabilities().items(), key=lambda item: item[1])
        objects.append(ClassifiedObject(seen.points.astype(np.float32), *likely, index == sight.chosen))
    if objects:
        corners = np.concatenate([seen.points for seen in objects])
        low, high = corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M
        cloud = cloud[((cloud > low) & (cloud < high)).all(axis=1)]
    return replace(record, objects=objects, cloud=cloud.astype(np.float32), plan=sight.plan)
