"""Clouds come back from files as they were, whatever wrote them."""

from pathlib import Path

import numpy as np
import pytest

from pec.cloud_files import read_cloud
from pec.errors import CloudError

POINTS = np.array([[0.1, -0.2, 0.5], [1.5, 0.25, 2.0], [3.0, -4.0, 5.0]], np.float32)
_PLY = (
    "ply\nformat {} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
)
_PCD = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    "WIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA {}\n"
)


def _rows(color: str) -> bytes:
    dtype = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("color", color)])
    return np.array([(*row, 7) for row in POINTS.tolist()], dtype).tobytes()


def _ascii() -> bytes:
    return "".join(f"{x} {y} {z} 7\n" for x, y, z in POINTS.tolist()).encode()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", _PLY.format("ascii").encode() + b"end_header\n" + _ascii()),
        ("b.ply", _PLY.format("binary_little_endian").encode() + b"element face 0\nend_header\n" + _rows("u1")),
        ("a.pcd", _PCD.format("ascii").encode() + _ascii()),
        ("b.pcd", _PCD.format("binary").encode() + _rows("<u4")),
    ],
)
def test_points_come_back(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    np.testing.assert_array_equal(read_cloud(tmp_path / name), POINTS)


def test_organised_array_loses_what_the_camera_missed(tmp_path):
    frame = np.full((2, 3, 3), np.nan)
    frame[1] = POINTS
    np.save(tmp_path / "frame.npy", frame)
    np.testing.assert_array_equal(read_cloud(tmp_path / "frame.npy"), POINTS)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", b"solid\nend_header\n", "does not begin with 'ply'"),
        ("b.ply", _PLY.format("ascii").encode() + b"end_header\n0 0 0 7\n", "promises 3 points and holds 1"),
        ("c.ply", b"ply\nformat ascii 1.0\n", "no end_header"),
        ("a.pcd", _PCD.format("binary_compressed").encode(), "binary_compressed is not supported"),
        ("b.pcd", _PCD.format("binary").encode() + b"\0" * 20, r"b\.pcd"),
        ("a.xyz", b"", r"read from \.npy, \.ply, \.pcd, not \.xyz"),
    ],
)
def test_broken_file_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CloudError, match=message):
        read_cloud(tmp_path / name)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.ply does not exist"):
        read_cloud(tmp_path / "nothing.ply")


def test_real_mesh_file_is_read():
    path = Path(__file__).parents[2] / "../shared/data/meshes/ycb5/mug/025_mug.ply"
    if not path.is_file():
        pytest.skip("the meshes of ../shared/data are not here")
    points = read_cloud(path)
    assert len(points) > 1000
    assert 0.05 < np.ptp(points, axis=0).max() < 0.2
