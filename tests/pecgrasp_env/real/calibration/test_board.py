"""The board: what is printed is the board that OpenCV finds, in true size."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from board_views import HAS_HAND_EYE

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.board_sheet import write_sheet
from pecgrasp_env.real.calibration.corners import find_corners
from pecgrasp_env.real.calibration.errors import CalibrationError

pytestmark = pytest.mark.skipif(not HAS_HAND_EYE, reason="pip install '.[calibrate]'")

BOARD = Board()


@pytest.mark.parametrize("board", [BOARD, Board(5, 8, 0.02, 0.014)])
def test_our_drawing_is_opencvs_board(board):
    """At any even number of rows, too, where OpenCV's boards of old were other ones."""
    scale = 4000
    width, height = (round(side * scale) for side in board.size)
    theirs = board.charuco.generateImage((width, height), marginSize=0, borderBits=1)
    same = np.abs(board.image(scale).astype(int) - theirs) < 64
    assert same.mean() > 0.98  # all but what lies on edges


def png_image(content: bytes) -> tuple[np.ndarray, float]:
    """Of a grey PNG: its pixels and how many are a metre."""
    at, parts = 8, {}
    while at < len(content):
        (length,), kind = struct.unpack(">I", content[at : at + 4]), content[at + 4 : at + 8]
        parts[kind] = content[at + 8 : at + 8 + length]
        assert struct.unpack(">I", content[at + 8 + length : at + 12 + length])[0] == zlib.crc32(kind + parts[kind])
        at += 12 + length
    width, height = struct.unpack(">II", parts[b"IHDR"][:8])
    rows = np.frombuffer(zlib.decompress(parts[b"IDAT"]), np.uint8).reshape(height, width + 1)
    per_metre, _, unit = struct.unpack(">IIB", parts[b"pHYs"])
    assert unit == 1
    return rows[:, 1:], per_metre


def drawn_from(text: str, form: str, scale: float, shape: tuple[int, int], height: float) -> np.ndarray:
    """The rectangles of a PDF or SVG as an image with so many pixels a metre."""
    image = np.full(shape, 255, np.uint8)
    number = r"(-?[\d.]+)"
    if form == "pdf":
        found = [
            [float(v) * 0.0254 / 72 for v in row]
            for row in re.findall(rf"{number} {number} {number} {number} re", text)
        ]
        found = [[x, height - y - h, w, h] for x, y, w, h in found]
    else:
        found = [[float(v) * 1e-3 for v in row] for row in re.findall(rf"M{number} {number}h{number}v{number}h", text)]
    for x, y, w, h in found:
        image[round(y * scale) : round((y + h) * scale), round(x * scale) : round((x + w) * scale)] = 0
    return image


@pytest.mark.parametrize("form", ["pdf", "svg", "png"])
def test_a_sheet_shows_the_board_in_true_size(form, tmp_path: Path):
    path = tmp_path / f"board.{form}"
    write_sheet(path, BOARD)
    if form == "png":
        image, scale = png_image(path.read_bytes())
        assert image.shape == (round(0.210 * 600 / 0.0254), round(0.297 * 600 / 0.0254))
    else:
        scale = 6000.0
        text = path.read_bytes().decode("latin-1")
        page = {"pdf": "/MediaBox [0 0 841.8898 595.2756]", "svg": 'width="297mm" height="210mm"'}[form]
        assert page in text
        image = drawn_from(text, form, scale, (round(0.21 * scale), round(0.297 * scale)), 0.21)
    found = find_corners(np.ascontiguousarray(image), BOARD)
    assert not isinstance(found, str)
    assert len(found.numbers) == BOARD.n_corners
    metres = found.pixels / scale
    np.testing.assert_allclose(metres - metres[0], found.board[:, :2] - found.board[0, :2], atol=1e-4)


def test_a_pdfs_table_says_where_its_objects_begin(tmp_path: Path):
    write_sheet(tmp_path / "board.pdf", BOARD)
    content = (tmp_path / "board.pdf").read_bytes()
    starts = [int(each) for each in re.findall(rb"(\d{10}) 00000 n", content)]
    assert [content[at:].split(b" ", 1)[0] for at in starts] == [b"1", b"2", b"3", b"4", b"5"]
    assert content[int(content.split(b"startxref\n")[1].split()[0]) :].startswith(b"xref\n")


@pytest.mark.parametrize(
    ("board", "paper", "words"),
    [
        ({"columns": 2}, "A4", r"board.columns=2"),
        ({"square": 35}, "A4", r"board.square=35: .* metres"),
        ({"marker": 0.034}, "A4", r"board.marker=0.034"),
        ({"square": 0.05, "marker": 0.04}, "A4", r"350 × 250 mm, on A4 fit 281 × 182"),
        ({}, "A5", r"paper=A5: one of A4, A3, letter"),
    ],
)
def test_boards_and_papers_that_make_no_sense_are_named(board, paper, words, tmp_path: Path):
    with pytest.raises(CalibrationError, match=words):
        write_sheet(tmp_path / "board.pdf", Board(**board), paper)
