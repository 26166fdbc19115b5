"""How often the policy lifts the right object: episodes by seed, over processes and jobs, resumable.

`run_episodes` leaves one line of JSON for each episode; the same call goes on where it was interrupted. The seed fixes
an episode: its objects, their poses and the sensor's noise. So two policies meet the same scenes under the same seeds,
and neither the number of processes nor that of jobs changes anything but the time.
"""

from __future__ import annotations

import gc
import json
import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium as gym

from pec.common.atomic_files import write_whole
from pecgrasp_env.common.job_share import JobShare
from pecgrasp_env.common.outcomes import RIGHT
from pecgrasp_env.common.render_pool import run_jobs
from pecgrasp_env.evaluation.episode import Episode, run_episode
from pecgrasp_env.evaluation.failure_images import FailureImages, camera
from pecgrasp_env.evaluation.sockets import SocketRunner
from pecgrasp_env.policy.scripted import ScriptedPolicy


class EvaluationError(ValueError):
    """An argument of an evaluation makes no sense; the message names it."""


@dataclass(frozen=True)
class Protocol:
    """What is evaluated; plain values, so that it can be hashed and sent to a process.

    env: keyword arguments of SelectiveGrasp-v1; ``objects`` may be a mapping of arguments of `open_objects`. Without
    ``classes`` they are all of a mesh folder, and the environment's own of the catalogue.
    checkpoint: directory of the classifier; None where there is one class, of which everything seen then is.
    planner: Hydra-like mapping with ``_target_``. policy: keyword arguments of `ScriptedPolicy`.
    sockets: pace, simulated seconds a second at most, of a stand-in through whose sockets the arm is driven, as a real
    one is (`evaluation.sockets`); None: in the simulation itself.
    """

    env: dict[str, Any]
    checkpoint: str | None
    planner: dict[str, Any]
    policy: dict[str, Any]
    sockets: float | None = None

    def make_env(self, **kwargs: Any) -> gym.Env:
        return gym.make(
            "SelectiveGrasp-v1",
            **{
                "obs_mode": "depth",
                "control_mode": "pd_joint_pos",
                "reward_mode": "sparse",
                "sim_backend": "physx_cpu",
                "render_backend": "cpu",
                **self.env,
                **kwargs,
            },
        )

    def check_sockets(self) -> None:
        """Raises EvaluationError where what is evaluated cannot be driven through them."""
        if self.sockets is None:
            return
        if not self.sockets > 0:
            raise EvaluationError(f"sockets={self.sockets}: a pace, simulated seconds a second, or null")
        if self.env.get("absent", False) is not False:
            raise EvaluationError("sockets=…: env.absent must be false, no real arm says that something is not there")
        if find_spec("rtde_control") is None:
            raise EvaluationError("sockets=…: ur_rtde is not installed: pip install 'pecgrasp[ur]'")

    def make_policy(self) -> ScriptedPolicy:
        """Raises EvaluationError where there is neither a classifier nor a single class."""
        from hydra.utils import instantiate

        answers = self.env.get("absent", False) is not False
        return ScriptedPolicy(self._classifier(), instantiate(self.planner), answers=answers, **self.policy)

    def _classifier(self) -> Any:
        if self.checkpoint is not None:
            from pec import Classifier

            return Classifier.load(self.checkpoint)
        from pecgrasp_env.envs.validation import open_source

        _, classes = open_source(self.env.get("objects"), self.env.get("classes"))
        if len(classes) != 1:
            raise EvaluationError(
                f"checkpoint=null: one class on the table needs no classifier, {', '.join(classes)} do. Give "
                f"checkpoint=DIR of a trained one, or env.classes=[{classes[0]}] env.n_objects=1"
            )
        return None


def run_episodes(
    protocol: Protocol,
    seeds: Sequence[int],
    out: Path,
    *,
    workers: int = 1,
    share: JobShare | None = None,
    pictures: bool = False,
    on_episode: Callable[[Episode], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Episode]:
    """Evaluate; returns those episodes of the seeds that are there at the end, in the order of the seeds.

    Args:
        protocol: what is evaluated.
        seeds: one episode each.
        out: folder of ``episodes.jsonl``, or of ``episodes.IofN.jsonl`` of each share until all are there; what is
            found in any of them is not run again, unless it ended in an error.
        workers: processes; 1 stays in this one.
        share: only every Nth of the seeds; several jobs share the work so. The last of them, or the same call without
            it, joins what all have left.
        pictures: keep what shows why an episode failed in ``failures``.
        on_episode: called with each episode as it ends.
        progress: called at the start and after each episode with how many are done, and of how many in this share.

    Raises:
        EvaluationError: workers < 1; sockets and what they cannot do.
    """
    if workers < 1:
        raise EvaluationError(f"workers={workers}: must be at least 1")
    protocol.check_sockets()
    out.mkdir(parents=True, exist_ok=True)
    mine = seeds if share is None else seeds[share.index :: share.count]
    journal = out / ("episodes.jsonl" if share is None else f"episodes{share.suffix}.jsonl")
    cut_torn_line(journal)
    done = {episode.seed for episode in read_episodes(out) if episode.outcome != "error"}
    missing = [seed for seed in mine if seed not in done]
    n_done = len(mine) - len(missing)
    if progress is not None:
        progress(n_done, len(mine))
    make_worker = partial(_Runner, protocol, out / "failures" if pictures else None)
    with closing(run_jobs(make_worker, missing, workers)) as episodes:
        for episode in episodes:
            with journal.open("a") as file:
                file.write(json.dumps(asdict(episode)) + "\n")
                file.flush()
                os.fsync(file.fileno())
            n_done += 1
            if on_episode is not None:
                on_episode(episode)
            if progress is not None:
                progress(n_done, len(mine))
    known = {episode.seed: episode for episode in read_episodes(out)}
    if all(seed in known for seed in seeds):
        _join(out, list(known.values()))
    return [known[seed] for seed in seeds if seed in known]


def read_episodes(folder: Path) -> list[Episode]:
    """All episodes in a folder, by seed. A line that is being written, or was cut off by a crash, is none."""
    known: dict[int, Episode] = {}
    for journal in sorted(folder.glob("episodes*.jsonl")):
        try:
            content = journal.read_bytes()
        except FileNotFoundError:  # another job has just joined all journals
            return read_episodes(folder)
        for line in content.splitlines(keepends=True):
            if line.endswith(b"\n"):
                episode = Episode(**json.loads(line))
                if episode.seed not in known or known[episode.seed].outcome == "error":
                    known[episode.seed] = episode
    return [known[seed] for seed in sorted(known)]


def cut_torn_line(journal: Path) -> None:
    """Of one's own journal only: the last line of another job's may be on its way."""
    if journal.exists() and not (content := journal.read_bytes()).endswith(b"\n"):
        write_whole(journal, content[: content.rfind(b"\n") + 1])


def _join(folder: Path, episodes: Sequence[Episode]) -> None:
    """One journal, in the order of the seeds, out of those of all parts."""
    write_whole(folder / "episodes.jsonl", "".join(json.dumps(asdict(e)) + "\n" for e in episodes))
    for journal in folder.glob("episodes.*of*.jsonl"):
        journal.unlink(missing_ok=True)


class _Runner:
    """One episode after another, each error an episode of its own."""

    def __init__(self, protocol: Protocol, pictures: Path | None) -> None:
        import torch

        torch.set_num_threads(1)  # two threads on a busy machine make a small network thirty times slower
        self._episodes: _Simulation | SocketRunner
        if protocol.sockets is None:
            self._episodes = _Simulation(protocol, pictures)
        else:
            self._episodes = SocketRunner(protocol.make_policy(), protocol.env, protocol.sockets, pictures)

    def run(self, seed: int) -> Episode:
        try:
            return self._episodes.run(seed)
        except Exception as error:  # of any kind: it is this episode's failure, and the others go on
            return _failed(seed, error)

    def close(self) -> None:
        self._episodes.close()


class _Simulation:
    """An environment and a policy, for one episode after another."""

    def __init__(self, protocol: Protocol, pictures: Path | None) -> None:
        looks = {} if pictures is None else {"render_mode": "rgb_array", "human_render_camera_configs": camera()}
        self._policy = protocol.make_policy()
        self._env = protocol.make_env(**looks)
        self._env.unwrapped.pictures_on_demand = True
        self._pictures = pictures
        gc.freeze()  # ManiSkill collects garbage at each reset; what is here by now is none

    def run(self, seed: int) -> Episode:
        if self._pictures is None:
            return run_episode(self._env, self._policy, seed)
        watch = FailureImages(self._env, self._policy)
        episode = run_episode(self._env, watch.policy, seed, watch.on_step)
        if episode.outcome not in RIGHT:
            watch.save(self._pictures, seed)
        return episode

    def close(self) -> None:
        self._env.close()


def _failed(seed: int, error: Exception) -> Episode:
    return Episode(seed, "", "error", f"{type(error).__name__}: {error}", [], 0, 0, 0.0, [], {})
