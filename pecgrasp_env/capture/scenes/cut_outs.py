"""Labelled frames as clouds of single objects, cut out by the segmenter, for the classifier that sorts them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from grasping import Segmenter
from pec.data.dataset import UNKNOWN
from pec.data.shards import (
    MANIFEST_NAME,
    CloudSample,
    Manifest,
    read_manifest,
    shard_name,
    write_manifest,
    write_shard,
)
from pec.errors import DatasetError
from pecgrasp_env.capture.scenes.frames import FIRST_OBJECT, LabelledFrame, cloud_of, read_frames
from pecgrasp_env.capture.scenes.table_clouds import classes_of

__all__ = ["FOUND", "cut_out_clouds", "overlaps"]

FOUND = 0.5
"""Intersection over union from which a cut-out is an object."""
_FEWEST = 64  # points, what the published network takes


def overlaps(indices: list[np.ndarray], frame: LabelledFrame) -> np.ndarray:
    """(S, K): intersection over union of sets of pixels (M,) with the measured pixels of each of a frame's objects."""
    own = np.where(frame.depth > 0, frame.instance, 0).reshape(-1).astype(np.int64)
    count = FIRST_OBJECT + len(frame.class_index)
    own[own >= count] = 0
    sizes = np.bincount(own, minlength=count)
    both = np.array([np.bincount(own[index], minlength=count) for index in indices]).reshape(len(indices), count)
    union = np.array([len(index) for index in indices]).reshape(-1, 1) + sizes - both
    return (both / np.maximum(union, 1))[:, FIRST_OBJECT:]


def cut_out_clouds(
    frames: Path, directory: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> Path:
    """Write a data set of what the segmenter cuts out of frames, or what is missing of it; returns `directory`.

    A cut-out with an overlap of 0.5 or more with an object is of its class; all else, parts, several things together
    and objects of no class, is UNKNOWN. An instance is an object in a scene, in all of the scene's frames, or what is
    wrong in that scene; scenes that the frames keep apart are left out. progress(done, total) counts frames.
    Raises DatasetError where the frames are missing, unfinished, damaged or without classes, or `directory` holds other
    clouds.
    """
    source = read_manifest(frames)
    if not source.complete:
        raise DatasetError(f"{frames} is unfinished: run the same generation command again, it resumes")
    classes = classes_of(source, frames)
    objects = range(int(source.config["most"]) + 1)  # the last: what is none of a scene's objects
    instances = [
        {"name": f"{scene}_{row}_{name}", "class": name}
        for scene in range(int(source.config["scenes"]))
        for row in objects
        for name in classes
    ]
    number = {entry["name"]: i for i, entry in enumerate(instances)}
    config = {"cut_out_of": [record.sha256 for record in source.shards]}
    manifest = Manifest(classes, instances, source.cameras, config, source.seed, source.generator)
    if (directory / MANIFEST_NAME).is_file():
        found = read_manifest(directory)
        if found.config != manifest.config:
            raise DatasetError(f"{directory} holds clouds of other frames: give another folder, or remove it")
        manifest = found
    segmenter = Segmenter()
    total = sum(record.n_samples for record in source.shards)
    done = sum(record.n_samples for record in source.shards[: len(manifest.shards)])
    for shard in source.shards[len(manifest.shards) :]:
        samples: list[CloudSample] = []
        rejected = Counter[str]()
        for frame in read_frames(frames / shard.file):
            if not frame.val:
                samples += _cut_outs(frame, segmenter, source.classes, classes, number, rejected)
            done += 1
            progress(done, total)
        record = write_shard(directory / shard_name(len(manifest.shards)), samples)
        record = replace(record, rejected=dict(sorted(rejected.items())))
        manifest = replace(manifest, shards=[*manifest.shards, record], complete=done == total)
        write_manifest(directory, manifest)
    return directory


def _cut_outs(
    frame: LabelledFrame,
    segmenter: Segmenter,
    names: list[str],
    classes: list[str],
    number: dict[str, int],
    rejected: Counter[str],
) -> list[CloudSample]:
    scene = segmenter.segment(cloud_of(frame))
    T_camera_world = np.linalg.inv(frame.T_world_camera)
    samples = []
    for points, overlap in zip(scene.objects, overlaps(scene.indices, frame), strict=True):
        if len(points) < _FEWEST:
            rejected["too few points"] += 1
            continue
        row, name, T, hidden = len(frame.class_index), UNKNOWN, np.eye(4), 0.0
        if overlap.max(initial=0.0) >= FOUND:
            row = int(overlap.argmax())
            of_object = names[frame.class_index[row]]
            name = of_object if of_object in classes else UNKNOWN
            T[:3, :3] = Rotation.from_quat(np.roll(frame.pose[row, 3:], -1)).as_matrix()
            T[:3, 3] = frame.pose[row, :3]
            T, hidden = T_camera_world @ T, 1.0 - float(frame.visible[row])
        place = classes.index(name), number[f"{frame.scene}_{row}_{name}"]
        best = float(overlap.max(initial=0.0))
        samples.append(CloudSample(points, *place, T, frame.seed, frame.camera, hidden, best))
    return samples
