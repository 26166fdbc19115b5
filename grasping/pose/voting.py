"""Votes of a scene's pairs for where a model lies; the compiled kernel does the same, sooner.

For each reference point of the scene an accumulator counts which point of the model it may be, and how the model is
turned about its normal then.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.pose import kernels
from grasping.pose.point_pairs import FINE, TURNS, Pairs, PairTable, spread_cells

IntArray = NDArray[np.int32]


def vote(table: PairTable, pairs: Pairs, rows: int, peaks: int) -> IntArray:
    """The highest entries (rows, peaks, 3) of each row's accumulator: votes, the model's point, the turn in fine parts.

    pairs: of the scene, by row (`first`); they count in the cells next to theirs, too (`spread_cells`). Of each point
    of the model its best turn counts; of equal ones the lower number. An entry counts what its two neighbours have,
    too, half: where a peak lies between bins, it is no lower. The turn is that of the scene less that of the model.
    """
    found = np.zeros((rows, peaks, 3), dtype=np.int32)
    if kernels.compiled is not None:
        kernels.compiled.vote(
            *(table.starts, table.first, table.turn, pairs.first, pairs.bins, pairs.turn),
            *(len(table.points), TURNS, FINE, found),
        )
        return found
    count = len(table.points)
    pair, cell = spread_cells(pairs.bins)
    row, turn = pairs.first[pair], pairs.turn[pair]
    bounds = np.searchsorted(row, np.arange(rows + 1))
    for number in range(rows):
        own = slice(bounds[number], bounds[number + 1])
        begin, end = table.starts[cell[own]], table.starts[cell[own] + 1]
        length = end - begin
        entry = np.repeat(begin - np.cumsum(length) + length, length) + np.arange(length.sum())
        turned = (np.repeat(turn[own], length) - table.turn[entry]) % (TURNS * FINE) // FINE
        votes = np.bincount(table.first[entry] * TURNS + turned, minlength=count * TURNS).reshape(count, TURNS)
        votes = 2 * votes + np.roll(votes, 1, axis=1) + np.roll(votes, -1, axis=1)
        best = votes.argmax(axis=1)
        most = votes[np.arange(count), best]
        order = np.argsort(-most, kind="stable")[:peaks]
        found[number, : len(order)] = np.stack([most[order], order, best[order] * FINE + FINE // 2], axis=1)
    return found
