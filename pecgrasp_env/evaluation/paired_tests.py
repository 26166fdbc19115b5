"""Planners set against each other on the same scenes: episodes of one seed are pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pec.metrics.proportions import mcnemar
from pecgrasp_env.evaluation.episode import Episode
from pecgrasp_env.evaluation.grid import Cell
from pecgrasp_env.evaluation.summary import lifted

ALL = "all"


class PairingError(ValueError):
    """Two episodes of one seed do not show the same scene, so they cannot be compared."""


@dataclass(frozen=True)
class Comparison:
    """Pairs of episodes by who succeeded. scene: that of the cells, or `ALL`."""

    scene: str
    first: str
    second: str
    both: int
    only_first: int
    only_second: int
    neither: int

    @property
    def n(self) -> int:
        return self.both + self.only_first + self.only_second + self.neither

    @property
    def difference(self) -> float:
        """Share of the first less that of the second."""
        return (self.only_first - self.only_second) / self.n

    @property
    def p(self) -> float:
        """Of McNemar's exact test, two-sided."""
        return mcnemar(self.only_first, self.only_second)


def compare(cells: Sequence[Cell], reference: str, won: Callable[[Episode], bool] = lifted) -> list[Comparison]:
    """The planner `reference` against each other one, in each scene and in all of them together.

    won: what counts as success.

    Raises PairingError where episodes of one seed differ in their objects or in what is asked for.
    """
    planners = list(dict.fromkeys(cell.planner for cell in cells if cell.planner != reference))
    comparisons = []
    for planner in planners:
        found = []
        for first in (cell for cell in cells if cell.planner == reference):
            for second in cells:
                if (second.planner, second.scene) == (planner, first.scene):
                    pairs = _pairs(first, second)
                    if pairs:
                        found.append(_count(first.scene, reference, planner, pairs, won))
        comparisons += found
        if len(found) > 1:
            totals = [sum(counts) for counts in zip(*(_counts(each) for each in found), strict=True)]
            comparisons.append(Comparison(ALL, reference, planner, *totals))
    return comparisons


def _pairs(first: Cell, second: Cell) -> list[tuple[Episode, Episode]]:
    others = {episode.seed: episode for episode in second.episodes}
    pairs = [(episode, others[episode.seed]) for episode in first.episodes if episode.seed in others]
    for one, other in pairs:
        same = (one.objects, one.target) == (other.objects, other.target)
        if not same and "error" not in (one.outcome, other.outcome):
            raise PairingError(
                f"{first.scene}, seed {one.seed}: {first.planner} met {one.objects}, {second.planner} {other.objects}"
            )
    return pairs


def _count(
    scene: str,
    first: str,
    second: str,
    pairs: Sequence[tuple[Episode, Episode]],
    won: Callable[[Episode], bool],
) -> Comparison:
    cases = [(won(one), won(other)) for one, other in pairs]
    counts = [cases.count(case) for case in ((True, True), (True, False), (False, True), (False, False))]
    return Comparison(scene, first, second, *counts)


def _counts(comparison: Comparison) -> tuple[int, int, int, int]:
    return comparison.both, comparison.only_first, comparison.only_second, comparison.neither
