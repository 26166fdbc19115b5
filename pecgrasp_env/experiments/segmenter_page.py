"""The training of a segmenter's trees as one HTML file: what they find, what they ask for, and where they fail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.scene import Scene
from pecgrasp_env.common.html_report import Share, Tile, jpeg_uri, report_page
from pecgrasp_env.experiments.segmenter_scores import FOUND, Tally

VISIBLE = 0.5


def picture(depth: NDArray, labels: NDArray, scene: Scene) -> str:
    """A frame's depth with the objects' outlines, beside what was cut out of it, as the address of an image."""
    seen = depth > 0
    near, far = np.quantile(depth[seen], (0.01, 0.95)) if seen.any() else (0.0, 1.0)
    gray = np.where(seen, 40 + 200 * (1 - np.clip((depth - near) / max(far - near, 1e-6), 0, 1)), 0)
    left = np.repeat(gray.astype(np.uint8)[..., None], 3, axis=2)
    outline = np.zeros(labels.shape, dtype=bool)
    outline[:-1] |= labels[:-1] != labels[1:]
    outline[:, :-1] |= labels[:, :-1] != labels[:, 1:]
    left[outline] = (220, 40, 40)
    right = np.zeros((labels.size, 3), dtype=np.uint8)
    hues = np.random.default_rng(1).uniform(70, 255, (len(scene.indices), 3))
    for index, hue in zip(scene.indices, hues, strict=True):
        right[index] = hue
    right = right.reshape(*labels.shape, 3)
    right[outline] = 255
    return jpeg_uri(np.concatenate([left, right], axis=1))


def render(
    tallies: Mapping[str, Mapping[str, Tally]],
    pairs: Mapping[str, Mapping[str, float]],
    importance: Mapping[str, Sequence[tuple[str, float]]],
    worst: Sequence[tuple[str, str]],
    about: Mapping[str, Any],
) -> str:
    """tallies: by "all", "kind" and "camera", then by name. pairs: precision and recall of each kind of trees.
    importance: what each kind of trees asks for, (feature, loss of accuracy without it). worst: captions and images.
    """
    everything = tallies["all"]["all"]
    tiles = [
        Tile(f"{Share(*everything.found(FOUND[1])).percent:.1f} %", ("of objects found", f"at IoU {FOUND[1]}")),
        Tile(f"{Share(*everything.found(FOUND[1], VISIBLE)).percent:.1f} %", ("of those at least", "half visible")),
        Tile(f"{Share(*everything.right(FOUND[0])).percent:.1f} %", ("of segments", f"an object at IoU {FOUND[0]}")),
    ]
    found = [(group, name, tally) for group in tallies for name, tally in tallies[group].items()]
    return report_page(
        "pecgrasp_env.experiments",
        "segmenter",
        "Segmenter: trees that tell touching things apart",
        tiles=tiles,
        found=[
            [name if group == "all" else f"{group}: {name}"]
            + [_cell(tally.found(least)) for least in FOUND]
            + [_cell(tally.found(FOUND[1], VISIBLE)), _cell(tally.right(FOUND[0]))]
            for group, name, tally in found
        ],
        pairs=[
            [name, int(row["rows"]), f"{row['precision']:.3f}", f"{row['recall']:.3f}"] for name, row in pairs.items()
        ],
        importance={name: [(key, f"{100 * loss:.2f}") for key, loss in rows] for name, rows in importance.items()},
        calibration=[[f"{sure:.2f}", f"{right:.2f}", n] for sure, right, n in everything.calibration()],
        worst=worst,
        about=[(key, value) for key, value in about.items()],
    )


def _cell(counts: tuple[int, int]) -> str:
    if not counts[1]:
        return "–"
    share = Share(*counts)
    return f"{share.percent:.1f} % ({share.low:.1f}–{share.high:.1f}), {counts[0]} of {counts[1]}"
