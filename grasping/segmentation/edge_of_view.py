"""Where the picture ends: at the image's border, or at the line up to which the sensor sees anything.

Stereo sensors are blind in a band at one side, and depth that was warped to a colour camera ends at a slanted line. An
object is cut off where it ends at such a line together with what is beside it; one that stands out against a background
without depth is whole.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]

BORDER = 2  # pixels from the end of the view within which an object is cut off
SLOPES = np.linspace(-0.2, 0.2, 41)  # columns a row by which a line may slant
SUPPORT = 0.33  # of an image's rows end at a line, without those of the object itself, where the view ends there
CONTACT = 3  # rows in which an object reaches the line


class EdgeOfView:
    """The image's border and the lines beyond which nothing is seen. seen: (H, W)."""

    def __init__(self, seen: NDArray[np.bool_]) -> None:
        self.shape = seen.shape
        # Each side as the left one of a turned or mirrored image.
        self._sides = [_Side(seen), _Side(seen[:, ::-1]), _Side(seen.T), _Side(seen.T[:, ::-1])]

    def cuts(self, index: IntArray) -> bool:
        """Whether the view ends within an object, given its pixels (M,)."""
        row = index // self.shape[1]
        column = index - row * self.shape[1]
        bottom, right = self.shape[0] - 1, self.shape[1] - 1
        nearest = (int(column.min()), right - int(column.max()), int(row.min()), bottom - int(row.max()))
        if min(nearest) < BORDER:
            return True
        places = ((row, column, 0), (row, column, right), (column, row, 0), (column, row, bottom))
        return any(
            side.cuts(along, np.abs(at - end))
            for side, near, (along, at, end) in zip(self._sides, nearest, places, strict=True)
            if near <= side.last + 1
        )


class _Side:
    def __init__(self, seen: NDArray[np.bool_]) -> None:
        self.first = seen.argmax(axis=1)
        self.first[~seen[np.arange(len(seen)), self.first]] = -1
        self.last = int(self.first.max(initial=-1))

    def cuts(self, along: IntArray, at: IntArray) -> bool:
        """along, at: (M,) the object's rows and columns, of which one at least is no farther in than `last` and one."""
        begins = at <= self.first[along] + 1
        if np.count_nonzero(begins) < CONTACT:
            return False
        own = np.unique(along[begins])  # rows that begin with the object
        if len(own) < CONTACT:
            return False
        own = own[self.at_line[own]]
        others = int(np.count_nonzero(self.at_line)) - len(own)
        return len(own) >= CONTACT and others >= max(SUPPORT * len(self.first), len(own))

    @cached_property
    def at_line(self) -> NDArray[np.bool_]:
        """(H,) rows whose first pixel is at the line at which most rows begin."""
        rows = np.flatnonzero(self.first >= 0)
        offset = np.rint(self.first[rows] - SLOPES[:, None] * rows).astype(np.int64)
        offset -= offset.min() - BORDER
        width = int(offset.max()) + BORDER + 1
        counts = np.bincount(
            (offset + width * np.arange(len(SLOPES))[:, None]).reshape(-1), minlength=width * len(SLOPES)
        )
        sums = np.convolve(counts, np.ones(2 * BORDER + 1, dtype=np.int64), mode="same")
        slope, place = divmod(int(sums.argmax()), width)
        near = np.zeros(len(self.first), dtype=bool)
        near[rows] = np.abs(offset[slope] - place) <= BORDER
        return near
