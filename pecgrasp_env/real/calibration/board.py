"""The ChArUco board: chessboard corners that are found to a fraction of a pixel, and markers that say which is which.

The board's frame has its origin at the sheet's upper left corner of the pattern, x to the right, y down, z into the
sheet, metres, as OpenCV has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.opencv import opencv

_MODULES = 6  # of a marker of DICT_4X4: four bits and a black border on either side


@dataclass(frozen=True)
class Board:
    """columns × rows squares with sides `square`, m; markers with sides `marker`, m, in the white ones.

    The default fills a sheet of A4. Markers of 4 × 4 bits, since at half a metre the infrared image of a D435 has four
    pixels for a bit of them. Raises CalibrationError for sizes that make no board.
    """

    columns: int = 7
    rows: int = 5
    square: float = 0.035
    marker: float = 0.026

    def __post_init__(self) -> None:
        if not (3 <= self.columns <= 20 and 3 <= self.rows <= 20 and self.columns * self.rows <= 200):
            raise CalibrationError(
                f"board.columns={self.columns}, board.rows={self.rows}: 3 to 20 each, 200 squares at most"
            )
        if not 0.005 <= self.square <= 0.5:
            raise CalibrationError(f"board.square={self.square}: the side of a square in metres, 0.005 to 0.5")
        if not 0.4 * self.square <= self.marker <= 0.9 * self.square:
            raise CalibrationError(
                f"board.marker={self.marker}: 0.4 to 0.9 of board.square={self.square}, metres: a marker needs white "
                "around it"
            )

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the pattern, m."""
        return self.columns * self.square, self.rows * self.square

    @property
    def n_corners(self) -> int:
        return (self.columns - 1) * (self.rows - 1)

    @cached_property
    def charuco(self) -> Any:
        """OpenCV's own board."""
        aruco = opencv().aruco
        return aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, self._dictionary)

    @cached_property
    def corners(self) -> np.ndarray:
        """(n_corners, 3) in the board's frame, m, by their numbers."""
        return np.asarray(self.charuco.getChessboardCorners(), float)

    @property
    def _dictionary(self) -> Any:
        aruco = opencv().aruco
        return aruco.getPredefinedDictionary(aruco.DICT_4X4_100)

    def black(self) -> list[tuple[float, float, float, float]]:
        """What is to be printed black: x, y, width, height of rectangles in the board's frame, m."""
        rectangles = []
        number, bit, border = 0, self.marker / _MODULES, (self.square - self.marker) / 2
        for row in range(self.rows):
            for column in range(self.columns):
                x, y = column * self.square, row * self.square
                if (row + column) % 2 == 0:
                    rectangles.append((x, y, self.square, self.square))
                    continue
                dark = opencv().aruco.generateImageMarker(self._dictionary, number, _MODULES) == 0
                number += 1
                for v, first, last in _runs(dark):
                    rectangles.append((x + border + first * bit, y + border + v * bit, (last - first) * bit, bit))
        return rectangles

    def image(self, pixels_per_metre: float) -> np.ndarray:
        """(h, w) uint8 of the pattern alone; a pixel is as dark as the share of it that is black."""
        return _drawn(self, pixels_per_metre)


@lru_cache(maxsize=4)
def _drawn(board: Board, pixels_per_metre: float) -> np.ndarray:
    fine = max(1, math.ceil(8000 / pixels_per_metre))  # an eighth of a millimetre or finer, then averaged
    scale = pixels_per_metre * fine
    width, height = (math.ceil(side * pixels_per_metre - 1e-6) * fine for side in board.size)
    image = np.full((height, width), 255, np.uint8)
    for x, y, w, h in board.black():
        image[round(y * scale) : round((y + h) * scale), round(x * scale) : round((x + w) * scale)] = 0
    shape = (height // fine, fine, width // fine, fine)
    result = np.rint(image.reshape(shape).mean(axis=(1, 3))).astype(np.uint8)
    result.setflags(write=False)
    return result


def _runs(dark: np.ndarray) -> list[tuple[int, int, int]]:
    """Of each row (H, W) the stretches of True: row, first, one behind the last."""
    found = []
    for number, row in enumerate(dark):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
        found += [(number, int(first), int(last)) for first, last in edges.reshape(-1, 2)]
    return found
