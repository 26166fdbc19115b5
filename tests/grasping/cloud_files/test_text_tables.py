"""ASCII .ply and .pcd: numbers are counted, not lines, and every row is held against the header."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grasping import CloudError
from grasping.cloud_files import read_cloud

POINTS = np.array([[0.125, -0.25, 0.5], [1.5, 0.25, 2.0], [3.0, -4.0, 5.0]], np.float32)
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\n{}end_header\n"
)
FACES = "element face 2\nproperty list uchar int vertex_indices\n"
PCD = "VERSION .7\nFIELDS x y z {}\nSIZE 4 4 4 4\nTYPE {}\nCOUNT 1 1 1 {}\nWIDTH {}\nHEIGHT {}\nPOINTS 3\nDATA ascii\n"


def read(tmp_path: Path, name: str, text: str) -> np.ndarray:
    (tmp_path / name).write_bytes(text.encode())
    return read_cloud(tmp_path / name)


def body(between: str, end: str, colour: str = "10 20 30") -> str:
    return "".join(f"{x} {y} {z}{between}{colour}{end}" for x, y, z in POINTS.tolist())


@pytest.mark.parametrize(
    "text",
    [
        PLY.format("") + body("\n", " \n"),  # a viewer's: colours on a line of their own
        PLY.format("") + body(" ", " "),  # everything in one line
        PLY.format("") + body(" ", "\n\n"),  # blank lines between
        PLY.format("").replace("\n", "\r") + body(" ", "\r"),
        "\ufeff" + PLY.format("") + body("\t", "\r\n"),
        PLY.format("").replace("float x", "float X") + body(" ", "\n"),
        PLY.format(FACES) + body("\n", "\n") + "3 0 1 2\n3 2 1 0\n",
        PLY.format(FACES) + body("\n", "\n") + "3 0 1\n2 4 0 1\n2 1\n",  # faces, too, and of different lengths
        PLY.format(FACES + "property float quality\n") + body("\n", "\n") + "2 0 1 0.5 0 1\n",
        PLY.format("") + body(" ", "\n").replace(" 0.25", " 2.5D-01"),
    ],
)
def test_vertices_of_a_text_ply_come_back_however_its_lines_end(tmp_path: Path, text: str) -> None:
    np.testing.assert_array_equal(read(tmp_path, "a.ply", text), POINTS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # Colours that the header lacks, or promises and does not have.
        (
            PLY.format("").replace("property uchar red\n", "") + body(" ", "\n"),
            "line 10 holds 6 numbers, and a vertex has 5",
        ),
        (PLY.format("") + body(" ", "\n", ""), "line 11 holds 3 numbers, and a vertex has 6 .*: x, y, z, red"),
        (PLY.format("") + body(" ", "\n") + "1 2 3 4 5 6\n", "line 14: more follows than the header promises"),
        (PLY.format(FACES) + body(" ", "\n") + "3 0 1 2\n", "promises 2 rows of face and holds 1"),
        (PLY.format(FACES) + body(" ", "\n", "1 2") + "3 0 1 2\n" * 2, "line 13 holds 5 numbers"),
        (
            PLY.format("") + body(" ", "\n").replace(".", ","),
            "line 11: '0,125' is not a number: a decimal comma.* 0.125",
        ),
        (PLY.format("") + body(" ", "\n").replace(" ", ";"), "line 11: '0.125;.*numbers stand apart by blanks"),
        (PLY.format("") + body(" ", "\n").replace(" ", ", "), "line 11: '0.125,' .*numbers stand apart by blanks"),
        (PLY.format("") + body(" ", "\n").replace("1.5", "1_5"), "line 12: '1_5' is not a number"),
        (PLY.format("") + body(" ", "\n").replace("1.5", "1,234.5"), "commas between thousands.* 1234.5"),
        (PLY.format("") + body(" ", "\n").replace(" 0.25", " null"), "'null' is not a number: write nan"),
    ],
)
def test_a_text_ply_that_is_not_as_its_header_says_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(CloudError, match=message):
        read(tmp_path, "a.ply", text)


def test_points_are_not_taken_for_the_colours_of_others(tmp_path: Path) -> None:
    """As many numbers as the header promises, in rows of three where it says six."""
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in np.vstack([POINTS, POINTS[::-1]]).tolist())
    with pytest.raises(CloudError, match=r"point 0 would have red = 1.5, which is no uint8"):
        read(tmp_path, "a.ply", PLY.format("") + rows)
    pcd = PCD.format("a b c", "F F F U", 1, 3, 1).replace("4\nTYPE F F F U\nCOUNT 1 1 1 1", "4 1 1\nTYPE F F F U U U")
    with pytest.raises(CloudError, match=r"point 0 would have a = 1.5, which is no uint32"):
        read(tmp_path, "a.pcd", pcd.replace("COUNT 1 1 1 1\n", "") + rows)


def test_a_binary_body_that_is_longer_than_its_header_says_is_refused(tmp_path: Path) -> None:
    rows = np.column_stack([POINTS, POINTS]).astype("<f4").tobytes()
    ply = PLY.format("").replace("ascii", "binary_little_endian").replace("property uchar red\n", "")
    ply = ply.replace("property uchar green\nproperty uchar blue\n", "").encode()
    pcd = PCD.format("_", "F F F F", 1, 3, 1).replace("ascii", "binary").encode()
    for name, content in {"a.ply": ply + rows, "a.pcd": pcd + rows}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CloudError, match="bytes are left behind its 3 points"):
            read_cloud(tmp_path / name)
    four = np.column_stack([POINTS, POINTS[:, 0]]).astype("<f4").tobytes()
    (tmp_path / "a.pcd").write_bytes(pcd + four + bytes(4096))  # old versions of the library add a page of zeros
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.pcd"), POINTS)


def test_types_of_a_pcd_may_be_in_lower_case(tmp_path: Path) -> None:
    for types in ("f f f u", "F F F U", "f F f i"):
        text = PCD.format("rgb", types, 1, 3, 1) + body(" ", "\n", "7")
        np.testing.assert_array_equal(read(tmp_path, "a.pcd", text), POINTS)
        np.testing.assert_array_equal(read(tmp_path, "b.pcd", text.replace("x y z", "X Y Z").lower()), POINTS)


def test_a_pcd_counts_the_numbers_of_all_its_fields(tmp_path: Path) -> None:
    header = PCD.format("fpfh", "F F F F", 3, 3, 1)
    np.testing.assert_array_equal(read(tmp_path, "a.pcd", header + body("\n", "\n")), POINTS)
    with pytest.raises(CloudError, match="line 10 holds 4 numbers, and a point has 6 by the header: FIELDS x y z fpfh"):
        read(tmp_path, "a.pcd", header + body(" ", "\n", "7"))
    with pytest.raises(CloudError, match="promises 3 points and holds 4"):
        read(tmp_path, "a.pcd", header + body(" ", "\n") + "1 2 3 4 5 6\n")


@pytest.mark.parametrize(("width", "height"), [(1, 3), (3, 1)])
def test_one_row_or_one_column_is_a_loose_cloud_in_every_format(tmp_path: Path, width: int, height: int) -> None:
    image = POINTS.reshape(height, width, 3)
    np.save(tmp_path / "a.npy", image)
    np.savez(tmp_path / "a.npz", points=image)
    text = PCD.format("rgb", "F F F U", 1, width, height) + body(" ", "\n", "7")
    for cloud in (read_cloud(tmp_path / "a.npy"), read_cloud(tmp_path / "a.npz"), read(tmp_path, "a.pcd", text)):
        np.testing.assert_array_equal(cloud, POINTS)
