"""The report of a run of selective episodes as one HTML file: figures to turn around, charts, and how to repeat it.

Nothing is loaded from elsewhere, except that the film, where there is one, is a file beside the report.
"""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

import numpy as np
from PIL import Image

from grasping import ROBOTIQ_2F_140, Gripper
from grasping.viewer.figure import Layer, fragment
from grasping.viewer.html import page
from pec.common.atomic_files import write_whole
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import bars, confusion_matrix, curves, number
from pec.statistics import wilson_interval
from pecgrasp_env.demo.episode_record import EpisodeRecord
from pecgrasp_env.evaluation.episode import OUTCOME_WORDS

UP = (0.0, 0.0, 1.0)  # of the robot's base frame, in which records are
_FIGURE_POINTS = 12_000  # 60 kB a figure


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
    style = (files("pecgrasp_env.common") / "report.css").read_text(encoding="utf-8")
    body = [
        f"<header><h1>{_esc(record.title)}</h1><p>{_esc(record.introduction)}</p></header>",
        _tiles(record),
        _strip(record.episodes),
        _film(record),
        _classifier(record.classifier),
        _timings(record),
        _episodes(record, gripper),
        _reproduction(record),
    ]
    return page(record.title, "\n".join(part for part in body if part), style=style)


def _tiles(record: ReportRecord) -> str:
    n = len(record.episodes)
    tiles = []
    for outcomes, words in (
        (("success",), "asked-for object lifted"),
        (("wrong_object", "off_table"), "wrong object lifted, or any pushed off"),
    ):
        count = sum(each.episode.outcome in outcomes for each in record.episodes)
        value = f"{count}/{n}" if n else "–"
        note = "no episode was run"
        if n:
            low, high = wilson_interval(count, n)
            note = f"{100 * count / n:.0f}&nbsp;%, 95&nbsp;% interval {100 * low:.0f}–{100 * high:.0f}&nbsp;%"
        tiles.append((value, f"{words}<br>{note}"))
    if record.classifier is not None:
        total = int(record.classifier.confusion.sum())
        tiles.append((f"{100 * record.classifier.accuracy:.1f} %", f"test clouds classified right<br>of {total:,}"))
    times = stage_times(record.episodes)
    if times:
        seconds = sum(median for median, _, _ in times.values())
        tiles.append(
            (f"{number(1000 * seconds)} ms", f"from depth frame to motion<br>{_esc(', '.join(times))}; medians added")
        )
    if record.durations:
        parts = ", ".join(f"{name} {_clock(seconds)}" for name, seconds in record.durations.items())
        tiles.append((_clock(sum(record.durations.values())), _esc(parts)))
    inner = "".join(f'<div class="tile"><b>{value}</b><span>{note}</span></div>' for value, note in tiles)
    return f'<div class="tiles">{inner}</div>'


def _strip(records: Sequence[EpisodeRecord]) -> str:
    links = []
    for number_, record in enumerate(records, 1):
        words, tone = OUTCOME_WORDS[record.episode.outcome]
        title = _esc(f"{record.episode.target}: {words}")
        links.append(f'<li><a class="{tone}" href="#episode-{number_}" title="{title}">{number_}</a></li>')
    return f'<ul class="strip" aria-label="episodes">{"".join(links)}</ul>' if links else ""


def _film(record: ReportRecord) -> str:
    if record.film is None:
        return ""
    name = _esc(record.film)
    pictures = (_jpeg(each.picture) for each in record.episodes if each.picture is not None)
    poster = next((f' poster="{data}"' for data in pictures), "")
    return (
        f'<h2>Film</h2><video controls preload="none"{poster} src="{name}"></video><p><a href="{name}">{name}</a></p>'
    )


def _classifier(record: ClassifierRecord | None) -> str:
    if record is None:
        return ""
    drawn = confusion_matrix(record.confusion, [_name(each) for each in record.classes])
    matrix = inline_svg(drawn, "confusion matrix of the classifier")
    charts = [
        f"<figure><figcaption>True class by row, prediction by column; training saw none of these clouds.</figcaption>"
        f"{matrix}</figure>"
    ]
    line = inline_svg(curves(record.curves), "accuracy over epochs")
    if line:
        charts.append(f"<figure><figcaption>Accuracy over the epochs of training.</figcaption>{line}</figure>")
    note = f"<p>{_esc(record.note)}</p>" if record.note else ""
    return f'<h2>Classification</h2>{note}<div class="charts">{"".join(charts)}</div>'


def _timings(record: ReportRecord) -> str:
    times = stage_times(record.episodes)
    if not times:
        return ""
    rows = [(name, 1000 * median, 1000 * most) for name, (median, most, _) in times.items()]
    calls = ", ".join(f"{name} {count}" for name, (_, _, count) in times.items())
    return (
        f"<h2>Time of each stage</h2><p>Bars: median; dots: the slowest call. One frame a call, one core. "
        f"Calls: {_esc(calls)}.</p>{inline_svg(bars(rows, 'ms'), 'time of each stage')}"
    )


def _episodes(record: ReportRecord, gripper: Gripper) -> str:
    if not record.episodes:
        return "<h2>Episodes</h2><p>No episode was run.</p>"
    sections = [_episode(k, each, record.film, gripper) for k, each in enumerate(record.episodes, 1)]
    return "<h2>Episodes</h2>" + "\n".join(sections)


def _episode(number_: int, record: EpisodeRecord, film: str | None, gripper: Gripper) -> str:
    episode = record.episode
    words, tone = OUTCOME_WORDS[episode.outcome]
    head = (
        f"<h3>Episode {number_}: the {_esc(_name(episode.target))} was asked for"
        f'<span class="badge {tone}">{words}</span></h3>'
    )
    told = [_esc(f"on the table: {', '.join(episode.objects)}")]
    told += [f"{episode.steps} control steps", f"seed {episode.seed}"]
    if film is not None and record.film_second is not None:
        second = record.film_second
        told.append(
            f'<a href="{_esc(film)}#t={second:.1f}">in the film at {int(second // 60)}:{int(second % 60):02d}</a>'
        )
    why = ""
    if episode.failures:
        failures = _esc("; ".join(f"{k}. {text}" for k, text in enumerate(episode.failures, 1)))
        why = f"<p>{'Gave up after' if episode.reason else 'Failed tries'}: {failures}.</p>"
    columns = [f"<div>{_picture(number_, record)}{_seen(record)}</div>", _figure(record, gripper)]
    return (
        f'<section class="episode" id="episode-{number_}">{head}{why}<p class="why">{" · ".join(told)}</p>'
        f'<div class="pair">{"".join(columns)}</div></section>'
    )


def _picture(number_: int, record: EpisodeRecord) -> str:
    if record.picture is None:
        return ""
    return f'<img alt="the scene of episode {number_}" src="{_jpeg(record.picture)}">'


def _jpeg(picture: np.ndarray) -> str:
    buffer = io.BytesIO()
    Image.fromarray(np.asarray(picture, dtype=np.uint8)).save(buffer, "JPEG", quality=85)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _figure(record: EpisodeRecord, gripper: Gripper) -> str:
    layers = [
        Layer(
            seen.points,
            f"{_name(seen.label)} {100 * seen.confidence:.1f} %" + (" (chosen)" if seen.chosen else ""),
            (f"{len(seen.points)} points", f"asked for: {_name(record.episode.target)}"),
        )
        for seen in record.objects
    ]
    cloud = record.cloud
    if not (cloud is not None and np.isfinite(cloud).all(axis=1).any()):
        cloud = None
    if cloud is None and not any(len(layer.points) for layer in layers):
        return ""
    return (
        f"<div>{fragment(record.plan, cloud, gripper=gripper, layers=layers, up=UP, max_points=_FIGURE_POINTS)}</div>"
    )


def _seen(record: EpisodeRecord) -> str:
    if not record.objects:
        return '<p class="why">No object was found on the table.</p>'
    rows = "".join(
        f'<tr class="{"chosen" if seen.chosen else ""}">'
        f"<td>{_esc(_name(seen.label))}{' ← chosen' if seen.chosen else ''}</td>"
        f'<td class="right">{100 * seen.confidence:.1f} %</td><td class="right">{len(seen.points):,}</td></tr>'
        for seen in record.objects
    )
    head = '<tr><th>classified as</th><th class="right">confidence</th><th class="right">points</th></tr>'
    return f'<div class="scroll"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>'


def _reproduction(record: ReportRecord) -> str:
    parts = []
    if record.commands:
        parts.append(f"<pre>{_esc(chr(10).join(record.commands))}</pre>")
    if record.episodes:
        parts.append(f"<p>Seeds of the episodes: {', '.join(str(each.episode.seed) for each in record.episodes)}.</p>")
    if record.versions:
        rows = "".join(
            f"<tr><td>{_esc(name)}</td><td>{_esc(value)}</td></tr>" for name, value in record.versions.items()
        )
        parts.append(f'<div class="scroll"><table><tbody>{rows}</tbody></table></div>')
    if record.configuration:
        parts.append(f"<details><summary>Configuration</summary><pre>{_esc(record.configuration)}</pre></details>")
    return f"<h2>To repeat this</h2>{''.join(parts)}" if parts else ""


def _clock(seconds: float) -> str:
    return f"{int(seconds // 60)}:{int(seconds % 60):02d} min" if seconds >= 60 else f"{seconds:.0f} s"


def _name(class_name: str) -> str:
    return class_name.replace("_", " ")


def _esc(text: object) -> str:
    return html.escape(str(text))
