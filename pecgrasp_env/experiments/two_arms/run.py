"""The methods on the same things, seed by seed, resumable; and what they come to.

OUT/episodes.jsonl has a line an episode, OUT/results.json the numbers, OUT/table.md the same to read, OUT/films films
of some episodes. The same call goes on where it was stopped; another protocol wants another folder.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym

from pec.common.atomic_files import write_json, write_whole
from pecgrasp_env.common.render_pool import run_jobs
from pecgrasp_env.evaluation.run import EvaluationError, cut_torn_line
from pecgrasp_env.experiments.two_arms.episode import DualEpisode, run_dual_episode
from pecgrasp_env.experiments.two_arms.film import film_episode, film_path
from pecgrasp_env.experiments.two_arms.tables import as_markdown, summarise
from pecgrasp_env.policy.two_arms.choices import METHODS
from pecgrasp_env.policy.two_arms.scripted import TwoArmPolicy

Job = tuple[int, str]  # seed and method


def evaluate_dual(settings: Mapping[str, Any], progress: Callable[[int, int], None] | None = None) -> dict[str, Any]:
    """Run what is missing of the episodes, then the tables and films.

    settings: what conf/evaluate_dual.yaml makes. progress: called with how many episodes are done, and of how many.
    Returns what is also written to OUT/results.json.

    Raises EvaluationError for settings that make no sense, or a folder of another protocol.
    """
    out, methods, env = Path(settings["out"]), list(settings["methods"]), dict(settings["env"])
    _check(settings, methods)
    out.mkdir(parents=True, exist_ok=True)
    _same_protocol(out / "protocol.json", env)
    seeds = range(settings["first_seed"], settings["first_seed"] + settings["episodes"])
    wanted = [(seed, method) for seed in seeds for method in methods]
    journal = out / "episodes.jsonl"
    cut_torn_line(journal)
    known = read_dual_episodes(journal)
    missing = [job for job in wanted if job not in known]
    if progress is not None:
        progress(len(wanted) - len(missing), len(wanted))
    with closing(run_jobs(partial(_Runner, env), missing, settings["workers"])) as episodes:
        for n, episode in enumerate(episodes, 1):
            with journal.open("a") as file:
                file.write(json.dumps(asdict(episode)) + "\n")
                file.flush()
                os.fsync(file.fileno())
            known[episode.seed, episode.method] = episode
            if progress is not None:
                progress(len(wanted) - len(missing) + n, len(wanted))
    done = {method: [known[seed, method] for seed in seeds] for method in methods}
    results = {"first_seed": settings["first_seed"], "env": env, **summarise(done)}
    write_json(out / "results.json", results)
    write_whole(out / "table.md", as_markdown(results))
    films = [(seed, method) for seed in seeds[: settings["films"]] for method in methods]
    for seed, method in films:
        if not film_path(out, seed, method).exists():
            film_episode(partial(_make_env, env), TwoArmPolicy(method), seed, film_path(out, seed, method))
    return results


def read_dual_episodes(journal: Path) -> dict[Job, DualEpisode]:
    """The episodes of a journal that ended in no error, by seed and method."""
    if not journal.exists():
        return {}
    found = [DualEpisode(**json.loads(line)) for line in journal.read_text().splitlines()]
    return {(each.seed, each.method): each for each in found if each.outcome != "error"}


def _check(settings: Mapping[str, Any], methods: Sequence[str]) -> None:
    for name, least in (("episodes", 1), ("workers", 1), ("first_seed", 0), ("films", 0)):
        if not isinstance(settings[name], int) or settings[name] < least:
            raise EvaluationError(f"{name}={settings[name]!r}: must be an integer of at least {least}")
    if not methods or len(set(methods)) != len(methods) or not set(methods) <= set(METHODS):
        raise EvaluationError(f"methods={list(methods)}: must name each once, of {', '.join(METHODS)}")


def _same_protocol(path: Path, env: Mapping[str, Any]) -> None:
    if path.exists() and (then := json.loads(path.read_text())) != env:
        raise EvaluationError(f"env={dict(env)}: {path.parent} holds episodes with env={then}; say another out=DIR")
    write_json(path, dict(env))


def _make_env(env: Mapping[str, Any], **kwargs: Any) -> gym.Env:
    made = gym.make(
        "DualGrasp-v1",
        obs_mode="depth",
        control_mode="pd_joint_pos",
        reward_mode="sparse",
        render_backend="cpu",
        protective_stop=False,  # what the arms would do without it is told, too
        **{**env, **kwargs},
    )
    made.unwrapped.pictures_on_demand = True
    return made


class _Runner:
    """An environment, for one episode after another."""

    def __init__(self, env: Mapping[str, Any]) -> None:
        import torch

        torch.set_num_threads(1)
        self._env = _make_env(env)
        self._policies = {method: TwoArmPolicy(method) for method in METHODS}

    def run(self, job: Job) -> DualEpisode:
        seed, method = job
        try:
            return run_dual_episode(self._env, self._policies[method], seed)
        except Exception as error:  # of any kind: it is this episode's failure, and the others go on
            why = f"{type(error).__name__}: {error}"
            return DualEpisode(seed, method, "error", False, "", "", 0.0, 0.0, 0.0, None, why, [], 0, 0.0)

    def close(self) -> None:
        self._env.close()
