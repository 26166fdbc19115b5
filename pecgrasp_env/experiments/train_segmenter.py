"""From labelled frames to the file of trees that a segmenter reads, with a page that says how good they are."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping import Segmenter
from grasping.segmentation.boosted_trees import Relations, write_relations
from grasping.segmentation.trained import NAMES
from pec.common.atomic_files import write_whole
from pec.data.shards import read_manifest
from pecgrasp_env.capture.scenes.frames import BIN_LABEL, LabelledFrame, frames_of
from pecgrasp_env.experiments.segmenter_page import picture, render
from pecgrasp_env.experiments.segmenter_scores import FOUND, Tally, score
from pecgrasp_env.experiments.segmenter_training import Examples, add_groups, add_pairs, cut_frames, train

WORST, SHOWN = 8, 15  # scenes in pictures, and features of each kind of trees
FILE = "relations.npz"


def cloud_of(frame: LabelledFrame) -> NDArray[np.float32]:
    """(H, W, 3) m in the camera's frame, NaN where nothing was measured."""
    h, w = frame.depth.shape
    K = frame.K
    z = np.where(frame.depth > 0, frame.depth, np.float32(np.nan))
    x = (np.arange(w) + 0.5 - K[0, 2]) / K[0, 0]
    y = (np.arange(h) + 0.5 - K[1, 2]) / K[1, 1]
    return np.stack([z * x, z * y[:, None], z], axis=-1).astype(np.float32)


def labels_of(frame: LabelledFrame) -> NDArray[np.int64]:
    """(H, W): 0 the room and a bin, 1 the table, from 2 up the objects."""
    return np.where(frame.instance == BIN_LABEL, 0, frame.instance).astype(np.int64)


def train_segmenter(
    folders: Sequence[Path],
    output: Path,
    *,
    val: Path | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Any]:
    """Train on the frames of folders, write `relations.npz`, `report.html` and `results.json` into output, and return
    what the last says.

    val: a folder whose frames are all measured on; None: the scenes of the folders that are kept apart. Raises
    DatasetError where a folder has no frames.
    """
    output.mkdir(parents=True, exist_ok=True)
    manifests = [read_manifest(folder) for folder in folders]
    hashes = [record.sha256 for manifest in manifests for record in manifest.shards]
    count = sum(record.n_samples for manifest in manifests for record in manifest.shards)
    about: dict[str, Any] = {
        "frames": count,
        "data": hashlib.sha256("".join(hashes).encode()).hexdigest(),
        "made_by": [manifest.config for manifest in manifests],
        "seed": seed,
    }
    done = 0

    def training() -> Iterator[tuple[NDArray, NDArray]]:
        nonlocal done
        for folder in folders:
            for frame in frames_of(folder, val=False):
                yield cloud_of(frame), labels_of(frame)
                done += 1
                progress(done, 2 * count)

    relations = train(training, about, seed)
    write_relations(output / FILE, relations, NAMES)
    apart = [(val, None)] if val is not None else [(folder, True) for folder in folders]
    results, page = evaluate(apart, output / FILE, relations)
    about |= results
    write_relations(output / FILE, replace(relations, about=about), NAMES)
    write_whole(output / "report.html", page.encode())
    write_whole(output / "results.json", json.dumps(about, indent=2).encode())
    progress(2 * count, 2 * count)
    return about


def evaluate(apart: Sequence[tuple[Path, bool | None]], file: Path, relations: Relations) -> tuple[dict[str, Any], str]:
    """What the trees of a file find in frames that are kept apart: numbers, and the page.

    apart: folders, and of which scenes: those kept apart (True) or all (None).
    """
    segmenter = Segmenter(relations=file)
    tallies: dict[str, dict[str, Tally]] = {
        "all": defaultdict(Tally),
        "kind": defaultdict(Tally),
        "camera": defaultdict(Tally),
    }
    shown: list[tuple[float, str, str]] = []
    for frame, kind, camera in _frames_apart(apart):
        labels = labels_of(frame)
        scene = segmenter.segment(cloud_of(frame))
        found = score(scene, labels, frame.depth > 0, frame.visible)
        for group, name in (("all", "all"), ("kind", kind), ("camera", camera)):
            tallies[group][name].scores.append(found)
        if len(found.overlap):
            share = float((found.overlap > FOUND[1]).mean())
            caption = f"scene {frame.scene}, {kind}, {camera}: {share:.0%} of {len(found.overlap)} found"
            if len(shown) < WORST or share < shown[-1][0]:
                shown = sorted([*shown, (share, caption, picture(frame.depth, labels, scene))])[:WORST]
    kinds = _examples_apart(apart, relations)
    pairs = {name: precision_recall(relations, name, found) for name, found in kinds.items()}
    importance = {name: importances(relations, name, found) for name, found in kinds.items()}
    everything = tallies["all"]["all"]
    numbers = {
        "found_50": everything.found(FOUND[0]),
        "found_75": everything.found(FOUND[1]),
        "found_75_half_visible": everything.found(FOUND[1], 0.5),
        "segments_right_50": everything.right(FOUND[0]),
        "trees": pairs,
    }
    about = relations.about | {"frames kept apart": len(everything.scores)}
    return numbers, render(tallies, pairs, importance, [(caption, image) for _, caption, image in shown], about)


def _frames_apart(apart: Sequence[tuple[Path, bool | None]]) -> Iterator[tuple[LabelledFrame, str, str]]:
    """The frames, and the names of each one's kind and camera."""
    for folder, which in apart:
        config = read_manifest(folder).config
        kinds, cameras = list(config["kinds"]), list(config["cameras"])
        for frame in frames_of(folder, val=which):
            yield frame, kinds[frame.kind], cameras[frame.camera]


def _examples_apart(apart: Sequence[tuple[Path, bool | None]], relations: Relations) -> dict[str, Examples]:
    kinds = {name: Examples() for name in NAMES}
    frames = ((cloud_of(frame), labels_of(frame)) for frame, _, _ in _frames_apart(apart))
    for _, cut in cut_frames(frames, 0.0, 0.0, 0):
        add_pairs(cut, kinds["near"], kinds["far"])
        add_groups(cut, relations, kinds["thing"], kinds["whole"])
    return kinds


def precision_recall(relations: Relations, name: str, found: Examples) -> dict[str, float]:
    """Of rows that the trees say yes to, weighted: how many are so, and how many of those that are so they find."""
    features, so, weight = found.arrays()
    said = getattr(relations, name).log_odds(features) > 0
    right = float(weight[said & so].sum())
    said_sum, so_sum = float(weight[said].sum()), float(weight[so].sum())
    return {"rows": len(so), "precision": right / max(said_sum, 1e-9), "recall": right / max(so_sum, 1e-9)}


def importances(relations: Relations, name: str, found: Examples) -> list[tuple[str, float]]:
    """The features without which the trees lose most accuracy, and how much: their values drawn from other rows."""
    features, so, weight = found.arrays()
    if not len(so):
        return []
    trees, rng = getattr(relations, name), np.random.default_rng(0)

    def accuracy(rows: NDArray) -> float:
        return float(weight[(trees.log_odds(rows) > 0) == so].sum() / weight.sum())

    whole = accuracy(features)
    lost: dict[str, float] = {}
    for column, feature in enumerate(NAMES[name]):
        drawn = features.copy()
        drawn[:, column] = rng.permutation(drawn[:, column])
        lost[feature] = whole - accuracy(drawn)
    return sorted(lost.items(), key=lambda pair: -pair[1])[:SHOWN]
