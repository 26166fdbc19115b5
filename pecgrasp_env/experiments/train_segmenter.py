"""From labelled frames to the file of trees that a segmenter reads, with a page that says how good they are."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping import Segmenter
from grasping.segmentation.boosted_trees import Relations
from grasping.segmentation.trained import NAMES
from pec.common.atomic_files import write_whole
from pec.data.shards import Manifest, read_manifest
from pec.experiments.code_version import code_version
from pecgrasp_env.capture.scenes.frames import BIN_LABEL, LabelledFrame, cloud_of, frames_of, read_frames
from pecgrasp_env.experiments.kept_examples import Examples, KeptExamples, check_same, write_trees
from pecgrasp_env.experiments.segmenter_page import picture, render
from pecgrasp_env.experiments.segmenter_scores import FOUND, Tally, score
from pecgrasp_env.experiments.segmenter_training import (
    STEPS,
    NumberedFrame,
    add_groups,
    add_pairs,
    add_pairs_again,
    cut_frames,
    share_name,
    train,
)

WORST, SHOWN = 8, 15  # scenes in pictures, and features of each kind of trees
FILE = "relations.npz"

# From here on, imports lead to all that decides what a frame gives, and the trees.
_CODE = (("pecgrasp_env.experiments.segmenter_training",), ("numpy", "scipy"))


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

    What each shard of frames gives is kept in output/examples until the end: the same call goes on where it was
    interrupted, and a finished run is not repeated. Frames kept apart are measured all over.

    Args:
        folders: of labelled frames.
        val: a folder whose frames are all measured on; None: the scenes of the folders that are kept apart.
        progress: called with (done, total) frames, each counted every time that it is read.

    Raises:
        DatasetError: a folder has no frames, or a damaged shard.
        ConfigError: output holds a run on other data or of other settings, or one that other code has begun.
        ImportError: scikit-learn is not installed.
    """
    manifests = [read_manifest(folder) for folder in folders]
    measured = None if val is None else read_manifest(val)
    run = {"data": _data(manifests), "val": None if measured is None else _data([measured]), "seed": seed}
    results, examples = output / "results.json", output / "examples"
    if results.is_file():
        about: dict[str, Any] = json.loads(results.read_text())
        check_same(output, about, run)
        shutil.rmtree(examples, ignore_errors=True)  # where it was stopped just before
        return about
    kept = KeptExamples.of_run(examples, run | {"code": code_version(*_CODE)})
    paths = [folder / r.file for folder, manifest in zip(folders, manifests, strict=True) for r in manifest.shards]
    sizes = [record.n_samples for manifest in manifests for record in manifest.shards]
    count = sum(sizes)
    about = {"frames": count, "made_by": [manifest.config for manifest in manifests]} | run
    total = len(STEPS) * count + (count if measured is None else sum(record.n_samples for record in measured.shards))
    done = sum(size for i, size in enumerate(sizes) for step in STEPS if share_name(step, i) in kept)

    def read() -> None:
        nonlocal done
        done += 1
        progress(done, total)

    def training(path: Path, first: int) -> Iterator[NumberedFrame]:
        for number, frame in enumerate(read_frames(path), first):
            if not frame.val:
                yield number, cloud_of(frame), labels_of(frame)
            read()

    firsts = np.cumsum([0, *sizes[:-1]]).tolist()
    shares = [partial(training, path, first) for path, first in zip(paths, firsts, strict=True)]
    relations = train(shares, kept, about, seed)
    write_trees(output / FILE, relations)
    apart = [(val, None)] if val is not None else [(folder, True) for folder in folders]
    numbers, page = evaluate(apart, output / FILE, relations, read)
    about |= numbers
    write_trees(output / FILE, replace(relations, about=about))
    write_whole(output / "report.html", page)
    write_whole(results, json.dumps(about, indent=2))
    shutil.rmtree(examples)
    return about


def _data(manifests: Sequence[Manifest]) -> str:
    """The version of data sets: a hash of their shards'."""
    return hashlib.sha256("".join(record.sha256 for m in manifests for record in m.shards).encode()).hexdigest()


def evaluate(
    apart: Sequence[tuple[Path, bool | None]], file: Path, relations: Relations, read: Callable[[], None]
) -> tuple[dict[str, Any], str]:
    """What the trees of a file find in frames that are kept apart: numbers, and the page.

    apart: folders, and of which scenes: those kept apart (True) or all (None). read: called for each frame of them.
    """
    segmenter = Segmenter(relations=file)
    tallies: dict[str, dict[str, Tally]] = {
        "all": defaultdict(Tally),
        "kind": defaultdict(Tally),
        "camera": defaultdict(Tally),
    }
    shown: list[tuple[float, str, str]] = []
    for frame, kind, camera in _frames_apart(apart, read):
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


def _frames_apart(
    apart: Sequence[tuple[Path, bool | None]], read: Callable[[], None] = lambda: None
) -> Iterator[tuple[LabelledFrame, str, str]]:
    """The frames, and the names of each one's kind and camera. read: called for each frame, also of other scenes."""
    for folder, which in apart:
        config = read_manifest(folder).config
        kinds, cameras = list(config["kinds"]), list(config["cameras"])
        for frame in frames_of(folder):
            if which is None or frame.val == which:
                yield frame, kinds[frame.kind], cameras[frame.camera]
            read()


def _examples_apart(apart: Sequence[tuple[Path, bool | None]], relations: Relations) -> dict[str, Examples]:
    kinds = {name: Examples() for name in NAMES}
    frames = ((number, cloud_of(frame), labels_of(frame)) for number, (frame, _, _) in enumerate(_frames_apart(apart)))
    for _, cut in cut_frames(frames, 0.0, 0.0, 0):
        add_pairs(cut, kinds["near"], kinds["far"])
        add_pairs_again(cut, relations.near, relations.far, (kinds["near_again"], kinds["far_again"]))
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
