"""An evaluation as one HTML file that loads nothing from elsewhere: its tables, and images of every failure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import bars
from pecgrasp_env.common.html_report import Share, Tile, data_uri, report_page
from pecgrasp_env.common.outcomes import OUTCOME_WORDS, OUTCOMES
from pecgrasp_env.evaluation.episode import Episode
from pecgrasp_env.evaluation.failure_images import KINDS
from pecgrasp_env.evaluation.grid import Cell
from pecgrasp_env.evaluation.paired_tests import ALL
from pecgrasp_env.evaluation.summary import lifted, lifted_at_once, summarise
from pecgrasp_env.evaluation.tables import (
    BY_VISIBLE_SHARE,
    FIRST_TRY,
    Evaluation,
    hidden_cells,
    lifted_words,
    p_value,
    progress_of,
    visible_head,
    visible_row,
)

_CAPTIONS = {
    "camera": "what the wrist camera measured; what was told apart, as what; the chosen object white, the grasp red",
    "try": "the last try, when the hand had closed or had to stop before",
    "end": "the end",
}


def render(evaluation: Evaluation, commands: Sequence[str] = ()) -> str:
    """The page as an HTML document. commands: how to repeat it."""
    happened = {episode.outcome for cell in evaluation.cells for episode in cell.episodes}
    outcomes = [name for name in OUTCOMES if name in happened]

    def share_of(scene: str, planner: str, won: Callable[[Episode], bool]) -> Share | None:
        return _share(evaluation.episodes(scene, planner), won)

    def published_of(name: str, scene: str) -> float | None:
        figures = evaluation.published[name]
        return sum(figures.values()) / len(figures) if scene == ALL and figures else figures.get(scene)

    def counts_of(cell: Cell) -> tuple[list[Share | None], dict[str, float] | None]:
        """Each outcome and the first tries of a cell, and how far other objects were moved."""
        if not cell.episodes:
            return [None] * (len(outcomes) + 1), None
        counts = Counter(episode.outcome for episode in cell.episodes)
        shares = [Share(counts[name], len(cell.episodes)) for name in outcomes]
        return [*shares, _share(cell.episodes, lifted_at_once)], summarise(cell.episodes)["disturbance_mm"]

    return report_page(
        "pecgrasp_env.evaluation",
        "evaluation",
        evaluation.title,
        evaluation=evaluation,
        summary=_tiles(evaluation),
        lifted=lifted,
        lifted_words=lifted_words(evaluation.cells),
        lifted_at_once=lifted_at_once,
        share_of=share_of,
        published_of=published_of,
        outcomes=outcomes,
        outcome_words=OUTCOME_WORDS,
        first_try=FIRST_TRY,
        by_visible_share=BY_VISIBLE_SHARE,
        visible_head=visible_head(),
        visible_rows=[visible_row(cell) for cell in hidden_cells(evaluation.cells)],
        progress_of=progress_of,
        counts_of=counts_of,
        p_value=p_value,
        time_charts=_time_charts(evaluation),
        failures=_failures(evaluation.cells),
        reasons=_reasons,
        images=_images,
        commands=commands,
    )


def _share(episodes: Sequence[Episode], won: Callable[[Episode], bool]) -> Share | None:
    return Share(sum(map(won, episodes)), len(episodes)) if episodes else None


def _tiles(evaluation: Evaluation) -> list[Tile]:
    """What each planner lifted, in all scenes, where that means something."""
    tiles = []
    for planner in evaluation.planners if evaluation.one_kind else ():
        share = _share(evaluation.episodes(ALL, planner), lifted)
        if share is not None:
            interval = f"{share.low:.1f}–{share.high:.1f}\N{NO-BREAK SPACE}%"
            lines = (f"{planner}: {lifted_words(evaluation.cells)}", f"{share.count:,} of {share.n:,}, {interval}")
            tiles.append(Tile(f"{share.percent:.1f} %", lines))
    return tiles


def _time_charts(evaluation: Evaluation) -> list[tuple[str, str]]:
    """Caption and SVG for each planner that was timed."""
    charts = []
    for planner in evaluation.planners:
        episodes = evaluation.episodes(ALL, planner)
        times: dict[str, Any] = summarise(episodes)["stage_ms"] if episodes else {}
        drawn = bars([(name, each["median"], each["most"]) for name, each in times.items()], "ms")
        if drawn is not None:
            charts.append((planner.replace("_", " "), inline_svg(drawn, f"time of each stage, {planner}")))
    return charts


def _failures(cells: Sequence[Cell]) -> list[tuple[Cell, str, list[Episode]]]:
    """Each cell with failures, how many there are of each outcome, and the episodes."""
    failures = []
    for cell in cells:
        failed = [episode for episode in cell.episodes if not lifted(episode)]
        if failed:
            counts = Counter(OUTCOME_WORDS[episode.outcome][0] for episode in failed)
            failures.append((cell, ", ".join(f"{count} {words}" for words, count in counts.most_common()), failed))
    return failures


def _reasons(episode: Episode) -> str:
    """What the policy noticed of its failure."""
    reasons = []
    if episode.failures:
        reasons.append("; ".join(f"{k}. {text}" for k, text in enumerate(episode.failures, 1)))
    if episode.reason and episode.reason not in episode.failures:
        reasons.append(episode.reason)
    return ". ".join(reasons or ["The policy noticed nothing."])


def _images(cell: Cell, episode: Episode) -> list[tuple[str, str]]:
    """Caption and address of each image that was kept of a failure."""
    paths = {kind: cell.failures / f"{episode.seed}.{kind}.webp" for kind in KINDS}
    return [(_CAPTIONS[kind], data_uri(path.read_bytes(), "webp")) for kind, path in paths.items() if path.exists()]
