"""The `piled` scenario: as `tabletop`, but the objects have fallen onto each other.

The segmentation that runs on the robot cuts them out as well as it can. What it cuts off, or joins to an object of the
pile, stays in the cloud, which is labelled by the object that most of its points lie on; so a classifier meets the
segmenter's faults in training. `purity` says how large they are.

To pile objects up takes seconds, to look at them a tenth of one: so each heap is looked at from many places, and each
look gives a cloud of every object that is not hidden in it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from pecgrasp_env.capture.rendering.tabletop_depth import Table
from pecgrasp_env.capture.scenarios.base import sample_seed
from pecgrasp_env.capture.scenarios.tabletop import Layout, TabletopScenario
from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.scene.piles import pile
from pecgrasp_env.scene.placement import REGION, PlacementError

__all__ = ["PiledScenario"]

_LOOKS = 16  # at one heap


class PiledScenario(TabletopScenario):
    """Several objects at a time in a pile on the robot's table, under its wrist camera."""

    _heap: np.ndarray | None
    """(n, 7) poses of the objects in the heap that is looked at, None where there is none."""

    def _check(self, model: ObjectModel) -> None:
        self._renderer.check(model)

    def _frames(self, models: Sequence[ObjectModel], first: str, key: str) -> Iterator[tuple[Layout, Table | None]]:
        for number in itertools.count():
            rng = np.random.default_rng(sample_seed(self._config.seed, f"heaps for {first}", key, number))
            try:
                self._heap, looks = pile(models, rng, REGION), _LOOKS
            except PlacementError:
                self._heap, looks = None, 1
            yield from itertools.islice(super()._frames(models, f"{first}, heap {number}", key), looks)

    def _place(self, models: Sequence[ObjectModel], rng: np.random.Generator) -> np.ndarray:
        if self._heap is None:
            raise PlacementError(f"{len(models)} objects do not come to rest in a heap")
        return self._heap
