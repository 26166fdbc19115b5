"""The `piled` scenario: as `tabletop`, but the objects have fallen onto each other.

The segmentation that runs on the robot cuts them out as well as it can. What it adds to an object, or cuts off, up to a
quarter of both together, stays in the cloud, so that a classifier meets the segmenter's faults in training. Strangers
lie among the known things, and every second cloud of one is of something that was cut wrongly in the same heap: a
part, several things, or some of both, by the cuts that the policy tries, is none of the classes either.

To pile objects up takes seconds, to look at them a tenth of one: so each heap is looked at from many places, and each
look gives a cloud of every object that is not hidden in it. Between two heaps the same objects lie apart, as they do
on most tables.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from grasping import Segmenter
from pecgrasp_env.capture.config import CaptureConfig
from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer, Renderer
from pecgrasp_env.capture.rendering.tabletop_depth import Table
from pecgrasp_env.capture.scenarios.base import Subject, sample_seed
from pecgrasp_env.capture.scenarios.tabletop import CutOut, Layout, TabletopScenario, cut_outs, segment_layout
from pecgrasp_env.objects import UNKNOWN, ObjectModel
from pecgrasp_env.scene.piles import pile
from pecgrasp_env.scene.placement import REGION, PlacementError

__all__ = ["PiledScenario"]

_LOOKS, _LOOKS_APART = 16, 4  # at one heap, and at the same objects apart before the next one
_WHOLE, _NO_ONE = 0.75, 0.5  # of the union of a cut-out and an object: the object; less with any: none
_CUTS = (None, -1.5, -3.0)  # `whole_rather` of the policy's cuts, the usual one first
_CUT_WRONGLY = 0.5  # of the clouds of strangers


class PiledScenario(TabletopScenario):
    """Several objects at a time in a pile on the robot's table, under its wrist camera."""

    _heap: np.ndarray | None = None
    """(n, 7) poses of the objects in the heap that is looked at, None where they lie apart."""

    def __init__(self, config: CaptureConfig, open_renderer: Callable[[float], Renderer] = DepthRenderer) -> None:
        super().__init__(config, open_renderer)
        self._cuts = [self._segmenter if rather is None else Segmenter(whole_rather=rather) for rather in _CUTS]

    def _frames(self, models: Sequence[ObjectModel], first: str, key: str) -> Iterator[tuple[Layout, Table | None]]:
        for number in itertools.count():
            rng = np.random.default_rng(sample_seed(self._config.seed, f"heaps for {first}", key, number))
            try:
                self._heap = pile(models, rng, REGION)
            except PlacementError:
                pass
            else:
                yield from itertools.islice(super()._frames(models, f"{first}, heap {number}", key), _LOOKS)
            self._heap = None
            yield from itertools.islice(super()._frames(models, f"{first}, apart {number}", key), _LOOKS_APART)

    def _place(self, models: Sequence[ObjectModel], rng: np.random.Generator) -> np.ndarray:
        return super()._place(models, rng) if self._heap is None else self._heap

    def _best(
        self, layout: Layout, measured: Table, subjects: Sequence[Subject], rejected: Counter[str]
    ) -> dict[int, CutOut]:
        found = super()._best(layout, measured, subjects, rejected)
        best = {i: cut for i, cut in found.items() if cut.overlap >= _WHOLE}
        rejected["cut wrongly"] += len(found) - len(best)
        rng = layout.rng
        for i, subject in enumerate(subjects):
            if subject.model.class_name == UNKNOWN and rng.random() < _CUT_WRONGLY:
                scene = segment_layout(layout, measured.depth, self._cuts[rng.integers(len(self._cuts))])
                wrong = [cut for cut in cut_outs(scene, measured, pairs=True) if self._is_no_object(cut)]
                if wrong:
                    best[i] = replace(wrong[rng.integers(len(wrong))], owner=None)
        return best

    def _is_no_object(self, cut: CutOut) -> bool:
        return cut.overlap < _NO_ONE and not cut.at_border and len(cut.points) >= self._config.min_points
