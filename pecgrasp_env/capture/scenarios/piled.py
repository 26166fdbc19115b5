"""The `piled` scenario: as `tabletop`, but the objects have fallen onto each other.

The segmentation that runs on the robot cuts them out as well as it can. What it cuts off, or joins to an object of the
pile, stays in the cloud, which is labelled by the object that most of its points lie on; so a classifier meets the
segmenter's faults in training. `purity` says how large they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pecgrasp_env.capture.scenarios.tabletop import TabletopScenario
from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.scene.piles import pile
from pecgrasp_env.scene.placement import REGION

__all__ = ["PiledScenario"]


class PiledScenario(TabletopScenario):
    """Several objects at a time in a pile on the robot's table, under its wrist camera."""

    def _check(self, model: ObjectModel) -> None:
        self._renderer.check(model)

    def _place(self, models: Sequence[ObjectModel], rng: np.random.Generator) -> np.ndarray:
        return pile(models, rng, REGION)
