"""The data card of labelled frames: counts, histograms, pictures; one HTML file that loads nothing from elsewhere."""

from __future__ import annotations

import json
import os
from collections import Counter
from pathlib import Path

import numpy as np

from pec.common.atomic_files import write_whole
from pec.data.shards import read_manifest
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import histogram
from pecgrasp_env.capture.scenes.frames import BIN_LABEL, FIRST_OBJECT, TABLE_LABEL, LabelledFrame, frames_of
from pecgrasp_env.common.html_report import Tile, jpeg_uri, report_page

__all__ = ["CARD_NAME", "write_frames_card"]

CARD_NAME = "card.html"
_SHOWN = 6  # frames of a kind
_WIDTH = 240  # pixels of a picture of one
_HOLE, _ROOM, _TABLE, _BIN = (110, 20, 20), (0, 0, 0), (90, 90, 90), (150, 110, 70)


def write_frames_card(directory: str | os.PathLike[str]) -> Path:
    """Write DIR/card.html of what a set of labelled frames holds, whole or not at all; the same set, the same bytes.

    Raises DatasetError where there is none.
    """
    directory = Path(directory)
    manifest = read_manifest(directory)
    kinds, cameras = list(manifest.config["kinds"]), [camera["name"] for camera in manifest.cameras]
    of_kind, of_camera = Counter[str](), Counter[str]()
    seen: list[np.ndarray] = []
    sizes: list[np.ndarray] = []
    pictures: dict[str, list[tuple[str, str]]] = {kind: [] for kind in kinds}
    for frame in frames_of(directory):
        kind, camera = kinds[frame.kind], cameras[frame.camera]
        of_kind[kind] += 1
        of_camera[camera] += 1
        pixels = np.bincount(frame.instance.reshape(-1), minlength=256)[FIRST_OBJECT:][: len(frame.pose)]
        seen.append(frame.visible[pixels > 0])
        sizes.append(100 * pixels[pixels > 0] / frame.instance.size)
        if len(pictures[kind]) < _SHOWN:
            caption = f"scene {frame.scene}, {camera}: {np.count_nonzero(pixels)} objects in view"
            pictures[kind].append((caption, jpeg_uri(_picture(frame))))
    visible, shares = (np.concatenate([np.zeros(0), *values]) for values in (seen, sizes))
    charts = [("Share of an object that others leave to be seen", visible * 100, False)]
    charts.append(("Share of the image that an object takes", shares, True))
    rejected = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    page = report_page(
        "pecgrasp_env.capture.scenes",
        "frames_card",
        f"Data card: {of_kind.total():,} labelled frames",
        summary=[
            Tile(f"{of_kind.total():,}", ("frames",)),
            Tile(f"{len(visible):,}", ("objects in view",)),
            Tile(f"{np.mean(visible < 0.5):.0%}" if len(visible) else "–", ("of them more than half hidden",)),
        ],
        kinds=[(kind, f"{of_kind[kind]:,}") for kind in kinds],
        cameras=[(name, f"{of_camera[name]:,}") for name in cameras],
        histograms=[(caption, inline_svg(histogram(x, "%", log), caption)) for caption, x, log in charts if len(x)],
        pictures=list(pictures.items()),
        rejected=[(reason, f"{count:,}") for reason, count in rejected.most_common()],
        manifest=manifest,
        configuration=json.dumps(manifest.config, indent=1),
    )
    write_whole(directory / CARD_NAME, page)
    return directory / CARD_NAME


def _picture(frame: LabelledFrame) -> np.ndarray:
    """(h, w, 3) uint8: the measured surface, lit from above, beside the labels."""
    step = max(1, frame.depth.shape[1] // _WIDTH)
    depth, labels = frame.depth[::step, ::step], frame.instance[::step, ::step]
    focal = frame.K[0, 0] / step
    z = np.where(depth > 0, depth, np.nan)
    across, down = np.gradient(z, axis=1) / z * focal, np.gradient(z, axis=0) / z * focal
    lit = (0.4 * across + 0.6 * down + 1) / np.sqrt((across**2 + down**2 + 1) * 1.52)
    grey = np.nan_to_num(np.clip(lit, 0, 1) * 255).astype(np.uint8)
    surface = np.where((depth > 0)[..., None], grey[..., None], np.array(_HOLE, np.uint8))
    colors = np.random.default_rng(0).integers(60, 255, (256, 3)).astype(np.uint8)
    colors[0], colors[TABLE_LABEL], colors[BIN_LABEL] = _ROOM, _TABLE, _BIN
    return np.concatenate([surface, colors[labels]], axis=1)
