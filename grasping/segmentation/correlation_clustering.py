"""Group what belongs together from how much each pair agrees or disagrees: greedy additive edge contraction.

Keuper et al., Efficient decomposition of image and mesh graphs by lifted multicuts, ICCV 2015: contract the pair that
agrees most, add up the agreements of the two with each third, until no pair agrees.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def cluster(count: int, first: IntArray, second: IntArray, agreement: FloatArray) -> IntArray:
    """The cluster (count,), numbered 0, 1, … by first member, of each node.

    first, second: (P,) pairs of nodes, once each, first < second; agreement: (P,), above 0 where they belong together.
    """
    if kernels.compiled is not None:
        root = np.empty(count, dtype=np.int64)
        arrays = (np.ascontiguousarray(part) for part in (first, second, agreement))
        kernels.compiled.cluster(*arrays, root)
    else:
        root = cluster_reference(count, first, second, agreement)
    _, start, inverse = np.unique(root, return_index=True, return_inverse=True)
    rank = np.empty(len(start), dtype=np.int64)
    rank[np.argsort(start)] = np.arange(len(start))
    return rank[inverse.reshape(-1)]


def cluster_reference(count: int, first: IntArray, second: IntArray, agreement: FloatArray) -> IntArray:
    """The lowest-numbered node (count,) of each one's cluster."""
    neighbours: list[dict[int, float]] = [{} for _ in range(count)]
    for i, j, value in zip(first.tolist(), second.tolist(), agreement.tolist(), strict=True):
        neighbours[i][j] = neighbours[j][i] = value
    heap = [(-value, i, j) for i in range(count) for j, value in neighbours[i].items() if i < j and value > 0]
    heapq.heapify(heap)
    root = np.arange(count)
    while heap:
        value, i, j = heapq.heappop(heap)
        if neighbours[i].get(j) != -value:
            continue
        root[root == j] = i
        gone, neighbours[j] = neighbours[j], {}
        del neighbours[i][j]
        for k, other in gone.items():
            if k == i:
                continue
            total = neighbours[i].get(k, 0.0) + other
            del neighbours[k][j]
            neighbours[i][k] = neighbours[k][i] = total
            if total > 0:
                heapq.heappush(heap, (-total, min(i, k), max(i, k)))
    return root
