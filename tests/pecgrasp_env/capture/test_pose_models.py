"""The models that the pose network learns: in the frames of their files, with the turns that leave them as they are."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pec.data.shards import Manifest, write_manifest
from pec.errors import ModelsError
from pec.pose.models import read_models
from pecgrasp_env.capture.pose_models import write_pose_models
from pecgrasp_env.objects import Catalogue, ObjectError
from pecgrasp_env.objects.mesh_folder import MeshFolder

CENTRE = np.array([0.3, -0.1, 0.05])
SIDES = np.array([0.12, 0.08, 0.04])


def data_set(directory: Path, objects: dict[str, Any], *instances: tuple[str, str]) -> Path:
    """The manifest of a data set; its clouds say nothing of its models."""
    listed = [{"class": class_name, "name": name} for class_name, name in instances]
    classes = list(dict.fromkeys(class_name for class_name, _ in instances))
    write_manifest(directory, Manifest(classes, listed, [], {"objects": objects}, 0, {}, [], complete=True))
    return directory


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One box, off its file's origin, in millimetres."""
    root = tmp_path_factory.mktemp("meshes")
    (root / "box").mkdir()
    box = trimesh.creation.box(1000 * SIDES)
    box.apply_translation(1000 * CENTRE)
    box.export(root / "box" / "brick.ply")
    return root


def test_a_model_of_a_folder_is_in_the_frame_of_its_file(folder, tmp_path):
    objects = {"source": "folder", "path": str(folder), "scale": 0.001, "strangers": 4, "strangers_samples": 10}
    steps: list[tuple[int, int]] = []
    data_set(tmp_path, objects, ("box", "brick"), ("unknown", "thing_3"))
    write_pose_models(tmp_path, tmp_path / "models.safetensors", lambda *step: steps.append(step))
    models = read_models(tmp_path / "models.safetensors")
    assert (models.names, steps) == (("box/brick",), [(0, 1), (1, 1)])
    on_surface = np.isclose(np.abs(models.points[0] - CENTRE), SIDES / 2, atol=1e-5).any(axis=1)
    assert on_surface.all()
    np.testing.assert_allclose(models.origins[0], -CENTRE, atol=1e-5)  # a box's object frame is in its middle
    np.testing.assert_allclose(models.origins[0], MeshFolder(folder, 0.001).file_origin("box", 0), atol=1e-7)
    turns = np.round(models.symmetries[0][:, :3, :3].diagonal(axis1=1, axis2=2)).astype(int)
    assert {tuple(turn) for turn in turns} == {(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)}


def test_a_model_of_the_catalogue_is_in_its_object_frame(tmp_path):
    catalogue = Catalogue(("can",), 1, 0)
    objects = {"source": "catalogue", "classes": ["can"], "instances_per_class": 1}
    data_set(tmp_path, objects, ("can", catalogue.names("can")[0]))
    models = write_pose_models(tmp_path, tmp_path / "models.safetensors")
    np.testing.assert_array_equal(models.origins, np.zeros((1, 3)))
    extents = catalogue.load("can", 0).extents
    np.testing.assert_allclose(np.ptp(models.points[0], axis=0), extents, rtol=0.1)


def test_a_name_that_the_source_does_not_have_is_an_error(tmp_path):
    objects = {"source": "catalogue", "classes": ["can"], "instances_per_class": 1}
    data_set(tmp_path, objects, ("can", "no such can"))
    with pytest.raises(ModelsError, match="give no models"):
        write_pose_models(tmp_path, tmp_path / "models.safetensors")


def test_meshes_that_are_gone_are_named(tmp_path):
    data_set(tmp_path, {"source": "folder", "path": str(tmp_path / "gone")}, ("box", "brick"))
    with pytest.raises(ModelsError, match="gone"):
        write_pose_models(tmp_path, tmp_path / "models.safetensors")
    with pytest.raises(ObjectError, match="asked for 3"):
        MeshFolder(_with_a_box(tmp_path)).file_origin("box", 3)


def _with_a_box(root: Path) -> Path:
    (root / "there" / "box").mkdir(parents=True)
    trimesh.creation.box(SIDES).export(root / "there" / "box" / "a.ply")
    return root / "there"
