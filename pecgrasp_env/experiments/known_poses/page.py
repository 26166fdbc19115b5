"""The page of `pecgrasp evaluate-pose`: how far poses are off, what hiding costs, each object, and what was missed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from grasping.pose.metrics import AUC_TO
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import points_over_axes
from pecgrasp_env.common.html_report import report_page
from pecgrasp_env.experiments.known_poses.run import VISIBLE
from pecgrasp_env.experiments.known_poses.tables import FOUND, MEASURES, Row, in_words, is_right, share_in_words

__all__ = ["render"]

_STEPS = 50  # of a curve
_MOST_MISSES = 200  # that are listed
_BANDS = np.linspace(0, 1, 6)  # of the visible share


def render(rows: Sequence[Row], clouds: Sequence[Mapping[str, Any]], frames: Sequence[Mapping[str, Any]]) -> str:
    """The page, of a run's rows and of what `cloud_results` and `frame_results` made of them."""
    groups = list(dict.fromkeys(each["group"] for each in clouds))
    misses = _misses(rows)
    over_hidden = {f"{group}: MSSD under 10 % of the diameter": _hidden(clouds, group) for group in groups}
    return report_page(
        "pecgrasp_env.experiments",
        "known_poses",
        "Poses of known objects",
        clouds=[
            [e["group"], e["method"], e["n"], e["objects"], *in_words(e), f"{e['median_ms']:.0f} ms"]
            for e in clouds
        ],
        measures=list(MEASURES),
        curves=[(f"{group}: clouds whose ADD-S is less", _curves(rows, group)) for group in groups],
        hidden=[(caption, chart) for caption, chart in over_hidden.items() if chart is not None],
        objects={f"{e['group']}, {e['method']}": _objects(e) for e in clouds},
        frames=[[e["group"], e["kind"], e["frames"], *share_in_words(e), f"{e['median_s']:.2f} s"] for e in frames],
        found=[name.replace("_", " ") for name in FOUND],
        visible=_by_visible_share(rows),
        misses=misses[:_MOST_MISSES],
        left_out=max(0, len(misses) - _MOST_MISSES),
    )  # fmt: skip


def _curves(rows: Sequence[Row], group: str) -> str:
    """Share of a group's clouds with an ADD-S below each limit, a line a method; the area below is the AUC."""
    limits = np.linspace(0, AUC_TO, _STEPS + 1)
    own = [row for row in rows if row["group"] == group and "object" in row]
    series = {}
    for method in dict.fromkeys(row["method"] for row in own):
        off = [np.inf if row["add_s"] is None else row["add_s"] for row in own if row["method"] == method]
        below = (np.array(off) < limits[:, None]).mean(axis=1)
        series[method] = list(zip(1000 * limits, 100 * below, strict=True))
    return inline_svg(points_over_axes(series, x_label="ADD-S, mm", y_label="% of clouds"), group)


def _hidden(clouds: Sequence[Mapping[str, Any]], group: str) -> str | None:
    """What is right over the share that is hidden, a line a method; None where all clouds are hidden alike."""
    series = {
        each["method"]: [(100 * float(np.mean(b["hidden"])), 100 * b["MSSD < 10 %"]) for b in each["by_occlusion"]]
        for each in clouds
        if each["group"] == group
    }
    if max(map(len, series.values())) < 2:
        return None
    return inline_svg(points_over_axes(series, x_label="hidden, %", y_label="% right"), f"{group}, by what is hidden")


def _objects(each: Mapping[str, Any]) -> list[list[str]]:
    """A row an object, the worst first."""
    worst_first = sorted(each["by_object"].items(), key=lambda item: item[1]["MSSD < 10 %"])
    return [[name, str(own["n"]), *(f"{100 * own[m]:.0f} %" for m in MEASURES)] for name, own in worst_first]


def _known(rows: Sequence[Row]) -> list[tuple[Row, Row]]:
    """Frames with each of their known objects."""
    return [(row, thing) for row in rows if "kind" in row for thing in row["objects"] if thing["name"] is not None]


def _by_visible_share(rows: Sequence[Row]) -> list[list[str]]:
    table = []
    for low, high in itertools.pairwise(_BANDS):
        # The last band has what is whole.
        own = [is_right(t) for _, t in _known(rows) if low <= t["visible"] < high or t["visible"] == high == 1]
        if own:
            table.append(
                [f"{100 * low:.0f}–{100 * high:.0f} %", f"{sum(own)} of {len(own)}", f"{100 * np.mean(own):.0f} %"]
            )
    return table


def _misses(rows: Sequence[Row]) -> list[list[str]]:
    """Known objects, at least half visible, that have no right pose, and strangers that have any."""
    missed = [
        [row["case"], row["kind"], thing["name"], _percent(thing["visible"]), thing["given"] or "no pose", _far(thing)]
        for row, thing in _known(rows)
        if thing["visible"] >= VISIBLE and not is_right(thing)
    ]
    return missed + [
        [row["case"], row["kind"], "a stranger", _percent(thing["visible"]), thing["given"], "–"]
        for row in rows
        if "kind" in row
        for thing in row["objects"]
        if thing["name"] is None and thing["given"] is not None
    ]


def _far(thing: Row) -> str:
    return "–" if thing["off"] is None else _percent(thing["off"])


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
