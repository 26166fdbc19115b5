"""The models of a generated data set, for the network that learns their poses: points and symmetries of its meshes."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np

from grasping.errors import ModelError
from grasping.pose.object_model import object_model
from pec.data.shards import read_manifest
from pec.errors import ModelsError
from pec.pose.models import PoseModels, write_models
from pecgrasp_env.capture.shard_plan import known_source
from pecgrasp_env.objects import UNKNOWN, ObjectError
from pecgrasp_env.objects.mesh_folder import MeshFolder

__all__ = ["write_pose_models"]


def write_pose_models(
    directory: str | os.PathLike[str],
    path: str | os.PathLike[str],
    progress: Callable[[int, int], None] | None = None,
) -> PoseModels:
    """Write the models of the data set in `directory`, strangers left out, to the file `path`.

    Those of a mesh folder are in the frames of their files, others in their object frames. progress(done, total), in
    models, is called at the start and after each.
    Raises DatasetError where there is no data set, ModelsError where its meshes are gone or of no use for poses.
    """
    manifest = read_manifest(directory)
    known = [instance for instance in manifest.instances if instance["class"] != UNKNOWN]
    names, points, symmetries, origins = [], [], [], []
    try:
        source = known_source(manifest)
        for done, instance in enumerate(known):
            if progress:
                progress(done, len(known))
            class_name, name = instance["class"], instance["name"]
            number = source.names(class_name).index(name)
            mesh = source.load(class_name, number).visual_mesh()
            origin = source.file_origin(class_name, number) if isinstance(source, MeshFolder) else np.zeros(3)
            model = object_model(mesh.vertices - origin, mesh.faces, f"{class_name}/{name}", allow_open=True)
            names.append(model.name)
            points.append(model.points)
            symmetries.append(np.concatenate([np.eye(4)[None], model.symmetry.transforms()]).astype(np.float32))
            origins.append(origin)
    except (KeyError, ModelError, ObjectError, ValueError) as error:
        raise ModelsError(f"the meshes of {directory} give no models: {error}") from error
    if progress:
        progress(len(known), len(known))
    models = PoseModels(
        tuple(names), np.stack(points).astype(np.float32), tuple(symmetries), np.stack(origins).astype(np.float32)
    )
    write_models(path, models)
    return models
