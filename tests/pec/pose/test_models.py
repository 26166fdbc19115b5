from dataclasses import replace

import numpy as np
import pytest

from pec.errors import ModelsError
from pec.pose.models import PoseModels, read_models, write_models


def test_a_file_of_models_comes_back(models, tmp_path):
    write_models(tmp_path / "models.safetensors", models)
    found = read_models(tmp_path / "models.safetensors")
    assert (found.names, found.version) == (models.names, models.version)
    np.testing.assert_array_equal(found.points, models.points)
    for one, other in zip(found.symmetries, models.symmetries, strict=True):
        np.testing.assert_array_equal(one, other)


def test_another_shape_is_another_version(models):
    assert replace(models, points=models.points * np.float32(1.01)).version != models.version


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": ("a/b", "a/b")}, "none twice"),
        ({"points": np.zeros((2, 9, 3), np.float32)}, "'hook/ell' is 0 m long"),
        ({"symmetries": (np.eye(4, dtype=np.float32)[None],)}, "2 models, but the symmetries of 1"),
        ({"origins": np.zeros((1, 3), np.float32)}, r"must be finite \(2, 3\)"),
    ],
)
def test_models_that_do_not_fit_are_refused(models, change, message):
    with pytest.raises(ModelsError, match=message):
        replace(models, **change)


def test_millimetres_mirror_images_and_a_first_symmetry_that_moves_are_refused(models):
    with pytest.raises(ModelsError, match=r"'hook/ell' is 98\.\d+ m long.*millimetres"):
        replace(models, points=models.points * np.float32(1000))
    mirror = np.stack([np.eye(4), np.diag([-1.0, 1, 1, 1])]).astype(np.float32)
    with pytest.raises(ModelsError, match=r"'can/tin'.*mirror"):
        replace(models, symmetries=(models.symmetries[0], mirror))
    with pytest.raises(ModelsError, match=r"'can/tin'.*identity"):
        replace(models, symmetries=(models.symmetries[0], models.symmetries[1][1:]))


def test_files_that_are_none_are_named(tmp_path):
    with pytest.raises(ModelsError, match=r"nowhere does not exist"):
        read_models(tmp_path / "nowhere")
    (tmp_path / "text").write_text("not a tensor")
    with pytest.raises(ModelsError, match="text is no file of models"):
        read_models(tmp_path / "text")


def test_a_name_that_is_none_of_theirs(models: PoseModels):
    assert models.index("can/tin") == 1
    with pytest.raises(ModelsError, match=r"'tin'; there are hook/ell, can/tin"):
        models.index("tin")
