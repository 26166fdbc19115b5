"""The board on a sheet of paper in true size: PDF and SVG as lines, PNG with its dots per inch.

Each sheet has a ruler of 100 mm: printers shrink pages unless they are told not to.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.errors import CalibrationError

_PAPERS = {"A4": (0.297, 0.210), "A3": (0.420, 0.297), "letter": (0.2794, 0.2159)}  # m, lying
_MARGIN = 0.008  # m, of white that most printers cannot print on, and that the outermost markers need
_RULER = 0.1
_POINTS = 72 / 0.0254  # of a PDF, a metre
_DPI = 600

Rectangle = tuple[float, float, float, float]


def write_sheet(path: Path, board: Board, paper: str = "A4") -> None:
    """The board as .pdf, .svg or .png. Raises CalibrationError for another suffix or paper and a board too large."""
    writers: dict[str, Callable[[list[Rectangle], tuple[float, float], str], bytes]]
    writers = {".pdf": _pdf, ".svg": _svg, ".png": _png}
    if path.suffix.lower() not in writers:
        raise CalibrationError(f"{path}: a board is written as {', '.join(writers)}")
    if paper not in _PAPERS:
        raise CalibrationError(f"paper={paper}: one of {', '.join(_PAPERS)}")
    size = _PAPERS[paper]
    (width, height), room = board.size, (size[0] - 2 * _MARGIN, size[1] - 2 * _MARGIN - 0.012)
    if width > room[0] or height > room[1]:
        raise CalibrationError(
            f"the board is {1e3 * width:.0f} × {1e3 * height:.0f} mm, on {paper} fit {1e3 * room[0]:.0f} × "
            f"{1e3 * room[1]:.0f}: a smaller board.square, or a larger paper"
        )
    left, top = (size[0] - width) / 2, _MARGIN + (room[1] - height) / 2
    rectangles = [(left + x, top + y, w, h) for x, y, w, h in board.black()]
    base = size[1] - _MARGIN - 0.004
    rectangles.append((left, base, _RULER, 0.0003))
    rectangles += [(left + tick - 0.00015, base - 0.002, 0.0003, 0.002) for tick in np.arange(11) * _RULER / 10]
    words = (
        f"100 mm. Squares {1e3 * board.square:g} mm, markers {1e3 * board.marker:g} mm, {board.columns} x {board.rows}."
        " Print at 100 %, glue on a flat plate, measure the ruler."
    )
    path.write_bytes(writers[path.suffix.lower()](rectangles, size, words))


def _svg(rectangles: list[Rectangle], size: tuple[float, float], words: str) -> bytes:
    width, height = (1e3 * side for side in size)
    parts = "".join(
        f"M{1e3 * x:.4f} {1e3 * y:.4f}h{1e3 * w:.4f}v{1e3 * h:.4f}h{-1e3 * w:.4f}z" for x, y, w, h in rectangles
    )
    ruler = rectangles[-12]
    x, y = 1e3 * (ruler[0] + ruler[2]) + 3, 1e3 * ruler[1]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
        f'viewBox="0 0 {width:g} {height:g}"><rect width="{width:g}" height="{height:g}" fill="#fff"/>'
        f'<path d="{parts}"/>'
        f'<text x="{x:.2f}" y="{y:.2f}" font-family="sans-serif" font-size="3">{words}</text></svg>\n'
    ).encode()


def _pdf(rectangles: list[Rectangle], size: tuple[float, float], words: str) -> bytes:
    """One page; PDF counts from the lower left corner, in points."""
    width, height = (side * _POINTS for side in size)
    lines = [
        f"{x * _POINTS:.4f} {height - (y + h) * _POINTS:.4f} {w * _POINTS:.4f} {h * _POINTS:.4f} re"
        for x, y, w, h in rectangles
    ]
    ruler = rectangles[-12]
    x, y = (ruler[0] + ruler[2] + 0.003) * _POINTS, height - ruler[1] * _POINTS
    drawn = "\n".join([*lines, "f", f"BT /F1 8 Tf {x:.2f} {y:.2f} Td ({words}) Tj ET"]).encode()
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(drawn), drawn),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    file, starts = b"%PDF-1.4\n", []
    for number, content in enumerate(objects, start=1):
        starts.append(len(file))
        file += b"%d 0 obj\n%s\nendobj\n" % (number, content)
    table = b"".join(b"%010d 00000 n \n" % start for start in starts)
    trailer = b"trailer << /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, len(file))
    return file + b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1) + table + trailer


def _png(rectangles: list[Rectangle], size: tuple[float, float], words: str) -> bytes:
    """Without the words; the dots per inch stand in the file."""
    scale = _DPI / 0.0254
    width, height = (round(side * scale) for side in size)
    image = np.full((height, width), 255, np.uint8)
    for x, y, w, h in rectangles:
        image[round(y * scale) : round((y + h) * scale), round(x * scale) : round((x + w) * scale)] = 0
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image], axis=1)  # each row unfiltered
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
        (b"pHYs", struct.pack(">IIB", round(scale), round(scale), 1)),
        (b"IDAT", zlib.compress(rows.tobytes(), 9)),
        (b"IEND", b""),
    ]
    parts = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)
