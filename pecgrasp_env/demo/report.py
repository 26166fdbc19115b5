"""The report of a run of selective episodes as one HTML file: figures to turn around, charts, and how to repeat it.

Nothing is loaded from elsewhere, except that the film, where there is one, is a file beside the report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from grasping import ROBOTIQ_2F_140, Gripper
from grasping.viewer.figure import Layer, fragment
from pec.common.atomic_files import write_whole
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import bars, confusion_matrix, curves, number
from pecgrasp_env.common.html_report import Share, Tile, jpeg_uri, report_page
from pecgrasp_env.common.outcomes import OUTCOME_WORDS
from pecgrasp_env.demo.episode_record import EpisodeRecord

UP = (0.0, 0.0, 1.0)  # of the robot's base frame, in which records are
_FIGURE_POINTS = 12_000  # 60 kB a figure
_PERCENT = "\N{NO-BREAK SPACE}%"


@dataclass(frozen=True)
class ClassifierRecord:
    """confusion: (C, C) int counts over test clouds, row = true class. curves: shares over epochs, by name."""

    classes: Sequence[str]
    confusion: np.ndarray
    curves: Mapping[str, Sequence[float]] = field(default_factory=dict)
    note: str = ""

    @property
    def accuracy(self) -> float:
        return float(np.trace(self.confusion) / max(1, self.confusion.sum()))


@dataclass(frozen=True)
class ReportRecord:
    """Everything the report shows. durations: seconds of each part of the run. film: a file name beside the report."""

    title: str
    introduction: str
    episodes: Sequence[EpisodeRecord]
    classifier: ClassifierRecord | None = None
    durations: Mapping[str, float] = field(default_factory=dict)
    configuration: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    commands: Sequence[str] = ()
    film: str | None = None


def stage_times(episodes: Sequence[EpisodeRecord]) -> dict[str, tuple[float, float, int]]:
    """Median seconds, largest seconds and number of calls of each stage, over all episodes."""
    calls: dict[str, list[float]] = {}
    for episode in episodes:
        for stage, seconds in episode.episode.stages.items():
            calls.setdefault(stage, []).extend(seconds)
    return {name: (float(np.median(each)), max(each), len(each)) for name, each in calls.items() if each}


def write_report(path: Path, record: ReportRecord, gripper: Gripper = ROBOTIQ_2F_140) -> None:
    """Writes the report to `path`, whole or not at all."""
    write_whole(path, render(record, gripper))


def render(record: ReportRecord, gripper: Gripper = ROBOTIQ_2F_140) -> str:
    """The report as an HTML document."""
    times = stage_times(record.episodes)
    pictures = (each.picture for each in record.episodes if each.picture is not None)
    poster = next(pictures, None)
    rows = [(name, 1000 * median, 1000 * most) for name, (median, most, _) in times.items()]
    return report_page(
        "pecgrasp_env.demo",
        "report",
        record.title,
        record=record,
        summary=_tiles(record, times),
        outcome_words=OUTCOME_WORDS,
        poster=None if poster is None else jpeg_uri(poster),
        classifier_charts=() if record.classifier is None else _classifier_charts(record.classifier),
        times=times,
        times_chart=inline_svg(bars(rows, "ms"), "time of each stage"),
        figure=lambda each: _figure(each, gripper),
        jpeg_uri=jpeg_uri,
    )


def _tiles(record: ReportRecord, times: Mapping[str, tuple[float, float, int]]) -> list[Tile]:
    n = len(record.episodes)
    tiles = []
    for outcomes, words in (
        (("success",), "asked-for object lifted"),
        (("wrong_object", "stranger", "off_table"), "wrong object lifted, or any pushed off"),
    ):
        share = Share(sum(each.episode.outcome in outcomes for each in record.episodes), n)
        note = "no episode was run"
        if n:
            note = f"{share.percent:.0f} %, 95 % interval {share.low:.0f}–{share.high:.0f} %".replace(" %", _PERCENT)
        tiles.append(Tile(f"{share.count}/{n}" if n else "–", (words, note)))
    if record.classifier is not None:
        total = int(record.classifier.confusion.sum())
        lines = ("test clouds classified right", f"of {total:,}")
        tiles.append(Tile(f"{100 * record.classifier.accuracy:.1f} %", lines))
    if times:
        seconds = sum(median for median, _, _ in times.values())
        lines = ("from depth frame to motion", f"{', '.join(times)}; medians added")
        tiles.append(Tile(f"{number(1000 * seconds)} ms", lines))
    if record.durations:
        parts = ", ".join(f"{name} {_clock(seconds)}" for name, seconds in record.durations.items())
        tiles.append(Tile(_clock(sum(record.durations.values())), (parts,)))
    return tiles


def _classifier_charts(record: ClassifierRecord) -> list[tuple[str, str]]:
    """Caption and SVG of each."""
    matrix = confusion_matrix(record.confusion, [name.replace("_", " ") for name in record.classes])
    return [
        (
            "True class by row, prediction by column; training saw none of these clouds.",
            inline_svg(matrix, "confusion matrix of the classifier"),
        ),
        ("Accuracy over the epochs of training.", inline_svg(curves(record.curves), "accuracy over epochs")),
    ]


def _figure(record: EpisodeRecord, gripper: Gripper) -> str:
    """The clouds, the plan and the gripper of an episode, to turn around."""
    asked_for = f"asked for: {record.episode.target.replace('_', ' ')}"
    layers = [
        Layer(
            seen.points,
            f"{seen.label.replace('_', ' ')} {100 * seen.confidence:.1f} %" + (" (chosen)" if seen.chosen else ""),
            (f"{len(seen.points)} points", asked_for),
        )
        for seen in record.objects
    ]
    cloud = record.cloud
    if not (cloud is not None and np.isfinite(cloud).all(axis=1).any()):
        cloud = None
    if cloud is None and not any(len(layer.points) for layer in layers):
        return ""
    return fragment(record.plan, cloud, gripper=gripper, layers=layers, up=UP, max_points=_FIGURE_POINTS)


def _clock(seconds: float) -> str:
    return f"{int(seconds // 60)}:{int(seconds % 60):02d} min" if seconds >= 60 else f"{seconds:.0f} s"
