"""Episodes of the scripted expert as ManiSkill trajectories, by seed, over processes, resumable.

OUT/trajectory.h5, .json         what ManiSkill's tools take: observations of the mode `state_dict`, actions, states of
                                 the environment, dense rewards, success; seeds and the environment's arguments
OUT/episodes/SEED.h5, .json      one episode each, kept or not; what is there is not recorded again
OUT/recording.json               what is recorded, so that nothing else is mixed with it

ManiSkill's `RecordEpisode` writes each episode into a file of its own, whose name is given when it is whole; the same
package joins them. The expert looks at the depth picture, which is not kept: replaying makes any observation.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from pec.common.atomic_files import replacing, write_json
from pec.common.run_identity import first_difference
from pecgrasp_env.common.outcomes import RIGHT
from pecgrasp_env.common.render_pool import run_jobs
from pecgrasp_env.evaluation.episode import Episode, run_episode
from pecgrasp_env.evaluation.run import Protocol
from pecgrasp_env.evaluation.summary import summarise
from pecgrasp_env.learning.control_modes import CONTROL_MODES, from_joint_targets
from pecgrasp_env.policy.scripted import ScriptedPolicy

KEEP = ("success", "all")


class DemonstrationError(ValueError):
    """An argument of a recording makes no sense, or the folder holds another one; the message says which."""


@dataclass(frozen=True)
class Recording:
    """What is recorded; plain values, so that it can be written down and sent to a process.

    env: keyword arguments of SelectiveGrasp-v1; ``objects`` may be a mapping of arguments of `open_objects`.
    checkpoint, planner, policy: of the expert, as in `pecgrasp_env.evaluation.Protocol`.
    control_mode: one of CONTROL_MODES. The expert thinks in pd_joint_pos; the others take the arm to the same targets,
    as far as a step of them goes.
    """

    env: dict[str, Any]
    checkpoint: str | None
    planner: dict[str, Any]
    policy: dict[str, Any]
    control_mode: str = "pd_joint_pos"

    def __post_init__(self) -> None:
        if self.control_mode not in CONTROL_MODES:
            raise DemonstrationError(f"control_mode={self.control_mode!r}: must be one of {', '.join(CONTROL_MODES)}")

    def env_kwargs(self, obs_mode: str) -> dict[str, Any]:
        """Arguments of `gymnasium.make`, as they are stored beside the trajectories."""
        given = {name: value for name, value in self.env.items() if (name, value) != ("classes", None)}
        fixed = {"sim_backend": "physx_cpu", "render_backend": "cpu", "reward_mode": "dense"}
        return {**fixed, **given, "control_mode": self.control_mode, "obs_mode": obs_mode}


def record(
    recording: Recording,
    seeds: Sequence[int],
    out: Path,
    *,
    keep: str = "success",
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Record what is missing and join it; returns what is written to OUT/results.json: `summarise` of the episodes of
    ``seeds``, kept or not, and how many were kept.

    Args:
        recording: what is recorded.
        seeds: one episode each.
        out: the folder; the same call goes on where it was interrupted.
        keep: "success": only these are in the joined trajectories; or "all".
        workers: processes; 1 stays in this one.
        progress: called at the start and after each episode with how many are done, and of how many.

    Raises:
        DemonstrationError: an argument makes no sense, or the folder holds a recording of something else.
    """
    if keep not in KEEP:
        raise DemonstrationError(f"keep={keep!r}: must be one of {', '.join(KEEP)}")
    if not seeds:
        raise DemonstrationError("episodes=0: must be at least 1")
    if workers < 1:
        raise DemonstrationError(f"workers={workers}: must be at least 1")
    folder = out / "episodes"
    folder.mkdir(parents=True, exist_ok=True)
    _claim(out / "recording.json", recording)
    missing = [seed for seed in seeds if not _info_file(folder, seed).exists()]
    n_done = len(seeds) - len(missing)
    if progress is not None:
        progress(n_done, len(seeds))
    with closing(run_jobs(partial(_EpisodeRecorder, recording, folder), missing, workers)) as recorded:
        for _ in recorded:
            n_done += 1
            if progress is not None:
                progress(n_done, len(seeds))
    episodes = [Episode(**json.loads(_info_file(folder, seed).read_text())["episodes"][0]["expert"]) for seed in seeds]
    kept = [each.seed for each in episodes if keep == "all" or each.outcome in RIGHT]
    _join(folder, kept, out / "trajectory.h5", recording.env_kwargs("state_dict"))
    results = {"kept": len(kept), "trajectories": str(out / "trajectory.h5"), **summarise(episodes)}
    write_json(out / "results.json", results)
    return results


def _info_file(folder: Path, seed: int) -> Path:
    """Comes last: where it is, the episode is whole."""
    return folder / f"{seed}.json"


def _claim(path: Path, recording: Recording) -> None:
    if not path.exists():
        write_json(path, asdict(recording))
    elif difference := first_difference(json.loads(path.read_text()), asdict(recording)):
        raise DemonstrationError(
            f"{path} is of another recording, with {difference}: choose another folder, or delete it"
        )


def _join(folder: Path, seeds: Sequence[int], path: Path, env_kwargs: Mapping[str, Any]) -> None:
    """One pair of files out of those of the seeds, with the arguments by which the states can be replayed."""
    from mani_skill.trajectory.merge_trajectory import merge_trajectories

    with replacing(path) as joined:
        merge_trajectories(str(joined), [folder / f"{seed}.h5" for seed in seeds])
        content = json.loads(joined.with_suffix(".json").read_text())
        for episode in content["episodes"]:
            del episode["expert"]["stages"]  # times of computing belong to no trajectory
        if seeds:
            content["env_info"]["env_kwargs"] = dict(env_kwargs)
        content["episodes"].sort(key=lambda episode: episode["episode_id"])
    write_json(path.with_suffix(".json"), content)


# ------------------------------------------------------------------------------------------------------ one episode


class _Seen(gym.ObservationWrapper):
    """Keeps the pictures from what is outside of it, and the last whole observation for the expert."""

    whole: dict[str, Any]

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        self.whole = observation
        return {key: observation[key] for key in ("agent", "extra")}

    def close(self) -> None:
        """Not with the recorder: the next episode has another."""


class _WithPictures(gym.ObservationWrapper):
    """The whole observation again, outside of the recorder."""

    def __init__(self, env: gym.Env, seen: _Seen) -> None:
        super().__init__(env)
        self._seen = seen

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        return self._seen.whole


class _InControlMode(gym.ActionWrapper):
    """Takes actions (8,) of pd_joint_pos and gives the robot those of its control mode that go the same way."""

    def action(self, action: np.ndarray) -> np.ndarray:
        return from_joint_targets(self.unwrapped.agent, action)


class _EpisodeRecorder:
    """An environment and an expert, for one episode after another."""

    def __init__(self, recording: Recording, folder: Path) -> None:
        import torch

        torch.set_num_threads(1)
        expert = Protocol(recording.env, recording.checkpoint, recording.planner, recording.policy)
        self._policy: ScriptedPolicy = expert.make_policy()
        self._env = gym.make("SelectiveGrasp-v1", **recording.env_kwargs("depth+state_dict"))
        self._folder = folder

    def run(self, seed: int) -> Episode:
        from mani_skill.utils.wrappers import RecordEpisode

        seen = _Seen(self._env)
        with replacing(self._folder / f"{seed}.h5") as temporary:
            recorder = RecordEpisode(
                seen,
                str(temporary.parent),
                trajectory_name=temporary.stem,
                save_video=False,
                source_type="motionplanning",
                source_desc="pecgrasp_env.ScriptedPolicy, which works from depth pictures",
            )
            episode = run_episode(_InControlMode(_WithPictures(recorder, seen)), self._policy, seed)
            recorder.close()
            content = json.loads(temporary.with_suffix(".json").read_text())
        content["episodes"][0]["expert"] = asdict(episode)
        write_json(_info_file(self._folder, seed), content)
        return episode

    def close(self) -> None:
        self._env.close()
