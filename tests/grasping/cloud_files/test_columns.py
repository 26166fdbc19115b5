"""Columns of text come back as they were meant, or the line is named that could be meant in two ways."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grasping import CloudError
from grasping.cloud_files import SUFFIXES, read_cloud

POINTS = np.array([[0.125, -0.25, 0.5], [1.5, 0.25, 2.0], [3.0, -4.0, 5.0]], np.float32)
ROWS = POINTS.tolist()


def table(apart: str, end: str = "\n", more: str = "") -> str:
    return "".join(apart.join(map(str, row)) + more + end for row in ROWS)


def read(tmp_path: Path, text: str, name: str = "a.csv") -> np.ndarray:
    (tmp_path / name).write_bytes(text.encode())
    return read_cloud(tmp_path / name)


@pytest.mark.parametrize("name", ["a.xyz", "a.csv", "a.txt", "a.asc", "a.PTS"])
@pytest.mark.parametrize(
    "text",
    [
        table(" "),
        table("\t", "\r\n"),
        table(",", ",\n"),
        table(" , "),
        table(";"),
        table(" ; ", " ;\n\n"),
        "\ufeffx;y;z\r\n" + table(";", "\r\n"),
        "x [m], y [m], z [m]\n" + table(", "),
        '"X","Y","Z","name"\n' + table(",", more=',"a mug"'),
        "".join(f'"{x}","{y}","{z}"\n' for x, y, z in ROWS),
        "// id x y z\n" + "".join(f"{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate(ROWS)),
        "# nx ny nz x y z\n" + "".join(f"0 0 1 {x} {y} {z}\n" for x, y, z in ROWS),
        ",x,y,z\n" + "".join(f"{k},{x},{y},{z}\n" for k, (x, y, z) in enumerate(ROWS)),
        '"Intensity","Points:0","Points:1","Points:2"\n' + "".join(f"9,{x},{y},{z}\n" for x, y, z in ROWS),
        "a scan of Tuesday\n" + table(" ", more=" 255 0 0"),
        "% made by hand\n3\n" + table(" ", " # near\n"),
        table(" ") + "nan nan nan\n1.#QNAN -1.#IND 0\n-nan(ind) 0 0\n",
        table(",") + ",,\n",  # how pandas writes NaN
        table(" ").replace("0.125", "1.25D-1").replace("5.0", "50E-01"),
    ],
)
def test_points_come_back(tmp_path: Path, name: str, text: str) -> None:
    np.testing.assert_array_equal(read(tmp_path, text, name), POINTS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (table(" ").replace(".", ","), "line 1: '0,125' is not a number: a decimal comma.* 0.125"),
        (table("\t").replace(".", ","), "line 1: '0,125' is not a number: a decimal comma"),
        (table(";").replace(".", ","), "line 1: field x: '0,125' is not a number: a decimal comma"),
        (table(", ").replace(".", ","), "line 1: '0,125' is not a number: a decimal comma"),
        (table(",").replace(".", ","), "line 1: '0,125,-0,25,0,5': decimal commas"),
        ("x,y,z\n" + table(",").replace(".", ","), "line 2: '0,125,-0,25,0,5': decimal commas"),
        (table(",", more=",255").replace(".", ","), "decimal commas"),
        (table(",").replace("4.0", "4").replace(".", ","), "line 3 has 5 columns, line 1 has 6.* decimal commas"),
        ('"0,1","0,2","0,3"\n', "line 1: '0,1' is not a number: a decimal comma"),
        ("1,234.5 2,345.5 3,456.5\n", "commas between thousands.* 1234.5"),
        ("1,234.5;2,345.5;3,456.5\n", "commas between thousands.* 1234.5"),
        ("0.1 0.2 0.3\n0.1 0.2 0.3 255 0 0\n", "line 2 has 6 columns, line 1 has 3"),
        ("x y z\n" + table(" ", more=" 255 0 0"), "line 1 names 3 columns, x, y, z; line 2 has 6"),
        ("id,east,north,up\n" + "1,2,3,4\n", "line 1 names the columns id, east, north, up: call those of the points"),
        ("".join(f"{k} 0.1 0.2 0.3\n" for k in range(9)), "line 1: the first column counts the rows"),
        (",0,1,2\n" + "".join(f"{k},0.1,0.2,0.3\n" for k in range(9)), "the first column counts the rows"),
        ("0.1 0.2\n", "line 1: field z is missing"),
        ("C 0.1 0.2 0.3\n0.1 0.2 0.3 0.4\n", "line 1: field x: 'C' is not a number"),
        ("0.1 1_0 0.3\n", "line 1: field y: '1_0' is not a number"),
        ("0.1,NULL,0.3\n", "field y: 'NULL' is not a number: write nan"),
        ("0.1 0.2 \u22120.3\n", "line 1: field z"),
    ],
)
def test_what_could_be_read_as_other_numbers_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(CloudError, match=message):
        read(tmp_path, text)


def test_whole_numbers_with_colours_are_no_decimal_commas(tmp_path: Path) -> None:
    text = "".join(f"{x},{y},{z},{r},0,255\n" for x, y, z, r in ((120, 35, 800, 7), (-5, 12, 815, 100), (99, -3, 7, 0)))
    np.testing.assert_array_equal(read(tmp_path, text), [[120, 35, 800], [-5, 12, 815], [99, -3, 7]])


def test_utf16_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(table(" ").encode("utf-16"))
    with pytest.raises(CloudError, match="UTF-16: save it as UTF-8"):
        read_cloud(tmp_path / "a.txt")


def test_notes_in_a_folder_of_clouds_are_no_cloud() -> None:
    assert ".txt" not in SUFFIXES
    assert ".csv" in SUFFIXES
