"""The data card of grasp labels: counts, shares, pictures of held and lost grasps; one HTML file of its own."""

from __future__ import annotations

import json
import os
from collections import Counter
from pathlib import Path

import numpy as np

from pec.common.atomic_files import write_whole
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import histogram
from pec.grasps.labels import HELD, GraspLabels, GraspScene
from pecgrasp_env.capture.grasps.picture import OUTCOME_COLORS, grasp_picture
from pecgrasp_env.common.html_report import Tile, jpeg_uri, report_page

__all__ = ["CARD_NAME", "write_grasps_card"]

CARD_NAME = "card.html"
_OBJECTS = 2  # of each class that are shown
_HANDS = 6  # at most in a picture


def write_grasps_card(directory: str | os.PathLike[str]) -> Path:
    """Write DIR/card.html of a set of grasp labels, whole or not at all; the same set gives the same bytes.

    Raises DatasetError where there is none.
    """
    labels = GraspLabels(directory)
    counts = labels.counts
    shown: dict[str, dict[str, GraspScene]] = {name: {} for name in labels.classes}
    widths: list[np.ndarray] = []
    n_scenes = 0
    for scene in labels.scenes():
        n_scenes += 1
        widths.append(1e3 * scene.widths)
        objects = shown[scene.class_name]
        if scene.instance not in objects and len(objects) < _OBJECTS and scene.held.any() and not scene.held.all():
            objects[scene.instance] = scene
    total, held = int(counts.sum()), int(counts[..., HELD].sum())
    rejected = sum((Counter(record.rejected) for record in labels.manifest.shards), Counter[str]())
    page = report_page(
        "pecgrasp_env.capture.grasps",
        "grasps_card",
        f"Data card: {total:,} grasp labels",
        summary=[
            Tile(f"{total:,}", ("grasps that were tried",)),
            Tile(f"{held / max(total, 1):.0%}", ("of them held",)),
            Tile(f"{n_scenes:,}", ("scenes, each seen once",)),
            Tile(f"{len(labels.instances):,}", (f"objects of {len(labels.classes)} classes",)),
        ],
        outcomes=labels.outcomes,
        samplers=_rows(labels.samplers, counts.sum(axis=0)),
        classes=_rows(labels.classes, counts.sum(axis=1)),
        histograms=[
            (caption, inline_svg(histogram(values, "mm", False), caption))
            for caption, values in (("Width at contact that was asked for", np.concatenate([np.zeros(0), *widths])),)
            if len(values)
        ],
        legend=[
            (name, f"rgb({red}, {green}, {blue})")
            for name, (red, green, blue) in zip(labels.outcomes, OUTCOME_COLORS, strict=True)
        ],
        pictures=[
            (class_name, [each for scene in objects.values() for each in _pictures(scene)])
            for class_name, objects in shown.items()
            if objects
        ],
        rejected=[(reason, f"{count:,}") for reason, count in rejected.most_common()],
        manifest=labels.manifest,
        configuration=json.dumps(labels.manifest.config, indent=1),
    )
    path = Path(directory) / CARD_NAME
    write_whole(path, page)
    return path


def _rows(names: tuple[str, ...], table: np.ndarray) -> list[tuple[str, ...]]:
    """Name, number, and the share of each outcome in %; a last row of all."""
    rows = [*zip(names, table, strict=True), ("all", table.sum(axis=0))]
    return [(name, f"{row.sum():,}", *(f"{share:.1%}" for share in row / max(row.sum(), 1))) for name, row in rows]


def _pictures(scene: GraspScene) -> list[tuple[str, str]]:
    """Caption and address of two: grasps that held, and grasps that did not."""
    rng = np.random.default_rng(len(scene.points))
    parts = [("held", scene.held), ("failed", ~scene.held)]
    shown = [np.sort(rng.permutation(np.flatnonzero(which))[:_HANDS]) for _, which in parts]
    return [
        (
            f"{scene.instance}: {len(chosen)} of {int(which.sum())} that {words}",
            jpeg_uri(grasp_picture(scene, chosen, np.concatenate(shown))),
        )
        for (words, which), chosen in zip(parts, shown, strict=True)
    ]
