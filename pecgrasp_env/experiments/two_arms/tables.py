"""What the episodes of two arms come to: shares with intervals, by kind, and who wins on the same things."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pec.metrics.proportions import mcnemar, wilson_interval
from pecgrasp_env.experiments.two_arms.episode import DualEpisode

TITLES = {"pair": "pair planner", "single": "best single grasp", "random": "two random regions"}


def summarise(episodes: Mapping[str, Sequence[DualEpisode]]) -> dict[str, Any]:
    """methods: a row each; pairs: the first method against each other one, on the same seeds."""
    rows = {method: _row(each) for method, each in episodes.items()}
    first, *others = episodes
    return {"methods": rows, "pairs": [_against(first, other, episodes) for other in others]}


def _row(episodes: Sequence[DualEpisode]) -> dict[str, Any]:
    errors = [each.centre_error for each in episodes if each.centre_error is not None]
    carried = [each for each in episodes if each.outcome == "carried"]
    kinds = sorted({each.kind for each in episodes if each.kind})
    return {
        "episodes": len(episodes),
        "carried": _share([each.outcome == "carried" for each in episodes]),
        "level_without_payload": _share([each.level for each in episodes]),
        "by_kind": {k: _share([each.outcome == "carried" for each in episodes if each.kind == k]) for k in kinds},
        "outcomes": dict(Counter(each.outcome for each in episodes)),
        "worst_tilt_deg": float(np.max([each.worst_tilt for each in carried])) if carried else None,
        "median_tilt_deg": float(np.median([each.worst_tilt for each in carried])) if carried else None,
        "median_centre_error_mm": 1e3 * float(np.median(errors)) if errors else None,
        "median_most_load_n": float(np.median([each.most_load for each in episodes])),
        "mean_steps": float(np.mean([each.steps for each in episodes])),
        "median_policy_s": float(np.median([each.seconds for each in episodes])),
        "reasons": dict(Counter(each.reason for each in episodes if each.reason)),
    }


def _share(won: Sequence[bool]) -> dict[str, Any]:
    low, high = wilson_interval(sum(won), len(won))
    return {"count": sum(won), "n": len(won), "share": sum(won) / len(won), "interval": [low, high]}


def _against(first: str, other: str, episodes: Mapping[str, Sequence[DualEpisode]]) -> dict[str, Any]:
    won = [
        (one.outcome == "carried", two.outcome == "carried")
        for one, two in zip(episodes[first], episodes[other], strict=True)
    ]
    only_first, only_second = won.count((True, False)), won.count((False, True))
    both = won.count((True, True))
    p = mcnemar(only_first, only_second)
    return {
        "first": first,
        "second": other,
        "both": both,
        "only_first": only_first,
        "only_second": only_second,
        "neither": len(won) - both - only_first - only_second,
        "p": p,
    }


def as_markdown(results: Mapping[str, Any]) -> str:
    """The table for people."""
    rows = results["methods"]
    kinds = sorted({kind for row in rows.values() for kind in row["by_kind"]})
    head = ["method", "lifted level and carried", *kinds, "if arms had no payload", "tilt, median and worst"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for method, row in rows.items():
        cells = [TITLES[method], _words(row["carried"])]
        cells += [f"{row['by_kind'][kind]['count']}/{row['by_kind'][kind]['n']}" for kind in kinds]
        tilt = "–" if row["worst_tilt_deg"] is None else f"{row['median_tilt_deg']:.1f}°, {row['worst_tilt_deg']:.1f}°"
        lines.append("| " + " | ".join([*cells, _words(row["level_without_payload"]), tilt]) + " |")
    for pair in results["pairs"]:
        words = f"{TITLES[pair['first']]} against {TITLES[pair['second']]}: only the one {pair['only_first']}"
        lines.append(f"\n{words}, only the other {pair['only_second']}, McNemar p = {pair['p']:.2g}")
    return "\n".join(lines) + "\n"


def _words(share: Mapping[str, Any]) -> str:
    low, high = share["interval"]
    return f"{100 * share['share']:.1f} % ({share['count']}/{share['n']}, {100 * low:.0f}–{100 * high:.0f})"
