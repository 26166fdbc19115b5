"""Labelled frames as clouds of whole tables with a class for every point, for `pec.segmentation`.

What stands on the table is what the segmenter's table leaves: measured points that it takes for no table, above its
plane, not too high, and over the outline of the table that is seen. The table itself is left out: it takes nine tenths
of a frame's points, the plane is found in milliseconds, and the height above it is what the network gets as z.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from grasping import Segmenter
from grasping.segmentation.footprints import convex_outline
from grasping.segmentation.object_rules import BESIDE_TABLE
from grasping.segmentation.planes import basis
from grasping.segmentation.scene import Scene
from pec.data.dataset import UNKNOWN
from pec.data.shards import Manifest, read_manifest
from pec.errors import ConfigError, DatasetError
from pec.segmentation.clouds import LabelledClouds, read_clouds, write_clouds
from pec.segmentation.segmenter import FEWEST_POINTS, centred, drawn_points
from pecgrasp_env.capture.scenes.frames import FIRST_OBJECT, LabelledFrame, cloud_of, frames_of

__all__ = [
    "TableCloud",
    "check_apart",
    "classes_of",
    "object_classes",
    "pixel_classes",
    "table_cloud",
    "table_clouds",
]

_HIGHEST_M = 0.45  # as `Segmenter.max_height`


@dataclass(frozen=True)
class TableCloud:
    """points: (N, 3) m, z up from the table, x and y along it. pixel: (N,) of the frame, row by row."""

    points: np.ndarray
    pixel: np.ndarray


def table_cloud(scene: Scene, cloud: np.ndarray) -> TableCloud | None:
    """What stands on the table of a segmented cloud (H, W, 3); None where no table was found or hardly anything is."""
    if scene.plane is None:
        return None
    points = cloud.reshape(-1, 3)
    table = np.isfinite(points[:, 2])
    for index in (*scene.indices, *(each.indices for each in scene.rejected)):
        table[index] = False
    level = basis(scene.plane[:3])
    flat, height = points @ level, points @ scene.plane[:3] + scene.plane[3]
    # What stands on the table hides some of it.
    outline = convex_outline(np.concatenate([flat[table], *(flat[index] for index in scene.indices)]))
    if outline is None:
        return None
    with np.errstate(invalid="ignore"):
        standing = ~table & (height > 0) & (height <= _HIGHEST_M)
    pixel = np.flatnonzero(standing)
    over = (flat[pixel] @ outline[:, :2].T + outline[:, 2] <= BESIDE_TABLE).all(axis=1)
    pixel = pixel[over]
    if len(pixel) < FEWEST_POINTS:
        return None
    return TableCloud(np.column_stack([flat[pixel], height[pixel]]).astype(np.float32), pixel)


def classes_of(manifest: Manifest, directory: Path) -> list[str]:
    """The classes that a set's scenes were asked to have, and UNKNOWN for all else.

    Raises DatasetError for a set that was asked for no classes.
    """
    asked = manifest.config["objects"]["classes"]
    if not asked:
        raise DatasetError(f"{directory} was generated without objects.classes=[…]: no classes to tell apart")
    return [*asked, UNKNOWN]


def object_classes(frame: LabelledFrame, names: Sequence[str], classes: Sequence[str]) -> np.ndarray:
    """(K,) int64: the class of each of a frame's objects, the last where it is none of the others.

    names: those that the frame's class_index counts.
    """
    other = len(classes) - 1
    number = np.array([classes.index(name) if name in classes else other for name in names], np.int64)
    return number[frame.class_index]


def pixel_classes(frame: LabelledFrame, of_object: np.ndarray, other: int) -> np.ndarray:
    """(H · W,) int64: the class of what each pixel shows, `other` where that is no object. of_object: (K,)."""
    of_label = np.full(256, other)
    of_label[FIRST_OBJECT : FIRST_OBJECT + len(of_object)] = of_object
    return of_label[frame.instance.reshape(-1)]


def table_clouds(
    directory: Path, n_points: int, progress: Callable[[int, int], None] = lambda done, total: None
) -> Path:
    """The file of a set's table clouds, `n_points` points each, made where it is not there or of other frames.

    Frames without a table, or with fewer than 64 points on it, are left out.
    Raises DatasetError where the set is missing, unfinished, damaged or without classes.
    """
    manifest = read_manifest(directory)
    if not manifest.complete:
        raise DatasetError(f"{directory} is unfinished: run the same generation command again, it resumes")
    classes = classes_of(manifest, directory)
    path = directory / f"table_clouds_{n_points}.safetensors"
    made_of = json.dumps([record.sha256 for record in manifest.shards])
    if path.is_file() and read_clouds(path, n_points).made_of == made_of:
        return path
    total = sum(record.n_samples for record in manifest.shards)
    segmenter, rng = Segmenter(), np.random.default_rng(0)
    points, labels, distinct, val = [], [], [], []
    for done, frame in enumerate(frames_of(directory), start=1):
        cloud = cloud_of(frame)
        table = table_cloud(segmenter.segment(cloud), cloud)
        progress(done, total)
        if table is None:
            continue
        index = drawn_points(table.points, n_points, rng)
        points.append(centred(table.points[index]))
        of_object = object_classes(frame, manifest.classes, classes)
        labels.append(pixel_classes(frame, of_object, len(classes) - 1)[table.pixel[index]].astype(np.uint8))
        distinct.append(min(n_points, len(table.points)))
        val.append(frame.val)
    if not points:
        raise DatasetError(f"{directory} has no frame with anything on a table")
    clouds = LabelledClouds(
        torch.from_numpy(np.stack(points)),
        torch.from_numpy(np.stack(labels)),
        torch.tensor(distinct),
        torch.tensor(val, dtype=torch.uint8),
        classes,
        made_of,
    )
    write_clouds(path, clouds)
    return path


def check_apart(training: Path, test: Path) -> None:
    """Raises ConfigError where two sets of frames share objects: test scenes are to show none that training saw."""
    one, other = (read_manifest(folder).config["objects"] for folder in (training, test))
    if one["path"] is not None and one["path"] == other["path"]:
        raise ConfigError(f"{test} draws its objects from the folder {one['path']}, and {training} does, too")
    for name in ("catalogue_instances", "plain_instances"):
        if one["seed"] < other["seed"] + other[name] and other["seed"] < one["seed"] + one[name]:
            raise ConfigError(
                f"{test} shares objects with {training}: objects.seed={other['seed']} and {one['seed']} with "
                f"objects.{name} {other[name]} and {one[name]}; generate one of them with another objects.seed"
            )
