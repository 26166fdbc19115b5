"""A class for every point against segmenting first and classifying afterwards, on the same labelled frames.

Three ways from a frame to objects with classes:

- "segment, classify": the segmenter's cut-outs, each with the classifier's answer.
- "points": the network's class of every point; what touches and is of one class is one object.
- "segment, points": the segmenter's cut-outs, each with the class that most of its points have by the network.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from grasping import Segmenter
from grasping.geometry.clustering import by_label, voxel_clusters
from grasping.segmentation.scene import Scene
from pec import Classifier
from pec.data.shards import read_manifest
from pec.errors import ConfigError
from pec.metrics.proportions import mcnemar
from pec.segmentation.scores import scores
from pec.segmentation.segmenter import PointSegmenter
from pecgrasp_env.capture.scenes.cut_outs import FOUND, overlaps
from pecgrasp_env.capture.scenes.frames import FIRST_OBJECT, LabelledFrame, cloud_of, frames_of
from pecgrasp_env.capture.scenes.table_clouds import classes_of, object_classes, pixel_classes, table_cloud
from pecgrasp_env.experiments.segmenter_scores import FEWEST
from pecgrasp_env.experiments.transfer import cluster_interval

__all__ = ["METHODS", "compare_on_frames"]

METHODS = ("segment, classify", "points", "segment, points")
_GAP_M = 0.01  # between points of one class that are two objects
_FEWEST_POINTS = 40  # of an object, as `Segmenter.min_points`
_HALF = 0.5  # visible


@dataclass(frozen=True)
class _Answer:
    """objects: (M,) pixels of each; said: the class of each; of_pixel: (H · W,) the class of each pixel; ms: spent."""

    objects: list[np.ndarray]
    said: list[int]
    of_pixel: np.ndarray
    ms: float


@dataclass
class _Tally:
    """What a way has come to. found: of each object of a class whether it was; right: of each object that it named."""

    found: list[bool] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)
    confusion: list[np.ndarray] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)


def compare_on_frames(
    directory: Path,
    points: PointSegmenter,
    classifier: Classifier,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Any]:
    """What each of `METHODS` finds in all frames of a set, as `results.json` of `pecgrasp evaluate-points` has it.

    An object of a class with 100 measured pixels or more is found where something with an overlap of more than 0.5 has
    its class. Points are those that stand on the table, as `table_clouds` takes them.
    Raises DatasetError where the set is missing, damaged or without classes, ConfigError where network or classifier
    are of other classes.
    """
    manifest = read_manifest(directory)
    classes = classes_of(manifest, directory)
    for name, known in (("checkpoint", points.classes[:-1]), ("classifier", classifier.classes)):
        if set(known) != set(classes[:-1]):
            raise ConfigError(f"{name} knows the classes {', '.join(known)}, the frames {', '.join(classes[:-1])}")
    total = sum(record.n_samples for record in manifest.shards)
    ways, tallies = _Ways(Segmenter(), points, classifier, classes), {name: _Tally() for name in METHODS}
    of_scene: list[int] = []
    visible: list[float] = []
    without_table = 0
    for done, frame in enumerate(frames_of(directory), start=1):
        of_object = object_classes(frame, manifest.classes, classes)
        measured = np.bincount(frame.instance[frame.depth > 0], minlength=256)[FIRST_OBJECT:][: len(of_object)]
        asked = np.flatnonzero((measured >= FEWEST) & (of_object < len(classes) - 1))
        of_scene += [frame.scene] * len(asked)
        visible += frame.visible[asked].tolist()
        answers, standing = ways.of_frame(frame)
        without_table += not len(standing)
        truth = pixel_classes(frame, of_object, len(classes) - 1)[standing]
        for name, answer in answers.items():
            right = _right(answer, frame, of_object)
            tally = tallies[name]
            tally.found += np.asarray(right[:, asked].any(axis=0)).tolist()
            tally.right += np.asarray(right.any(axis=1)).tolist()
            tally.confusion += _confusion(truth, answer.of_pixel[standing], len(classes))
            tally.ms.append(answer.ms)
        progress(done, total)
    return {
        "frames": total,
        "frames_without_table": without_table,
        "classes": classes,
        "n_points": points.n_points,
        "methods": {name: _figures(each, of_scene, visible, classes) for name, each in tallies.items()},
        "comparisons": [_compared(name, tallies) for name in METHODS[1:]],
    }


class _Ways:
    """The three ways, from one frame to their answers."""

    def __init__(
        self, segmenter: Segmenter, points: PointSegmenter, classifier: Classifier, classes: Sequence[str]
    ) -> None:
        self._segmenter, self._points, self._classifier = segmenter, points, classifier
        self._other = len(classes) - 1
        self._number = {name: i for i, name in enumerate(classes)}
        self._own = np.array([classes.index(name) for name in points.classes])

    def of_frame(self, frame: LabelledFrame) -> tuple[dict[str, _Answer], np.ndarray]:
        """What each way says of a frame, and the pixels (N,) of what stands on its table, none where there is none."""
        cloud = cloud_of(frame)
        begin = time.perf_counter()
        scene = self._segmenter.segment(cloud)
        segmented = time.perf_counter() - begin
        classified = self._classified(scene, frame.depth.size, segmented)
        begin = time.perf_counter()
        said = np.full(frame.depth.size, self._other)
        table = table_cloud(scene, cloud)
        if table is not None:
            said[table.pixel] = self._own[self._points.label(table.points)]
        labelled = segmented + time.perf_counter() - begin
        answers = {METHODS[0]: classified, METHODS[1]: self._grown(said, cloud, labelled)}
        voted = [int(np.bincount(said[index]).argmax()) for index in scene.indices]
        answers[METHODS[2]] = self._of_segments(scene.indices, voted, frame.depth.size, labelled)
        return answers, np.empty(0, np.int64) if table is None else table.pixel

    def _classified(self, scene: Scene, n_pixels: int, segmented: float) -> _Answer:
        begin = time.perf_counter()
        large = [k for k, each in enumerate(scene.objects) if len(each) >= self._classifier.n_points]
        said = [self._other] * len(scene.objects)
        predictions = self._classifier.predict([scene.objects[k] for k in large])
        for k, prediction in zip(large, predictions, strict=True):
            said[k] = self._number[prediction.label]
        spent = segmented + time.perf_counter() - begin
        return self._of_segments(scene.indices, said, n_pixels, spent)

    def _grown(self, said: np.ndarray, cloud: np.ndarray, spent: float) -> _Answer:
        """Objects where points of one class lie within 1 cm of each other."""
        begin = time.perf_counter()
        objects: list[np.ndarray] = []
        for number in range(self._other):
            of_class = np.flatnonzero(said == number)
            clusters = by_label(voxel_clusters(cloud.reshape(-1, 3)[of_class].astype(np.float64), _GAP_M))
            objects += [of_class[members] for members in clusters if len(members) >= _FEWEST_POINTS]
        ms = 1e3 * (spent + time.perf_counter() - begin)
        return _Answer(objects, [int(said[index[0]]) for index in objects], said, ms)

    def _of_segments(self, indices: Sequence[np.ndarray], said: Sequence[int], n_pixels: int, spent: float) -> _Answer:
        of_pixel = np.full(n_pixels, self._other)
        for index, number in zip(indices, said, strict=True):
            of_pixel[index] = number
        named = [k for k, number in enumerate(said) if number != self._other]
        return _Answer([indices[k] for k in named], [said[k] for k in named], of_pixel, 1e3 * spent)


def _right(answer: _Answer, frame: LabelledFrame, of_object: np.ndarray) -> np.ndarray:
    """(S, K) bool: whether what was named is an object of that class."""
    same = np.array(answer.said, np.int64)[:, None] == of_object
    return (overlaps(answer.objects, frame) > FOUND) & same


def _confusion(truth: np.ndarray, said: np.ndarray, n: int) -> list[np.ndarray]:
    return [np.bincount(truth * n + said, minlength=n * n).reshape(n, n)]


def _figures(
    tally: _Tally, of_scene: Sequence[int], visible: Sequence[float], classes: Sequence[str]
) -> dict[str, Any]:
    found, half = np.array(tally.found), np.array(visible) >= _HALF
    of_points = scores(torch.from_numpy(sum(tally.confusion, np.zeros((len(classes),) * 2, int))), list(classes))
    return {
        "found": _share(found, np.array(of_scene)),
        "found_half_visible": _share(found[half], np.array(of_scene)[half]),
        "named_rightly": {"count": sum(tally.right), "n": len(tally.right)},
        "accuracy": of_points.accuracy,
        "mean_iou": of_points.mean_iou,
        "iou": of_points.iou,
        "median_ms": round(float(np.median(tally.ms)), 1),
    }


def _share(found: np.ndarray, scene: np.ndarray) -> dict[str, Any]:
    """With its 95 % interval over scenes."""
    if not len(found):
        return {"count": 0, "n": 0, "share": None, "interval": None}
    interval = cluster_interval(found, scene)
    return {"count": int(found.sum()), "n": len(found), "share": float(found.mean()), "interval": interval}


def _compared(name: str, tallies: Mapping[str, _Tally]) -> dict[str, Any]:
    """A way against the first on the same objects."""
    own, first = np.array(tallies[name].found), np.array(tallies[METHODS[0]].found)
    only_own, only_first = int((own & ~first).sum()), int((first & ~own).sum())
    return {
        "method": name,
        "against": METHODS[0],
        "only_it": only_own,
        "only_other": only_first,
        "p": mcnemar(only_own, only_first),
    }
