"""Clouds and frames whose objects' poses are known: generated data sets, generated frames, and posed real views."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasping.errors import DAMAGED_NPZ
from grasping.pose.object_model import ObjectModel, object_model
from pec.data.dataset import UNKNOWN
from pec.data.shards import read_manifest, read_shard
from pec.errors import DatasetError
from pecgrasp_env.capture.scenes.frames import FIRST_OBJECT, read_frames
from pecgrasp_env.objects.mesh_folder import MeshFolder

HALF_A_PIXEL = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])  # our cameras count from the corner


@dataclass(frozen=True, eq=False)
class CloudCase:
    """A cut-out of one known object.

    name: of the case, unique. model: what it shows. points: (N, 3) m, camera frame. T_true: (4, 4) T_camera_object.
    occlusion: share of the object that others hide.
    """

    name: str
    model: ObjectModel
    points: np.ndarray
    T_true: np.ndarray
    occlusion: float


@dataclass(frozen=True, eq=False)
class FrameCase:
    """A whole frame of known objects and strangers.

    cloud: (H, W, 3) m, camera frame, NaN where nothing was measured. camera: (3, 3) matrix, pixel centres at whole
    numbers. labels: (H, W), k + 1 where object k is, 0 elsewhere. names: of the objects' models, None: a stranger.
    T_true: (K, 4, 4) T_camera_object. visible: (K,) shares that others leave to be seen.
    """

    name: str
    kind: str
    cloud: np.ndarray
    camera: np.ndarray
    labels: np.ndarray
    names: tuple[str | None, ...]
    T_true: np.ndarray
    visible: np.ndarray


def cloud_cases(folder: Path, per_object: int) -> Iterator[CloudCase]:
    """The first so many clouds of each object of a data set that `pecgrasp generate` left, whose meshes are a folder's.

    Raises DatasetError for another data set.
    """
    manifest = read_manifest(folder)
    models = _models(folder, manifest.config["objects"], manifest.instances)
    seen: dict[int, int] = {}
    for record in manifest.shards:
        shard = read_shard(folder / record.file, record)
        for k in range(len(shard)):
            index = int(shard.instance_index[k])
            if manifest.instances[index]["class"] == UNKNOWN:  # a stranger has no pose to be found
                continue
            seen[index] = seen.get(index, 0) + 1
            if seen[index] <= per_object:
                yield CloudCase(
                    f"{folder.name}/{record.file}/{k}",
                    models(index),
                    shard.cloud(k).astype(np.float64),
                    shard.T_camera_object[k].astype(np.float64),
                    float(shard.occlusion[k]),
                )


def partly_hidden(case: CloudCase, share: float) -> CloudCase:
    """The case with that share of its points, in [0, 1), out of sight beyond a straight edge, as of a thing in front.

    The edge's direction in the picture follows from the case's name. Of nothing hidden it is the case itself.
    """
    if share == 0:
        return case
    turn = 2 * np.pi * zlib.crc32(case.name.encode()) / 2**32
    across = case.points[:, :2] / case.points[:, 2:] @ np.array([np.cos(turn), np.sin(turn)])
    return replace(
        case,
        name=f"{case.name}, {share:g} hidden",
        points=case.points[across >= np.quantile(across, share)],
        occlusion=1 - (1 - case.occlusion) * (1 - share),
    )


def frame_cases(folder: Path, most: int) -> tuple[list[ObjectModel], Iterator[FrameCase]]:
    """The models of a folder's classes, one instance each, and the first frames that `pecgrasp generate-scenes` left.

    What is of none of the folder's classes is a stranger. Raises DatasetError where a class has two instances: the
    frames do not say which they show.
    """
    manifest = read_manifest(folder)
    settings = manifest.config["objects"]
    meshes = MeshFolder(settings["path"], settings["scale"], allow_open=settings["allow_open"])
    several = [name for name in meshes.classes if len(meshes.names(name)) > 1]
    if several:
        raise DatasetError(f"{folder}: class {several[0]} has several meshes; frames tell classes, one mesh each")
    models = {name: model_of(meshes, name, 0) for name in meshes.classes}

    def frames() -> Iterator[FrameCase]:
        count = 0
        for record in manifest.shards:
            for frame in read_frames(folder / record.file):
                if count >= most:
                    return
                count += 1
                T_camera_world = np.linalg.inv(frame.T_world_camera)
                rows, columns = np.indices(frame.depth.shape) + 0.5
                z = np.where(frame.depth > 0, frame.depth, np.nan).astype(np.float64)
                x = (columns - frame.K[0, 2]) / frame.K[0, 0] * z
                y = (rows - frame.K[1, 2]) / frame.K[1, 1] * z
                labels = frame.instance.astype(np.int64) - FIRST_OBJECT + 1
                labels[(labels < 1) | (labels > len(frame.class_index))] = 0
                names = [manifest.classes[k] for k in frame.class_index]
                yield FrameCase(
                    f"{folder.name}/{record.file}/{count}",
                    list(manifest.config["kinds"])[frame.kind],
                    np.stack([x, y, z], axis=-1),
                    frame.K - HALF_A_PIXEL,
                    labels,
                    tuple(models[name].name if name in models else None for name in names),
                    np.stack([T_camera_world @ _matrix(pose) for pose in frame.pose]),
                    frame.visible.astype(np.float64),
                )

    return list(models.values()), frames()


def real_views(file: Path) -> Iterator[CloudCase]:
    """Posed real views of one object, a cut-out each, of a file as conf/evaluate_pose.yaml says.

    Raises DatasetError where the file is not such a one.
    """
    try:
        with np.load(file) as data:
            depth = data["depth"].astype(np.float64) * float(data["depth_scale_m"])
            K, poses = data["K"], data["T_camera_object"]
            vertices, faces = data["mesh_vertices"], data["mesh_faces"]
    except DAMAGED_NPZ as error:
        raise DatasetError(f"{file} has no posed views as conf/evaluate_pose.yaml wants them: {error}") from error
    model = object_model(vertices, faces, file.stem, allow_open=True)
    rows, columns = np.indices(depth.shape[1:])
    ray = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones(depth.shape[1:])], axis=-1)
    for k, (image, pose) in enumerate(zip(depth, poses, strict=True)):
        yield CloudCase(f"{file.stem}/{k}", model, ray[image > 0] * image[image > 0][:, None], pose, 0.0)


def _models(folder: Path, settings: Mapping[str, Any], instances: list[dict[str, Any]]) -> Any:
    if settings.get("source") != "folder":
        raise DatasetError(f"{folder}: its objects are no folder's meshes; generate it with dataset=folder")
    meshes = MeshFolder(settings["path"], settings["scale"], settings["classes"], settings["allow_open"])
    made: dict[int, ObjectModel] = {}

    def model(index: int) -> ObjectModel:
        if index not in made:
            name, label = str(instances[index]["name"]), str(instances[index]["class"])
            made[index] = model_of(meshes, label, meshes.names(label).index(name))
        return made[index]

    return model


def model_of(meshes: MeshFolder, label: str, number: int) -> ObjectModel:
    """In the frame in which the objects are posed, whose origin is not the file's."""
    mesh = meshes.load(label, number).visual_mesh()
    name = f"{label}/{meshes.names(label)[number]}"
    return object_model(np.asarray(mesh.vertices), np.asarray(mesh.faces), name, label, allow_open=True)


def _matrix(pose: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = pose[:3], Rotation.from_quat(np.roll(pose[3:], -1)).as_matrix()
    return T
