"""What scores of grasps are worth against whether they held."""

from __future__ import annotations

from typing import Any

import numpy as np

from pec.metrics.rejection import area_under_roc

__all__ = ["average_precision", "ranking_figures", "top_one"]


def average_precision(scores: np.ndarray, held: np.ndarray) -> float:
    """The mean, over grasps that held, of the share that held among those scored at least as high; scores, held (G,).

    NaN where none held.
    """
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(held[order])
    # Equal scores are one place in the ranking: the last of them.
    last = np.searchsorted(-scores[order], -scores[order], side="right") - 1
    precision = hits[last] / (last + 1)
    return float(precision[held[order]].mean()) if held.any() else float("nan")


def top_one(scores: np.ndarray, held: np.ndarray, scene_of: np.ndarray) -> tuple[float, float, int]:
    """Over scenes in which some grasp held and some did not: the share whose best scored grasp held, what drawing one
    at random would give, and how many they are. NaN where there is none.

    scene_of: (G,) of each grasp. Of equally scored grasps each counts its share.
    """
    shares, chances = [], []
    for scene in np.unique(scene_of):
        mine = scene_of == scene
        if 0 < held[mine].sum() < mine.sum():
            best = scores[mine] == scores[mine].max()
            shares.append(held[mine][best].mean())
            chances.append(held[mine].mean())
    n = len(shares)
    return (float(np.mean(shares)), float(np.mean(chances)), n) if n else (float("nan"), float("nan"), 0)


def ranking_figures(scores: np.ndarray, held: np.ndarray, scene_of: np.ndarray) -> dict[str, Any]:
    """grasps: their number. held: the share that did. auc: under the ROC. top_one, chance, scenes: as of `top_one`."""
    share, chance, n = top_one(scores, held, scene_of)
    both = 0 < held.sum() < len(held)
    return {
        "grasps": len(held),
        "held": float(held.mean()) if len(held) else float("nan"),
        "auc": area_under_roc(scores[held], scores[~held]) if both else float("nan"),
        "average_precision": average_precision(scores, held),
        "top_one": share,
        "chance": chance,
        "scenes": n,
    }
