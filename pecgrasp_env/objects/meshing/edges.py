"""Which faces of a mesh meet at which edges, in arrays: meshes of a million faces take a second."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

__all__ = ["Edges", "turns", "unique_rows"]


class Edges:
    """The edges of faces (F, 3) whose corners at one place have one index.

    of_side: (3F,) the edge of each face's sides, face by face. forward: (3F,) whether the face runs along it from the
    lower to the higher vertex. count: (E,) faces at each edge. ends: (E, 2) its vertices, the lower one first.
    """

    def __init__(self, faces: np.ndarray) -> None:
        start = faces.reshape(-1).astype(np.int64)
        end = faces[:, [1, 2, 0]].reshape(-1)
        self.n_faces = len(faces)
        n = int(faces.max()) + 1 if len(faces) else 1
        self.forward = start < end
        keys = np.minimum(start, end) * n + np.maximum(start, end)
        del start, end
        self._order = np.argsort(keys, kind="stable").astype(np.int32)  # the sides, edge by edge
        keys = keys[self._order]
        first = np.ones(len(keys), bool)
        first[1:] = keys[1:] != keys[:-1]
        self.of_side = np.empty(len(keys), np.int32)
        self.of_side[self._order] = np.cumsum(first, dtype=np.int32) - 1
        keys = keys[first]
        self.ends = np.column_stack([keys // n, keys % n])
        self.count = np.bincount(self.of_side, minlength=len(keys))

    @property
    def open(self) -> np.ndarray:
        """(E,) whether an odd number of faces meets there: of a closed surface nowhere, wherever it touches itself."""
        return self.count % 2 == 1

    def faces_at(self, chosen: np.ndarray) -> np.ndarray:
        """(F,) how many of the chosen edges (E,) each face has."""
        return chosen[self.of_side].reshape(-1, 3).sum(axis=1)

    def balance(self, turned: np.ndarray | None = None) -> np.ndarray:
        """(E,) faces that run along it one way, less those that run the other way: 0 where the winding agrees.

        turned: (F,) faces that are taken the other way round.
        """
        forward = self.forward if turned is None else self.forward ^ np.repeat(turned, 3)
        return 2 * np.bincount(self.of_side[forward], minlength=len(self.count)) - self.count

    def pairs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of edges with two faces: these faces (M,), (M,), and whether they agree, that is, run along it both ways."""
        first, second = self._sorted_sides(self.count == 2).reshape(-1, 2).T
        return first // 3, second // 3, self.forward[first] != self.forward[second]

    def shells(self) -> tuple[int, np.ndarray]:
        """How many surfaces there are that bound something each for itself, and (F,) which of them each face is of.

        Where more than two faces meet, surfaces only touch, unless one of them would have a border there.
        """
        first, second, _ = self.pairs()
        n, patch = _components(self.n_faces, first, second)
        sides = self._sorted_sides(self.count > 2)
        key = self.of_side[sides].astype(np.int64) * n + patch[sides // 3]
        _, of_side = np.unique(key, return_inverse=True)
        borders = np.bincount(of_side, np.where(self.forward[sides], 1, -1))[of_side] != 0
        sides = sides[borders]
        edge, face = self.of_side[sides], sides // 3
        same = edge[1:] == edge[:-1]
        return _components(
            self.n_faces, np.concatenate([first, face[:-1][same]]), np.concatenate([second, face[1:][same]])
        )

    def groups(self) -> np.ndarray:
        """(F,) numbers of the parts of the surface that share no edge."""
        edge = self.of_side[self._order]
        same = edge[1:] == edge[:-1]
        return _components(self.n_faces, self._order[:-1][same] // 3, self._order[1:][same] // 3)[1]

    def patches(self) -> np.ndarray:
        """(F,) numbers of the parts that hang together by edges with two faces."""
        first, second, _ = self.pairs()
        return _components(self.n_faces, first, second)[1]

    def _sorted_sides(self, chosen: np.ndarray) -> np.ndarray:
        """The sides at the chosen edges (E,), edge by edge."""
        return self._order[chosen[self.of_side[self._order]]]


def turns(edges: Edges) -> tuple[np.ndarray, np.ndarray]:
    """Which faces to turn so that neighbours agree, (F,), and which lie on surfaces that have one side only, (F,).

    Each face stands twice in a graph, as it is and turned; a surface falls into two mirrored components of it, unless
    it has one side only.
    """
    n = edges.n_faces
    first, second, agree = edges.pairs()
    of_first = np.concatenate([first, first + n])
    of_second = np.concatenate([np.where(agree, second, second + n), np.where(agree, second + n, second)])
    count, component = _components(2 * n, of_first, of_second)
    as_is, turned = component[:n], component[n:]
    # Of the two mirrored ways the one that turns fewer faces.
    kept = np.bincount(as_is, minlength=count)
    return kept[as_is] < kept[turned], as_is == turned


def unique_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first index of each different row of (N, K), sorted by that index, and (N,) which of these each row is."""
    order = np.lexsort(rows.T[::-1])  # stable: of equal rows the first one leads
    differs = np.zeros(len(rows), bool)
    differs[:1] = True
    for column in rows.T:
        values = column[order]
        differs[1:] |= values[1:] != values[:-1]
    number = np.empty(len(rows), np.int64)
    number[order] = np.cumsum(differs) - 1
    first = order[differs]
    by_index = np.argsort(first)
    rank = np.empty(len(first), np.int64)
    rank[by_index] = np.arange(len(first))
    return first[by_index], rank[number]


def _components(n: int, a: np.ndarray, b: np.ndarray) -> tuple[int, np.ndarray]:
    graph = coo_matrix((np.ones(len(a), bool), (a, b)), shape=(n, n))
    count, component = connected_components(graph, directed=False)
    return int(count), component
