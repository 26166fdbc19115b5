"""An evaluation as one HTML file that loads nothing from elsewhere: its tables, and every failure in pictures."""

from __future__ import annotations

import base64
import html
from collections import Counter
from collections.abc import Callable, Sequence
from importlib.resources import files

from grasping.viewer.html import page
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import bars
from pec.statistics import wilson_interval
from pecgrasp_env.evaluation.episode import OUTCOME_WORDS, OUTCOMES, Episode
from pecgrasp_env.evaluation.failure_images import KINDS
from pecgrasp_env.evaluation.grid import Cell
from pecgrasp_env.evaluation.paired_tests import ALL, Comparison
from pecgrasp_env.evaluation.summary import lifted, lifted_at_once, summarise
from pecgrasp_env.evaluation.tables import FIRST_TRY, Evaluation, p_value, progress_of

_CAPTIONS = {
    "camera": "what the wrist camera measured; what was told apart, as what; the chosen object white, the grasp red",
    "try": "the last try, when the hand had closed or had to stop before",
    "end": "the end",
}


def render(evaluation: Evaluation, commands: Sequence[str] = ()) -> str:
    """The page as an HTML document. commands: how to repeat it."""
    style = (files("pecgrasp_env.common") / "report.css").read_text(encoding="utf-8") + _STYLE
    body = [
        f"<header><h1>{_esc(evaluation.title)}</h1><p>{_esc(' '.join(evaluation.notes))}</p></header>",
        _tiles(evaluation),
        "<h2>The right object lifted</h2>" + _success(evaluation, lifted),
        "<h2>At the first try</h2>" + _success(evaluation, lifted_at_once),
        "<h2>What happened</h2>" + _outcomes(evaluation.cells),
        _comparisons(evaluation),
        _times(evaluation),
        _failures(evaluation),
        f"<h2>To repeat this</h2><pre>{_esc(chr(10).join(commands))}</pre>" if commands else "",
    ]
    return page(evaluation.title, "\n".join(part for part in body if part), style=style)


_STYLE = """
td.share { min-width: 6.5rem; }
td.share b { font-weight: 600; }
td.share small, td small { display: block; color: var(--soft); font-size: 0.76rem; white-space: nowrap; }
td.share i { display: block; height: 3px; border-radius: 2px; margin: 0.15rem 0; background: var(--line); }
td.share i span { display: block; height: 100%; border-radius: 2px; background: var(--good); }
td.none { color: var(--soft); opacity: 0.5; }
.cards { display: grid; gap: 1rem; margin: 1rem 0; }
.cards { grid-template-columns: repeat(auto-fill, minmax(min(100%, 24rem), 1fr)); }
.card { border: 1px solid var(--line); border-radius: 10px; padding: 0.8rem 0.9rem; }
.card { background: var(--panel); min-width: 0; }
.card p { font-size: 0.88rem; margin: 0.2rem 0 0.5rem; overflow-wrap: anywhere; }
.card p.why { color: var(--soft); }
.card figure { margin: 0.5rem 0 0; }
.card img { width: 100%; display: block; border-radius: 6px; }
.card figcaption { font-size: 0.76rem; color: var(--soft); margin-top: 0.15rem; }
details.cell { border-top: 1px solid var(--line); }
details.cell summary { color: var(--ink); padding: 0.4rem 0; margin: 0; }
"""


def _tiles(evaluation: Evaluation) -> str:
    tiles = []
    if evaluation.cells and not evaluation.one_kind:
        return ""
    for planner in evaluation.planners:
        episodes = evaluation.episodes(ALL, planner)
        if episodes:
            count, n = sum(map(lifted, episodes)), len(episodes)
            low, high = wilson_interval(count, n)
            note = (
                f"{_esc(planner)}: right object lifted<br>{count:,} of {n:,}, {100 * low:.1f}–{100 * high:.1f}&nbsp;%"
            )
            tiles.append((f"{100 * count / n:.1f} %", note))
    inner = "".join(f'<div class="tile"><b>{value}</b><span>{note}</span></div>' for value, note in tiles)
    return f'<div class="tiles">{inner}</div>' if tiles else "<p>No episode was run.</p>"


def _success(evaluation: Evaluation, won: Callable[[Episode], bool]) -> str:
    published = evaluation.published
    rows = []
    for scene in evaluation.rows:
        fields = [f"<td>{_name(scene)}</td>"]
        fields += [_share(evaluation.episodes(scene, planner), won) for planner in evaluation.planners]
        for figures in published.values():
            figure = sum(figures.values()) / len(figures) if scene == ALL and figures else figures.get(scene)
            fields.append('<td class="none">–</td>' if figure is None else f"<td>{figure:.3g} %</td>")
        rows.append("".join(fields))
    return _table(["", *evaluation.planners, *(f"published: {name}" for name in published)], rows)


def _share(episodes: Sequence[Episode], won: Callable[[Episode], bool]) -> str:
    if not episodes:
        return '<td class="none">–</td>'
    count, n = sum(map(won, episodes)), len(episodes)
    low, high = wilson_interval(count, n)
    return (
        f'<td class="share"><b>{100 * count / n:.1f} %</b><i><span style="width:{100 * count / n:.1f}%"></span></i>'
        f"<small>{100 * low:.1f}–{100 * high:.1f}, n = {n}</small></td>"
    )


def _outcomes(cells: Sequence[Cell]) -> str:
    counts = {cell.key: Counter(episode.outcome for episode in cell.episodes) for cell in cells}
    shown = [name for name in OUTCOMES if any(count[name] for count in counts.values())]
    summaries = {cell.key: summarise(cell.episodes) for cell in cells if cell.episodes}
    rows = []
    for cell in cells:
        summary = summaries.get(cell.key)
        fields = [f"<td>{_name(cell.scene)}</td><td>{_name(cell.planner)}</td><td>{progress_of(cell)}</td>"]
        if summary is None:
            fields.append('<td class="none">–</td>' * (len(shown) + 2))
        else:
            for share in (*(summary["outcomes"][outcome] for outcome in shown), summary["first_try"]):
                low, high = share["interval"]
                kind = "" if share["count"] else ' class="none"'
                fields.append(f"<td{kind}>{share['count']}<small>{100 * low:.1f}–{100 * high:.1f} %</small></td>")
            moved = summary["disturbance_mm"]
            text = f"<td>{moved['median']:.1f} / {moved['p95']:.1f}</td>" if moved else '<td class="none">–</td>'
            fields.append(text)
        rows.append("".join(fields))
    words = [OUTCOME_WORDS[name][0] for name in shown]
    stopped = "".join(
        f"<p>{_name(cell.scene)}, {_name(cell.planner)}: stopped by {_esc(cell.error)}</p>"
        for cell in cells
        if cell.error is not None
    )
    head = ["scene", "planner", "episodes", *words, FIRST_TRY, "another object moved, mm: median / 95 %"]
    return _table(head, rows) + stopped


def _comparisons(evaluation: Evaluation) -> str:
    if not evaluation.comparisons:
        return ""
    note = "Seed by seed every planner meets the same scene. McNemar's exact test, two-sided, each row by itself."
    tables = _pairs(evaluation.comparisons, "lifted it") + _pairs(evaluation.first_try_comparisons, "at the first try")
    return f"<h2>Planners on the same scenes</h2><p>{note}</p>{tables}"


def _pairs(comparisons: Sequence[Comparison], what: str) -> str:
    rows = []
    for each in comparisons:
        counts = (each.both, each.only_first, each.only_second, each.neither)
        numbers = [*map(str, counts), f"{100 * each.difference:+.1f}", _esc(p_value(each.p))]
        fields = [_name(each.scene), _name(each.first), _name(each.second), *numbers]
        rows.append("".join(f"<td>{text}</td>" for text in fields))
    head = ["scene", "first", "second", f"both {what}", "only first", "only second", "neither"]
    return _table([*head, "first − second, points", "p"], rows)


def _times(evaluation: Evaluation) -> str:
    charts = []
    for planner in evaluation.planners:
        episodes = evaluation.episodes(ALL, planner)
        times = summarise(episodes)["stage_ms"] if episodes else {}
        drawn = bars([(name, t["median"], t["most"]) for name, t in times.items()], "ms")
        chart = inline_svg(drawn, f"time of each stage, {planner}")
        if chart:
            charts.append(f"<figure><figcaption>{_name(planner)}</figcaption>{chart}</figure>")
    if not charts:
        return ""
    note = "Of single calls, over all scenes. Bars: median; dots: the slowest."
    return f'<h2>Time of each stage</h2><p>{note}</p><div class="charts">{"".join(charts)}</div>'


# ---------------------------------------------------------------------------------------------------- failures


def _failures(evaluation: Evaluation) -> str:
    sections = []
    for cell in evaluation.cells:
        failed = [episode for episode in cell.episodes if not lifted(episode)]
        if failed:
            words = Counter(OUTCOME_WORDS[episode.outcome][0] for episode in failed)
            told = ", ".join(f"{count} {word}" for word, count in words.most_common())
            cards = "".join(_card(cell, episode) for episode in failed)
            sections.append(
                f'<details class="cell" id="cell-{cell.key}"><summary>{_name(cell.scene)}, {_name(cell.planner)}: '
                f'{_esc(told)}</summary><div class="cards">{cards}</div></details>'
            )
    return "<h2>Every failure</h2>" + ("\n".join(sections) or "<p>There was none.</p>")


def _card(cell: Cell, episode: Episode) -> str:
    words, tone = OUTCOME_WORDS[episode.outcome]
    told = []
    if episode.failures:
        told.append("; ".join(f"{k}. {text}" for k, text in enumerate(episode.failures, 1)))
    if episode.reason and episode.reason not in episode.failures:
        told.append(episode.reason)
    if not told:
        told.append("The policy noticed nothing.")
    asked = f"{_name(episode.target)} asked for; " if episode.target else ""
    where = f"{asked}on the table: {_esc(', '.join(episode.objects))}; {episode.steps} steps, {episode.views} views"
    return (
        f'<section class="card"><h3>seed {episode.seed}<span class="badge {tone}">{_esc(words)}</span></h3>'
        f'<p>{_esc(". ".join(told))}</p><p class="why">{where}</p>{_pictures(cell, episode)}</section>'
    )


def _pictures(cell: Cell, episode: Episode) -> str:
    figures = []
    for kind in KINDS:
        path = cell.failures / f"{episode.seed}.{kind}.webp"
        if path.exists():
            data = base64.b64encode(path.read_bytes()).decode()
            caption = _CAPTIONS[kind]
            figures.append(
                f'<figure><img loading="lazy" alt="{_esc(caption)}" src="data:image/webp;base64,{data}">'
                f"<figcaption>{_esc(caption)}</figcaption></figure>"
            )
    return "".join(figures)


def _table(head: Sequence[str], rows: Sequence[str]) -> str:
    """rows: cells as HTML."""
    names = "".join(f"<th>{_name(name)}</th>" for name in head)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table></div>'


def _name(text: str) -> str:
    return _esc(text.replace("_", " "))


def _esc(text: object) -> str:
    return html.escape(str(text))
