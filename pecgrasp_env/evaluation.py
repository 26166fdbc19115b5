"""How often the policy lifts the right object: episodes by seed, over processes, resumable, with Wilson intervals.

`run_episodes` leaves one line of JSON for each episode in ``episodes.jsonl``; the same call goes on where it was
interrupted. The seed of an episode fixes its objects, their poses and the sensor's noise, so two policies meet the same
scenes under the same seeds, and the number of processes changes nothing but the time.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from pecgrasp_env.policy import NOT_FOUND, PolicyLog, ScriptedPolicy
from pecgrasp_env.selective_grasp import SelectiveGraspEnv

OUTCOMES = ("success", "wrong_object", "off_table", "dropped", "no_object", "no_grasp", "missed", "timeout")
_SETTLING_STEPS = 20  # after the policy is done: what it holds must come to rest, or fall


class EvaluationError(ValueError):
    """The output folder holds episodes of another protocol, or an argument makes no sense."""


@dataclass(frozen=True)
class Episode:
    """One episode.

    outcome: one of OUTCOMES. reason: what the policy said when it gave up. failures: why each try
    failed that did.
    objects: the instances on the table. stages: seconds of each stage, summed over the episode. confidence: probability
    of the asked-for class of the object that was chosen last.
    """

    seed: int
    target: str
    outcome: str
    reason: str | None
    failures: list[str]
    steps: int
    views: int
    confidence: float
    objects: list[str]
    stages: dict[str, float]


def run_episode(
    env: gym.Env, policy: ScriptedPolicy, seed: int, on_step: Callable[[Any], None] | None = None
) -> Episode:
    """One episode of SelectiveGrasp-v1 (one sub-environment, control mode `pd_joint_pos`, an obs_mode with depth).

    on_step: called with the environment after every step, to record pictures.
    """
    task: SelectiveGraspEnv = env.unwrapped
    obs, info = env.reset(seed=seed)
    policy.reset(info["target"][0])
    after = 0
    truncated = False
    while after < _SETTLING_STEPS and not truncated:
        obs, _, terminated, time_out, info = env.step(policy.act(obs))
        if on_step is not None:
            on_step(env)
        if bool(terminated):
            break
        truncated = bool(time_out)
        after += policy.done
    log = policy.log
    return Episode(
        seed=seed,
        target=task.target_names[0],
        outcome=_outcome(info, log),
        reason=log.reason,
        failures=list(log.failures),
        steps=int(info["elapsed_steps"]),
        views=log.views,
        confidence=log.confidence,
        objects=[model.instance for model in task.models[0]],
        stages={name: float(sum(seconds)) for name, seconds in log.stages.items()},
    )


def _outcome(info: dict[str, Any], log: PolicyLog) -> str:
    for name in ("success", "wrong_object", "off_table", "dropped"):
        if bool(info[name]):
            return name
    if log.reason is None:
        return "missed" if log.lifted else "timeout"  # lifted: the policy believes that it holds the object high enough
    if log.reason == NOT_FOUND:
        return "no_object"
    return "no_grasp" if log.reason.startswith("no ") else "missed"


# ------------------------------------------------------------------------------------------------- many episodes


@dataclass(frozen=True)
class Protocol:
    """What is evaluated; plain values, so that it can be compared with what an output folder holds and sent to a
    process.

    env: keyword arguments of SelectiveGrasp-v1; ``objects`` may be a mapping of arguments of `open_objects`.
    checkpoint: directory of the classifier. planner: Hydra-like mapping with ``_target_``. policy: keyword arguments of
    `ScriptedPolicy`.
    """

    env: dict[str, Any]
    checkpoint: str
    planner: dict[str, Any]
    policy: dict[str, Any]

    def make_env(self, **kwargs: Any) -> gym.Env:
        from pecgrasp_env.objects import open_objects

        arguments = dict(self.env)
        if isinstance(arguments.get("objects"), dict):
            arguments["objects"] = open_objects(**arguments["objects"], classes=arguments.get("classes"))
        if arguments.get("classes") is None:
            arguments.pop("classes", None)
        return gym.make(
            "SelectiveGrasp-v1",
            **{
                "obs_mode": "depth",
                "control_mode": "pd_joint_pos",
                "reward_mode": "sparse",
                "sim_backend": "physx_cpu",
                "render_backend": "cpu",
                **arguments,
                **kwargs,
            },
        )

    def make_policy(self) -> ScriptedPolicy:
        from hydra.utils import instantiate

        from pec import Classifier

        return ScriptedPolicy(Classifier.load(self.checkpoint), instantiate(self.planner), **self.policy)


def run_episodes(
    protocol: Protocol,
    seeds: Sequence[int],
    out: Path,
    *,
    workers: int = 1,
    on_episode: Callable[[Episode], None] | None = None,
) -> list[Episode]:
    """Evaluate; returns the episodes in the order of the seeds.

    Args:
        protocol: what is evaluated.
        seeds: one episode each.
        out: folder of ``protocol.json`` and ``episodes.jsonl``; episodes found there are not run again.
        workers: processes; 1 stays in this one.
        on_episode: called with each episode as it ends, for a progress bar.

    Raises:
        EvaluationError: ``out`` holds episodes of another protocol, or workers < 1.
    """
    if workers < 1:
        raise EvaluationError(f"workers={workers}: must be at least 1")
    out.mkdir(parents=True, exist_ok=True)
    _claim(out / "protocol.json", asdict(protocol))
    journal = out / "episodes.jsonl"
    done = {episode.seed: episode for episode in read_episodes(journal)}
    missing = [seed for seed in seeds if seed not in done]
    for episode in _run_missing(protocol, missing, workers):
        with journal.open("a") as file:
            file.write(json.dumps(asdict(episode)) + "\n")
            file.flush()
            os.fsync(file.fileno())
        done[episode.seed] = episode
        if on_episode is not None:
            on_episode(episode)
    return [done[seed] for seed in seeds]


def read_episodes(journal: Path) -> list[Episode]:
    """The episodes of an ``episodes.jsonl``; a last line that was cut off by a crash is dropped from the file."""
    if not journal.exists():
        return []
    lines = journal.read_bytes().splitlines(keepends=True)
    if lines and not lines[-1].endswith(b"\n"):
        lines.pop()
        temporary = journal.with_suffix(".tmp")
        temporary.write_bytes(b"".join(lines))
        os.replace(temporary, journal)
    return [Episode(**json.loads(line)) for line in lines]


def _claim(path: Path, content: dict[str, Any]) -> None:
    text = json.dumps(content, indent=2, sort_keys=True)
    if path.exists():
        if path.read_text() != text:
            raise EvaluationError(f"{path} describes another evaluation: choose another output folder, or remove it")
        return
    temporary = path.with_suffix(".tmp")
    temporary.write_text(text)
    os.replace(temporary, path)


def _run_missing(protocol: Protocol, seeds: Sequence[int], workers: int) -> Iterable[Episode]:
    if workers == 1 or len(seeds) < 2:
        if seeds:
            _start_worker(protocol)
        for seed in seeds:
            yield _run_seed(seed)
        return
    context = multiprocessing.get_context("spawn")  # the renderer does not survive a fork
    pool = ProcessPoolExecutor(min(workers, len(seeds)), context, _start_worker, (protocol,))
    try:
        for future in as_completed([pool.submit(_run_seed, seed) for seed in seeds]):
            yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)  # after Ctrl-C do not wait for the rest


_worker: dict[str, Any] = {}


def _start_worker(protocol: Protocol) -> None:
    import torch

    torch.set_num_threads(1)  # two threads on a busy machine make a small network thirty times slower
    _worker["env"] = protocol.make_env()
    _worker["policy"] = protocol.make_policy()


def _run_seed(seed: int) -> Episode:
    return run_episode(_worker["env"], _worker["policy"], seed)


# ------------------------------------------------------------------------------------------------------- numbers


def wilson_interval(successes: int, n: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's score interval of a proportion, 95 % by default: Wilson (1927), as in Brown, Cai and DasGupta (2001)."""
    if not 0 <= successes <= n or n == 0:
        raise EvaluationError(f"{successes} successes of {n}: no proportion")
    p = successes / n
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    # At the ends the formula is exact but its arithmetic is not.
    return (0.0 if successes == 0 else centre - half, 1.0 if successes == n else centre + half)


def summarise(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Counts, shares and Wilson intervals of each outcome, in all and for each asked-for class; reasons; stage times
    [ms].
    """

    def shares(chosen: Sequence[Episode]) -> dict[str, Any]:
        counts = Counter(episode.outcome for episode in chosen)
        n = len(chosen)
        return {
            name: {"count": counts[name], "share": counts[name] / n, "interval": wilson_interval(counts[name], n)}
            for name in OUTCOMES
        }

    targets = sorted({episode.target for episode in episodes})
    stages: dict[str, list[float]] = {}
    for episode in episodes:
        for name, seconds in episode.stages.items():
            stages.setdefault(name, []).append(1e3 * seconds)
    return {
        "episodes": len(episodes),
        "outcomes": shares(episodes),
        "by_class": {name: shares([e for e in episodes if e.target == name]) for name in targets},
        "reasons": dict(Counter(e.reason for e in episodes if e.reason is not None)),
        "failures": dict(Counter(text for e in episodes for text in e.failures)),
        "mean_steps": float(np.mean([e.steps for e in episodes])),
        "stage_ms": {
            name: {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}
            for name, values in sorted(stages.items())
        },
    }


def table(summary: dict[str, Any]) -> str:
    """A short table of a summary for people."""
    lines = [f"{summary['episodes']} episodes, {summary['mean_steps']:.0f} steps on average"]
    for name, row in summary["outcomes"].items():
        if row["count"]:
            low, high = row["interval"]
            lines.append(f"{name:<14}{row['count']:>5}  {row['share']:>6.1%}  [{low:.1%}, {high:.1%}]")
    lines += [
        f"{name:<14}{row['median']:>8.1f} ms  p95 {row['p95']:.1f} ms" for name, row in summary["stage_ms"].items()
    ]
    return "\n".join(lines)
