"""What many episodes come to: counts, shares and intervals of each outcome, reasons, times."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from pec.metrics.proportions import wilson_interval
from pecgrasp_env.common.outcomes import OUTCOMES, RIGHT
from pecgrasp_env.evaluation.episode import Episode


def lifted(episode: Episode) -> bool:
    """Whether the right object was lifted, at whichever try, or rightly said not to be there."""
    return episode.outcome in RIGHT


def lifted_at_once(episode: Episode) -> bool:
    """The same, and no try failed before."""
    return lifted(episode) and (not episode.failures or episode.outcome == "absent")


def summarise(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Counts, shares and Wilson intervals of each outcome, in all and for each asked-for class; reasons; times [ms].

    `lifted_or_absent` counts the right ones: the asked-for object lifted, or rightly said not to be there.
    `first_try` counts successes before which no try failed. `reasons` are those of giving up, `failures` those of
    single tries; numbers in them are replaced by #. `by_visible_share` has the successes by how much of the asked-for
    object was seen at the start, "0.3" from 0.3 to below 0.4, the last one with 1.0, and `half_visible` those with at
    least a half; None where there are no such episodes.
    """
    targets = sorted({episode.target for episode in episodes if episode.outcome != "error"})
    seen = [episode for episode in episodes if episode.visible_share is not None]
    disturbances = [1000 * e.disturbance_m for e in episodes if e.disturbance_m is not None]
    return {
        "episodes": len(episodes),
        "outcomes": _shares(episodes),
        "lifted_or_absent": share(sum(map(lifted, episodes)), len(episodes)),
        "first_try": share(sum(map(lifted_at_once, episodes)), len(episodes)),
        "by_class": {name: _shares([e for e in episodes if e.target == name]) for name in targets},
        "by_visible_share": {f"0.{k}": _lifted_share([e for e in seen if _tenth(e) == k]) for k in range(10)},
        "half_visible": _lifted_share([e for e in seen if _tenth(e) >= 5]),
        "reasons": _counts([e.reason for e in episodes if e.reason is not None]),
        "failures": _counts([text for e in episodes for text in e.failures]),
        "mean_steps": float(np.mean([e.steps for e in episodes])),
        "disturbance_mm": _spread(disturbances) if disturbances else None,
        "stage_ms": {name: _spread(values) for name, values in _milliseconds(episodes).items()},
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


def _tenth(episode: Episode) -> int:
    return min(int(10 * (episode.visible_share or 0.0)), 9)


def _lifted_share(episodes: Sequence[Episode]) -> dict[str, Any] | None:
    return {"n": len(episodes), **share(sum(map(lifted, episodes)), len(episodes))} if episodes else None


def _shares(episodes: Sequence[Episode]) -> dict[str, Any]:
    counts = Counter(episode.outcome for episode in episodes)
    return {name: share(counts[name], len(episodes)) for name in OUTCOMES}


def share(count: int, n: int) -> dict[str, Any]:
    """A count, its share of n, and Wilson's 95 % interval of that."""
    return {"count": count, "share": count / n, "interval": list(wilson_interval(count, n))}


def _counts(texts: Sequence[str]) -> dict[str, int]:
    return dict(Counter(re.sub(r"-?\d+(\.\d+)?", "#", text) for text in texts).most_common())


def _milliseconds(episodes: Sequence[Episode]) -> dict[str, list[float]]:
    stages: dict[str, list[float]] = {}
    for episode in episodes:
        for name, seconds in episode.stages.items():
            stages.setdefault(name, []).extend(1000 * each for each in seconds)
    return stages


def _spread(values: Sequence[float]) -> dict[str, float]:
    return {
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95)),
        "most": float(max(values)),
        "n": len(values),
    }
