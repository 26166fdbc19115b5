"""The cells of an evaluation side by side: one table in Markdown and one as CSV, with an interval at every share."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from pec.common.run_identity import flat_settings
from pecgrasp_env.common.outcomes import OUTCOME_WORDS, OUTCOMES, RARE
from pecgrasp_env.evaluation.episode import Episode
from pecgrasp_env.evaluation.grid import Cell, read_cells
from pecgrasp_env.evaluation.paired_tests import ALL, Comparison, compare
from pecgrasp_env.evaluation.summary import lifted, lifted_at_once, share, summarise

FIRST_TRY = "lifted, and no try failed before"
BY_VISIBLE_SHARE = "Lifted, by how much of the asked-for object was seen at the start"
_WHOLE = 0.9  # seen so far, an object counts as whole


@dataclass(frozen=True)
class Evaluation:
    """All cells of a folder, in the order of the tables, and the planners paired, by what they lifted at whichever try
    and by what at the first one.

    reference: the planner that the others are compared with, and that stands first. published: figures of others, in %,
    by their name and then by scene. notes: sentences below the tables. one_kind: whether all scenes together mean
    something; they do not where some differ in more than their name says.
    """

    title: str
    cells: Sequence[Cell]
    comparisons: Sequence[Comparison]
    first_try_comparisons: Sequence[Comparison]
    reference: str
    published: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    notes: Sequence[str] = ()
    one_kind: bool = True

    @property
    def scenes(self) -> list[str]:
        return list(dict.fromkeys(cell.scene for cell in self.cells))

    @property
    def rows(self) -> list[str]:
        """The scenes, and `ALL` where that says more."""
        return [*self.scenes, ALL] if self.one_kind and len(self.scenes) > 1 else self.scenes

    @property
    def planners(self) -> list[str]:
        return sorted({cell.planner for cell in self.cells}, key=lambda name: (name != self.reference, name))

    def episodes(self, scene: str, planner: str) -> list[Episode]:
        """Of one cell, or of `ALL` scenes."""
        chosen = [c for c in self.cells if c.planner == planner and scene in (c.scene, ALL)]
        return [episode for cell in chosen for episode in cell.episodes]


def read_evaluation(folder: str | os.PathLike[str], table: Mapping[str, Any]) -> Evaluation:
    """The cells in `folder` that the present code made. table: title, published, notes and reference, a planner."""
    scenes = [scene for figures in table["published"].values() for scene in figures]
    reference = table["reference"]

    def order(cell: Cell) -> tuple[Any, ...]:
        known = cell.scene.split(",")[0]
        place = scenes.index(known) if known in scenes else len(scenes)
        return place, _natural(cell.scene), cell.planner != reference, cell.planner, cell.key

    found = read_cells(folder)
    cells = sorted(_told_apart(found), key=order)
    one_kind = {(cell.scene, cell.planner) for cell in found} == {(cell.scene, cell.planner) for cell in cells}

    def paired(won: Callable[[Episode], bool]) -> list[Comparison]:
        return [each for each in compare(cells, reference, won) if one_kind or each.scene != ALL]

    return Evaluation(
        table["title"],
        cells,
        paired(lifted),
        paired(lifted_at_once),
        reference,
        table["published"],
        table["notes"],
        one_kind,
    )


def _told_apart(cells: Sequence[Cell]) -> list[Cell]:
    """Cells of one name that are not of one kind get what they differ in beside it, so that no row mixes them."""
    result = []
    for cell in cells:
        alike = [flat_settings(other.settings) for other in cells if other.scene == cell.scene]
        beside = [name for name in alike[0] if name not in ("episodes", "sockets") and not name.startswith("planner.")]
        differing = [name for name in beside if len({str(each.get(name)) for each in alike}) > 1]
        settings = "".join(f", {name}={flat_settings(cell.settings).get(name)}" for name in differing)
        result.append(replace(cell, scene=cell.scene + settings))
    names = Counter((cell.scene, cell.planner) for cell in result)
    # Other parameters of one planner, or another classifier at the same place.
    return [
        replace(cell, planner=f"{cell.planner} {cell.key[:4]}") if names[cell.scene, cell.planner] > 1 else cell
        for cell in result
    ]


def _natural(text: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", text)]


# ----------------------------------------------------------------------------------------------------- Markdown


def markdown(evaluation: Evaluation) -> str:
    """Success by scene and planner; every outcome; the pairs; the times; the reasons."""
    parts = [f"# {evaluation.title}", "", *_success(evaluation, lifted_words(evaluation.cells), lifted)]
    parts += ["", *_success(evaluation, "at the first try", lifted_at_once)]
    parts += ["", "## What happened", "", *_outcomes(evaluation.cells)]
    if hidden := hidden_cells(evaluation.cells):
        parts += ["", f"## {BY_VISIBLE_SHARE}", "", *_by_visible_share(hidden)]
    if evaluation.comparisons:
        parts += ["", "## Planners on the same scenes", "", *_comparisons(evaluation.comparisons, "lifted it")]
        parts += ["", *_comparisons(evaluation.first_try_comparisons, "at the first try")]
    parts += ["", "## Time of a call, ms: median / 95 %", "", *_times(evaluation.cells)]
    parts += ["", "## Reasons", "", *_reasons(evaluation.cells)]
    parts += ["", "Shares in %, with Wilson's 95 % interval in brackets.", *evaluation.notes]
    return "\n".join(parts) + "\n"


def _success(evaluation: Evaluation, title: str, won: Callable[[Episode], bool]) -> list[str]:
    planners, published = evaluation.planners, evaluation.published
    lines = _head([title, *planners, *(f"published: {name}" for name in published)])
    for scene in evaluation.rows:
        fields = [scene.replace("_", " ")]
        for planner in planners:
            episodes = evaluation.episodes(scene, planner)
            fields.append(_counted(sum(map(won, episodes)), len(episodes)))
        for figures in published.values():
            mean = sum(figures.values()) / len(figures) if figures else None
            figure = mean if scene == ALL else figures.get(scene)
            fields.append("–" if figure is None else f"{figure:.3g}")
        lines.append(_row(fields))
    return lines


def _counted(count: int, n: int) -> str:
    return f"{share_of(share(count, n))}, n = {n}" if n else "–"


def share_of(share: Mapping[str, Any]) -> str:
    """ "97.5 (94.3–98.9)": share and interval in %, of a summary."""
    low, high = share["interval"]
    return f"{100 * share['share']:.1f} ({100 * low:.1f}–{100 * high:.1f})"


def shown_outcomes(cells: Sequence[Cell]) -> list[str]:
    """All but those that cannot happen in these cells."""
    happened = {episode.outcome for cell in cells for episode in cell.episodes}
    return [name for name in OUTCOMES if name not in RARE or happened & set(RARE)]


def lifted_words(cells: Sequence[Cell]) -> str:
    """What counts as right in these cells."""
    return "right object lifted" + (
        ", or rightly said not to be there" if set(RARE) & set(shown_outcomes(cells)) else ""
    )


def _outcomes(cells: Sequence[Cell]) -> list[str]:
    shown = shown_outcomes(cells)
    words = [OUTCOME_WORDS[name][0] for name in shown]
    head = ["scene", "planner", "episodes", *words, FIRST_TRY]
    lines = _head([*head, "another object moved, mm: median / 95 %", "steps"])
    for cell in cells:
        fields = [cell.scene.replace("_", " "), cell.planner, progress_of(cell)]
        if cell.episodes:
            summary = summarise(cell.episodes)
            moved = summary["disturbance_mm"]
            fields += [share_of(summary["outcomes"][name]) for name in shown]
            fields.append(share_of(summary["first_try"]))
            fields.append("–" if moved is None else f"{moved['median']:.1f} / {moved['p95']:.1f}")
            fields.append(f"{summary['mean_steps']:.0f}")
        else:
            fields += ["–"] * (len(shown) + 3)
        lines.append(_row(fields))
    return lines


def hidden_cells(cells: Sequence[Cell]) -> list[Cell]:
    """Those in which something hid a part of an asked-for object at the start."""
    return [
        cell for cell in cells if any(e.visible_share is not None and e.visible_share < _WHOLE for e in cell.episodes)
    ]


def visible_head() -> list[str]:
    """The columns of `visible_row`."""
    return ["scene", "planner", *(f"{k / 10:.1f} … {(k + 1) / 10:.1f}" for k in range(10)), "at least a half"]


def visible_row(cell: Cell) -> list[str]:
    """A cell's successes by how much of the asked-for object was seen: "7 of 9", and at last with its interval."""
    summary = summarise(cell.episodes)
    tenths = [f"{each['count']} of {each['n']}" if each else "–" for each in summary["by_visible_share"].values()]
    half = summary["half_visible"]
    counted = f"{share_of(half)}, n = {half['n']}" if half else "–"
    return [cell.scene.replace("_", " "), cell.planner, *tenths, counted]


def _by_visible_share(cells: Sequence[Cell]) -> list[str]:
    return [*_head(visible_head()), *(_row(visible_row(cell)) for cell in cells)]


def progress_of(cell: Cell) -> str:
    """How many episodes there are, and of how many where some are missing."""
    done = len(cell.episodes)
    return str(done) if done == cell.wanted else f"{done} of {cell.wanted}"


def _comparisons(comparisons: Sequence[Comparison], what: str) -> list[str]:
    head = ["scene", "first", "second", f"both {what}", "only first", "only second", "neither"]
    lines = _head([*head, "first − second, points", "p, McNemar exact"])
    for each in comparisons:
        counts = (each.both, each.only_first, each.only_second, each.neither)
        fields = [each.scene.replace("_", " "), each.first, each.second, *map(str, counts)]
        lines.append(_row([*fields, f"{100 * each.difference:+.1f}", p_value(each.p)]))
    return lines


def p_value(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"


def _times(cells: Sequence[Cell]) -> list[str]:
    summaries = {cell.key: summarise(cell.episodes)["stage_ms"] for cell in cells if cell.episodes}
    stages = list(dict.fromkeys(stage for times in summaries.values() for stage in times))
    lines = _head(["scene", "planner", *stages])
    for cell in cells:
        times = summaries.get(cell.key, {})
        values = [f"{times[s]['median']:.1f} / {times[s]['p95']:.1f}" if s in times else "–" for s in stages]
        lines.append(_row([cell.scene.replace("_", " "), cell.planner, *values]))
    return lines


def _reasons(cells: Sequence[Cell]) -> list[str]:
    lines = []
    for cell in cells:
        where = f"{cell.scene.replace('_', ' ')}, {cell.planner}"
        if cell.error is not None:
            lines.append(f"- {where}: stopped by {cell.error}")
        if cell.episodes:
            summary = summarise(cell.episodes)
            for title, counts in (("gave up", summary["reasons"]), ("a try failed", summary["failures"])):
                if counts:
                    reasons = "; ".join(f"{text} × {count}" for text, count in counts.items())
                    lines.append(f"- {where}, {title}: {reasons}")
    return lines or ["None."]


def _head(names: Sequence[str]) -> list[str]:
    return [_row(names), _row(["---"] * len(names))]


def _row(fields: Sequence[str]) -> str:
    return f"| {' | '.join(field.replace('|', '/') for field in fields)} |"


# --------------------------------------------------------------------------------------------------- CSV and JSON


def as_csv(cells: Sequence[Cell]) -> str:
    """A line a cell."""
    text = io.StringIO()
    shares = [f"{name}{suffix}" for name in (*OUTCOMES, "first_try") for suffix in ("", "_low", "_high")]
    names = ["scene", "planner", "episodes", "wanted", *shares]
    names += ["disturbance_median_mm", "disturbance_p95_mm", "mean_steps", "stage_ms", "by_visible_share"]
    names += ["error", "settings"]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for cell in cells:
        line: dict[str, Any] = {"scene": cell.scene, "planner": cell.planner, "episodes": len(cell.episodes)}
        line |= {"wanted": cell.wanted, "error": cell.error, "settings": json.dumps(cell.settings, sort_keys=True)}
        if cell.episodes:
            summary = summarise(cell.episodes)
            for name, row in (summary["outcomes"] | {"first_try": summary["first_try"]}).items():
                line |= {name: row["share"], f"{name}_low": row["interval"][0], f"{name}_high": row["interval"][1]}
            moved = summary["disturbance_mm"] or {}
            line |= {"disturbance_median_mm": moved.get("median"), "disturbance_p95_mm": moved.get("p95")}
            line |= {"mean_steps": summary["mean_steps"], "stage_ms": json.dumps(summary["stage_ms"])}
            line["by_visible_share"] = json.dumps(summary["by_visible_share"])
        writer.writerow(line)
    return text.getvalue()


def as_results(evaluation: Evaluation) -> dict[str, Any]:
    """What results.json holds: a summary a cell, the planners over all scenes, and the pairs."""
    return {
        "title": evaluation.title,
        "cells": [
            {
                "scene": cell.scene,
                "planner": cell.planner,
                "wanted": cell.wanted,
                "error": cell.error,
                "folder": f"cells/{cell.key}",
                "settings": cell.settings,
                **(summarise(cell.episodes) if cell.episodes else {"episodes": 0}),
            }
            for cell in evaluation.cells
        ],
        "all_scenes": {
            planner: summarise(episodes)
            for planner in evaluation.planners
            if evaluation.one_kind and (episodes := evaluation.episodes(ALL, planner))
        },
        "comparisons": _as_rows(evaluation.comparisons),
        "first_try_comparisons": _as_rows(evaluation.first_try_comparisons),
    }


def _as_rows(comparisons: Sequence[Comparison]) -> list[dict[str, Any]]:
    return [asdict(each) | {"difference": each.difference, "p": each.p} for each in comparisons]
