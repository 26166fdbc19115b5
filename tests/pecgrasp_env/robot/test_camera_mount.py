"""The camera's file: what is written is read, and what is no camera's place is refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot.camera_mount import MountError, mount_of, read_mount, write_mount
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA


@pytest.mark.parametrize("parent", ["tool0", "base"])
def test_a_place_comes_back_as_it_was_written(parent, tmp_path: Path):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=0).as_matrix(), (0.01, -0.12, 0.06)
    write_mount(tmp_path / "camera.yaml", parent, T, {"views": 20})
    np.testing.assert_allclose(read_mount(tmp_path / "camera.yaml", parent), T, atol=1e-8)
    other = {"tool0": "base", "base": "tool0"}[parent]
    with pytest.raises(MountError, match=f"holds parent, T_{parent}_camera, views, and no T_{other}_camera"):
        read_mount(tmp_path / "camera.yaml", other)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("T_tool0_camera: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]", r"shape \(3, 4\) is no transform"),
        ("T_tool0_camera: [[1, 0, 0, 9], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]", r"9 m away: metres"),
        ("T_tool0_camera: [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]", r"no rotation"),
        ("T_tool0_camera: [a, b]", r"T_tool0_camera: .*four rows of four numbers"),
        ("- 1", r"holds list"),
        ("a: [", r"camera.yaml: "),
    ],
)
def test_what_is_no_place_is_refused(text, words, tmp_path: Path):
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.raises(MountError, match=words):
        read_mount(tmp_path / "camera.yaml")


def test_a_setting_is_a_file_a_matrix_or_nothing(tmp_path: Path):
    T = np.eye(4)
    T[:3, 3] = 0.01, -0.1, 0.05
    write_mount(tmp_path / "camera.yaml", "tool0", T, {})
    for setting in (str(tmp_path / "camera.yaml"), T.tolist()):
        np.testing.assert_allclose(mount_of(setting), T)
    assert mount_of(None) is T_TOOL0_CAMERA
    with pytest.raises(MountError, match=r"T_tool0_camera of shape \(2,\)"):
        mount_of([1.0, 2.0])


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(MountError, match=r"none.yaml: No such file"):
        read_mount(tmp_path / "none.yaml")
