"""What a set of grasp labels holds, in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from pec.grasps.labels import GraspLabels
from pecgrasp_env.capture.grasps.generate import GraspsGeneration

__all__ = ["summarise_grasps"]


def summarise_grasps(generation: GraspsGeneration) -> dict[str, Any]:
    """The content of results.json.

    classes, samplers: of each how many grasps ended in each outcome. grasps: that are there. new_grasps: that this run
    made, in `seconds`, in which processors worked `core_seconds`; their rates. rejected: views that were not kept and
    grasps that were not found, by reason. skipped: objects that could not be had, and why.
    """
    labels = GraspLabels(generation.directory, generation.manifest)
    counts = labels.counts

    def rows(names: tuple[str, ...], table: np.ndarray) -> dict[str, dict[str, int]]:
        return {
            name: dict(zip(labels.outcomes, row, strict=True)) for name, row in zip(names, table.tolist(), strict=True)
        }

    return {
        "classes": rows(labels.classes, counts.sum(axis=1)),
        "samplers": rows(labels.samplers, counts.sum(axis=0)),
        "grasps": generation.n_grasps,
        "new_grasps": generation.n_new,
        "rejected": generation.rejected,
        "skipped": generation.skipped,
        "seconds": round(generation.seconds, 2),
        "core_seconds": round(generation.core_seconds, 2),
        "grasps_per_second": round(generation.n_new / generation.seconds, 1),
        "grasps_per_core_second": round(generation.n_new / generation.core_seconds, 1),
    }
