"""What came of the runs: shares and areas with intervals over objects."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from grasping.pose.metrics import DIAMETER_SHARE, NEAR_ENOUGH, auc
from pec.metrics.proportions import wilson_interval
from pecgrasp_env.experiments.known_poses.run import RIGHT, VISIBLE, VSD_LEAST

_DRAWS = 2000
OCCLUSIONS = (0.0, 0.1, 0.2, 0.4, 0.6)

Row = dict[str, Any]


def _error(row: Row, name: str) -> float:
    return np.inf if row[name] is None else float(row[name])


# Of a list of rows a number, by the name of its column.
MEASURES: dict[str, Callable[[Sequence[Row]], float]] = {
    "ADD-S < 2 cm": lambda rows: float(np.mean([_error(r, "add_s") < NEAR_ENOUGH for r in rows])),
    "ADD(-S) < 10 %": lambda rows: float(
        np.mean([_error(r, "add_either") < DIAMETER_SHARE * r["diameter"] for r in rows])
    ),
    "AUC ADD-S": lambda rows: auc([_error(r, "add_s") for r in rows]),
    "MSSD < 10 %": lambda rows: float(np.mean([_error(r, "mssd") < RIGHT * r["diameter"] for r in rows])),
    "no pose": lambda rows: float(np.mean([r["add"] is None for r in rows])),
}


FOUND = (
    "found",
    "found_or_left_open",
    "found_by_vsd",
    "two_of_a_kind_both",
    "two_of_a_kind_both_or_left_open",
    "stranger_given_a_pose",
    "wrong_model",
)
"""The shares among `frame_results`."""


def with_interval(rows: Sequence[Row], measure: Callable[[Sequence[Row]], float]) -> tuple[float, float, float]:
    """A measure and its 95 % interval over objects (percentile bootstrap of whole objects, 2,000 draws)."""
    by_object: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_object[row["object"]].append(row)
    # Every measure is a mean over rows: of each object its sum and its count are enough.
    sums = np.array([measure(own) * len(own) for own in by_object.values()])
    counts = np.array([len(own) for own in by_object.values()])
    drawn = np.random.default_rng(0).integers(len(sums), size=(_DRAWS, len(sums)))
    low, high = np.percentile(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), [2.5, 97.5])
    return measure(rows), float(low), float(high)


def cloud_results(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """A mapping for each group and method: n, objects, each measure with its interval, median time, by occlusion."""
    found = []
    keys = dict.fromkeys((row["group"], row["method"]) for row in rows if "object" in row)
    for group, method in keys:
        own = [row for row in rows if (row["group"], row["method"]) == (group, method)]
        by_occlusion = []
        for low, high in zip(OCCLUSIONS, (*OCCLUSIONS[1:], 1.0), strict=True):
            some = [row for row in own if low <= row["occlusion"] < high]
            if some:
                measures = {name: measure(some) for name, measure in MEASURES.items()}
                by_occlusion.append({"hidden": [low, high], "n": len(some), **measures})
        of_object: dict[str, Any] = {}
        for name in sorted({row["object"] for row in own}):
            some = [row for row in own if row["object"] == name]
            of_object[name] = {"n": len(some), **{key: measure(some) for key, measure in MEASURES.items()}}
        medians = [row["median"] for row in own if row["median"] is not None]
        found.append(
            {
                "group": group,
                "method": method,
                "n": len(own),
                "objects": len(of_object),
                "measures": {name: with_interval(own, measure) for name, measure in MEASURES.items()},
                "median_ms": 1e3 * float(np.median([row["seconds"] for row in own])),
                "median_distance_mm": 1e3 * float(np.median(medians)) if medians else None,
                "within_10_mm": sum(median < 0.01 for median in medians),
                "by_occlusion": by_occlusion,
                "by_object": of_object,
            }
        )
    return found


def frame_results(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """A mapping for each group and kind of scene, and for all kinds together: counts with Wilson's intervals."""
    found = []
    frames = [row for row in rows if "kind" in row]
    for group in dict.fromkeys(row["group"] for row in frames):
        of_group = [row for row in frames if row["group"] == group]
        for kind in (*dict.fromkeys(row["kind"] for row in of_group), None):
            own = [row for row in of_group if kind in (row["kind"], None)]
            known = [o for r in own for o in r["objects"] if o["name"] is not None and o["visible"] >= VISIBLE]
            strangers = [o for r in own for o in r["objects"] if o["name"] is None]
            twins = [pair for row in own for pair in _twins(row)]
            found.append(
                {
                    "group": group,
                    "kind": kind or "all",
                    "frames": len(own),
                    "found": _share([is_right(o) for o in known]),
                    "found_or_left_open": _share([is_left_open(o) for o in known]),
                    "found_by_vsd": _share([_below(o["vsd"], VSD_LEAST) for o in known]),
                    "two_of_a_kind_both": _share([all(map(is_right, pair)) for pair in twins]),
                    "two_of_a_kind_both_or_left_open": _share([all(map(is_left_open, pair)) for pair in twins]),
                    "stranger_given_a_pose": _share([o["given"] is not None for o in strangers]),
                    "wrong_model": _share([o["given"] not in (None, o["name"]) for o in known]),
                    "median_s": float(np.median([row["seconds"] for row in own])),
                }
            )
    return found


def is_right(thing: Row) -> bool:
    """Whether an object of a frame has a pose whose MSSD is below `RIGHT`."""
    return _below(thing["off"], RIGHT)


def is_left_open(thing: Row) -> bool:
    """Whether an object of a frame is where its pose, or one of those that this leaves open, has it."""
    return _below(thing["off_open"], RIGHT)


def _below(error: float | None, most: float) -> bool:
    return error is not None and error < most


def _twins(row: Row) -> list[list[Row]]:
    """The objects of a frame that are of one model, at least half visible, where there are two and more."""
    by_name: dict[str, list[Row]] = defaultdict(list)
    for thing in row["objects"]:
        if thing["name"] is not None and thing["visible"] >= VISIBLE:
            by_name[thing["name"]].append(thing)
    return [own for own in by_name.values() if len(own) > 1]


def _share(right: Sequence[bool]) -> dict[str, Any]:
    if not right:
        return {"count": 0, "n": 0, "share": None, "interval": None}
    count = int(sum(right))
    return {
        "count": count,
        "n": len(right),
        "share": count / len(right),
        "interval": list(wilson_interval(count, len(right))),
    }


def table(clouds: Sequence[dict[str, Any]], frames: Sequence[dict[str, Any]]) -> str:
    """Markdown for people."""
    lines = []
    if clouds:
        lines += ["| clouds | method | n | objects | " + " | ".join(MEASURES) + " | median time |"]
        lines += ["|---|---|---|---|" + "---|" * (len(MEASURES) + 1)]
        for each in clouds:
            head = f"| {each['group']} | {each['method']} | {each['n']} | {each['objects']} | "
            lines.append(head + " | ".join(in_words(each)) + f" | {each['median_ms']:.0f} ms |")
        lines.append("")
    if frames:
        lines += ["| frames | kind | n | " + " | ".join(n.replace("_", " ") for n in FOUND) + " | median time |"]
        lines += ["|---|---|---|" + "---|" * (len(FOUND) + 1)]
        for each in frames:
            head = f"| {each['group']} | {each['kind']} | {each['frames']} | "
            lines.append(head + " | ".join(share_in_words(each)) + f" | {each['median_s']:.2f} s |")
    return "\n".join(lines) + "\n"


def in_words(of_clouds: Mapping[str, Any]) -> list[str]:
    """Each of `MEASURES` with its interval."""
    return [f"{100 * v:.1f} % ({100 * a:.0f}–{100 * b:.0f})" for v, a, b in of_clouds["measures"].values()]


def share_in_words(of_frames: Mapping[str, Any]) -> list[str]:
    """Each of `FOUND` with its interval."""
    return [_words(of_frames[name]) for name in FOUND]


def _words(share: dict[str, Any]) -> str:
    if not share["n"]:
        return "–"
    low, high = share["interval"]
    return f"{share['count']} of {share['n']}, {100 * share['share']:.0f} % ({100 * low:.0f}–{100 * high:.0f})"
