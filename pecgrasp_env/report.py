"""The report of a run of selective episodes as one HTML file: figures to turn around, charts, and how to repeat it.

Nothing is loaded from elsewhere, except that the film, where there is one, is a file beside the report.
"""

from __future__ import annotations

import base64
import html
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

import numpy as np
from PIL import Image

from grasping import ROBOTIQ_2F_140, GraspPlan, Gripper
from grasping.viewer import Layer, fragment, page
from pecgrasp_env.charts import bars, confusion_matrix, curve, number

_WORDS = {"lifted": "lifted", "wrong": "wrong object", "failed": "not lifted"}


@dataclass(frozen=True)
class SeenObject:
    """One object as segmented and classified. points: (M, 3) metres, in the frame of the episode's cloud."""

    points: np.ndarray
    label: str
    confidence: float
    chosen: bool = False


@dataclass(frozen=True)
class EpisodeRecord:
    """What the report tells of one episode.

    outcome: "lifted" (the asked-for class), "wrong" (another class) or "failed". reason: why, where it is not
    "lifted". cloud: (N, 3) metres, everything the camera saw; up: (3,) unit vector in its frame; plan: in its frame.
    picture: (H, W, 3) uint8 or None. stages: seconds of computing a stage, one entry a call. film_second: where the
    episode begins in the film.
    """

    number: int
    seed: int
    target: str
    outcome: str
    reason: str | None = None
    attempts: int = 1
    steps: int = 0
    objects: Sequence[SeenObject] = ()
    cloud: np.ndarray | None = None
    up: np.ndarray | None = None
    plan: GraspPlan | None = None
    picture: np.ndarray | None = None
    stages: Mapping[str, Sequence[float]] = field(default_factory=dict)
    film_second: float | None = None


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
        for stage, seconds in episode.stages.items():
            calls.setdefault(stage, []).extend(seconds)
    return {name: (float(np.median(each)), max(each), len(each)) for name, each in calls.items() if each}


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    centre = (successes + z * z / 2) / (trials + z * z)
    half = z / (trials + z * z) * math.sqrt(successes * (trials - successes) / trials + z * z / 4)
    return max(0.0, centre - half), min(1.0, centre + half)


def write_report(path: Path, record: ReportRecord, gripper: Gripper = ROBOTIQ_2F_140) -> None:
    """Writes the report to `path`, whole or not at all."""
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(render(record, gripper), encoding="utf-8")
    os.replace(temporary, path)


def render(record: ReportRecord, gripper: Gripper = ROBOTIQ_2F_140) -> str:
    """The report as an HTML document."""
    style = (files("pecgrasp_env") / "report.css").read_text(encoding="utf-8")
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
    for outcome, words in (("lifted", "asked-for object lifted"), ("wrong", "wrong object lifted or pushed off")):
        count = sum(episode.outcome == outcome for episode in record.episodes)
        value = f"{count}/{n}" if n else "–"
        note = "no episode was run"
        if n:
            low, high = wilson_interval(count, n)
            note = f"{100 * count / n:.0f} %, 95 % interval {100 * low:.0f}–{100 * high:.0f} %"
        tiles.append((value, f"{words}<br>{note}"))
    if record.classifier is not None:
        total = int(record.classifier.confusion.sum())
        tiles.append((f"{100 * record.classifier.accuracy:.1f} %", f"test clouds classified right<br>of {total:,}"))
    times = stage_times(record.episodes)
    if times:
        seconds = sum(median for median, _, _ in times.values())
        tiles.append(
            (f"{number(1000 * seconds)} ms", f"from frame to grasp<br>{_esc(', '.join(times))}; medians added")
        )
    if record.durations:
        parts = ", ".join(f"{name} {_clock(seconds)}" for name, seconds in record.durations.items())
        tiles.append((_clock(sum(record.durations.values())), _esc(parts)))
    inner = "".join(f'<div class="tile"><b>{value}</b><span>{note}</span></div>' for value, note in tiles)
    return f'<div class="tiles">{inner}</div>'


def _strip(episodes: Sequence[EpisodeRecord]) -> str:
    links = "".join(
        f'<li><a class="{episode.outcome}" href="#episode-{episode.number}" '
        f'title="{_esc(episode.target)}: {_WORDS[episode.outcome]}">{episode.number}</a></li>'
        for episode in episodes
    )
    return f'<ul class="strip" aria-label="episodes">{links}</ul>' if episodes else ""


def _film(record: ReportRecord) -> str:
    if record.film is None:
        return ""
    name = _esc(record.film)
    return f'<h2>Film</h2><video controls preload="none" src="{name}"></video><p><a href="{name}">{name}</a></p>'


def _classifier(record: ClassifierRecord | None) -> str:
    if record is None:
        return ""
    charts = [
        f"<figure><figcaption>True class by row, prediction by column; training saw none of these clouds.</figcaption>"
        f"{confusion_matrix(record.confusion, record.classes)}</figure>"
    ]
    line = curve({name: list(values) for name, values in record.curves.items()}, "accuracy over epochs")
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
        f"Calls: {_esc(calls)}.</p>{bars(rows, 'ms', 'time of each stage')}"
    )


def _episodes(record: ReportRecord, gripper: Gripper) -> str:
    if not record.episodes:
        return "<h2>Episodes</h2><p>No episode was run.</p>"
    return "<h2>Episodes</h2>" + "\n".join(_episode(episode, record.film, gripper) for episode in record.episodes)


def _episode(episode: EpisodeRecord, film: str | None, gripper: Gripper) -> str:
    kind = episode.outcome
    head = (
        f"<h3>Episode {episode.number}: the {_esc(episode.target)} was asked for"
        f'<span class="badge {kind}">{_WORDS[kind]}</span></h3>'
    )
    told = [f"{episode.attempts} attempt{'s' if episode.attempts != 1 else ''}"]
    if episode.steps:
        told.append(f"{episode.steps} control steps")
    told.append(f"seed {episode.seed}")
    if film is not None and episode.film_second is not None:
        told.append(
            f'<a href="{_esc(film)}#t={episode.film_second:.1f}">in the film at {_clock(episode.film_second)}</a>'
        )
    why = f"<p>{_esc(episode.reason)}</p>" if episode.reason else ""
    columns = [f"<div>{_picture(episode)}{_seen(episode)}</div>", _figure(episode, gripper)]
    return (
        f'<section class="episode" id="episode-{episode.number}">{head}{why}<p class="why">{" · ".join(told)}</p>'
        f'<div class="pair">{"".join(columns)}</div></section>'
    )


def _picture(episode: EpisodeRecord) -> str:
    if episode.picture is None:
        return ""
    buffer = io.BytesIO()
    Image.fromarray(np.asarray(episode.picture, dtype=np.uint8)).save(buffer, "JPEG", quality=85)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<img alt="the scene of episode {episode.number}" src="data:image/jpeg;base64,{data}">'


def _figure(episode: EpisodeRecord, gripper: Gripper) -> str:
    layers = [
        Layer(
            seen.points,
            f"{seen.label} {100 * seen.confidence:.0f} %" + (" (chosen)" if seen.chosen else ""),
            (f"{len(seen.points)} points", f"asked for: {episode.target}"),
        )
        for seen in episode.objects
    ]
    if episode.cloud is None and not layers and episode.plan is None:
        return ""
    shown = episode.cloud if episode.cloud is not None and np.isfinite(episode.cloud).all(axis=1).any() else None
    if shown is None and not any(len(seen.points) for seen in episode.objects):
        return ""
    return f"<div>{fragment(episode.plan, shown, gripper=gripper, layers=layers, up=episode.up)}</div>"


def _seen(episode: EpisodeRecord) -> str:
    if not episode.objects:
        return '<p class="why">No object was found in the last frame.</p>'
    rows = "".join(
        f'<tr class="{"chosen" if seen.chosen else ""}"><td>{_esc(seen.label)}{" ← chosen" if seen.chosen else ""}</td>'
        f'<td class="right">{100 * seen.confidence:.1f} %</td><td class="right">{len(seen.points):,}</td></tr>'
        for seen in episode.objects
    )
    head = '<tr><th>classified as</th><th class="right">confidence</th><th class="right">points</th></tr>'
    return f'<div class="scroll"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>'


def _reproduction(record: ReportRecord) -> str:
    parts = []
    if record.commands:
        parts.append(f"<pre>{_esc(chr(10).join(record.commands))}</pre>")
    if record.episodes:
        parts.append(f"<p>Seeds of the episodes: {', '.join(str(episode.seed) for episode in record.episodes)}.</p>")
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


def _esc(text: object) -> str:
    return html.escape(str(text))
