"""A depth image is taken with intrinsics that can be its own, and with no others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grasping import CloudError
from grasping.cloud_files import read_cloud

K = np.array([[70.0, 0, 39], [0, 71, 31.5], [0, 0, 1]])
DEPTH = np.full((60, 80), 800, np.uint16)


def changed(row: int, column: int, value: float) -> np.ndarray:
    k = K.copy()
    k[row, column] = value
    return k


def read(tmp_path: Path, **arrays: np.ndarray | float) -> np.ndarray:
    np.savez(tmp_path / "frame.npz", **{"depth": DEPTH, "K": K, **arrays})
    return read_cloud(tmp_path / "frame.npz")


@pytest.mark.parametrize(
    ("arrays", "scale"),
    [
        ({}, 1),
        ({"depth": DEPTH.astype(np.float32) / 1000}, 1),
        ({"depth_scale": 0.001}, 1),
        ({"depth_scale": np.array([0.00025])}, 0.25),
        ({"depth": DEPTH / 1000, "depth_scale": 1.0}, 1),
        ({"depth": DEPTH[..., None]}, 1),
        ({"depth": DEPTH[None]}, 1),
        ({"K": changed(0, 1, 0.01)}, 1),  # a hundredth of a pixel
    ],
)
def test_a_pixel_lies_on_its_ray_at_its_depth(tmp_path: Path, arrays: dict, scale: float) -> None:
    frame = read(tmp_path, **arrays)
    assert frame.shape == (60, 80, 3)
    np.testing.assert_allclose(frame[20, 60], scale * np.array([0.8 * 21 / 70, 0.8 * -11.5 / 71, 0.8]), rtol=1e-6)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"K": K.T}, r"\[39, 31.5, 1\]\]: it is transposed: save K.T"),
        ({"K": changed(2, 2, 2)}, "its last row must be 0 0 1"),
        ({"K": np.column_stack([K, np.zeros(3)])}, r"shape \(3, 4\).*save K\[:, :3\]"),
        ({"K": np.array([70, 71, 39, 31.5])}, r"shape \(4,\).*save \[\[fx, 0, cx\]"),
        ({"K": K.reshape(-1)}, r"shape \(9,\).*K.reshape\(3, 3\)"),
        ({"K": changed(0, 2, np.nan)}, "is not finite"),
        ({"K": changed(0, 0, -70)}, "focal lengths -70 and 71 must be positive"),
        ({"K": changed(0, 1, 8)}, "terms beside the focal lengths"),
        (
            {"K": np.array([[1.88, 0, 39], [0, 1.88, 31.5], [0, 0, 1]])},
            "focal lengths 1.88 and 1.88 .* 80 × 60.*pixels",
        ),
        ({"K": np.array([[0.9, 0, 0.5], [0, 1.2, 0.5], [0, 0, 1]])}, "focal lengths 0.9 and 1.2"),
        # The colour camera's, of twice and of 8 / 5 the size; the other way round; a part of an image; x and y swapped.
        ({"K": K * [[2], [2], [1]]}, r"centre 78, 63 is far from the middle .* 80 × 60. Is it of one of 156 × 126"),
        ({"K": K * [[1.6], [1.6], [1]]}, "centre 62.4, 50.4"),
        ({"K": K * [[2 / 3], [2 / 3], [1]]}, "centre 26, 21"),
        ({"K": changed(0, 2, -21)}, "centre -21, 31.5 .*with depth 0"),
        ({"K": np.array([[70.0, 0, 31.5], [0, 71, 39], [0, 0, 1]])}, "centre 31.5, 39"),
        ({"depth_scale": 1000.0}, "'depth_scale': 1000 is not the metres .* 0.001 for millimetres"),
        ({"depth_scale": 1.0}, "'depth_scale': 1 is not the metres in a unit of uint16"),
        ({"depth_scale": np.ones((2, 2))}, r"'depth_scale': shape \(2, 2\)"),
        ({"depth": DEPTH.astype(np.uint8)}, "'depth': uint8 has too few steps"),
        ({"depth": np.zeros((5, 60, 80))}, r"shape \(5, 60, 80\).*save one frame"),
    ],
)
def test_what_cannot_be_of_this_image_is_refused_with_its_value(tmp_path: Path, arrays: dict, message: str) -> None:
    with pytest.raises(CloudError, match=message):
        read(tmp_path, **arrays)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((40, 4)), r"shape \(40, 4\).* of 4 columns save the three of the points"),
        (np.zeros((3, 40)), "save its transpose"),
        (np.zeros((60, 80)), 'a depth image is read from a .npz with arrays "depth" and "K"'),
        (np.zeros((4, 8, 9, 3)), "a file holds one cloud"),
    ],
)
def test_an_array_of_another_form_says_what_to_save(tmp_path: Path, array: np.ndarray, message: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(CloudError, match=message):
        read_cloud(tmp_path / "a.npy")


def test_of_six_columns_the_first_three_are_the_points(tmp_path: Path) -> None:
    coloured = np.random.default_rng(0).random((5, 6)).astype(np.float32)
    np.save(tmp_path / "a.npy", coloured)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.npy"), coloured[:, :3])
