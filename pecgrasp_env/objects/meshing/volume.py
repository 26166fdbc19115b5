"""What a closed mesh encloses: which way its parts face, and how much is in them."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.edges import Edges

__all__ = ["shells_inside_out", "solid_volume"]

_COLUMNS = 300  # a side, of those in which the overlap of parts is measured
_LARGEST = 32  # parts that others may lie in


def solid_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The volume of a closed mesh (V, 3), (F, 3), wound outwards: less its cavities, and once where parts overlap."""
    n, group = Edges(faces).shells()
    volumes = _volumes(vertices, faces, group, n)
    if n == 1 or not _boxes_overlap(vertices, faces, group, volumes > 0):
        return float(volumes.sum())
    return _union(vertices, faces)


def shells_inside_out(vertices: np.ndarray, faces: np.ndarray, n: int, group: np.ndarray) -> np.ndarray:
    """Which faces (F,) belong to parts, n of them, that are inside out; a part in another one follows the outer one, as
    the wall of a cavity runs against that of its body.
    """
    volumes = _volumes(vertices, faces, group, n)
    negative = volumes < 0
    if not negative.any() or negative.all():
        return negative[group]
    low, high = _boxes(vertices, faces, group, n)
    largest = np.argsort(-np.abs(volumes), kind="stable")[:_LARGEST]
    sizes = np.abs(volumes)
    a_vertex = np.zeros(n, np.int64)
    a_vertex[group] = faces[:, 0]
    turned = negative.copy()
    for part in range(n):
        for outer in largest:  # the largest first: the outermost
            if outer == part or sizes[outer] <= sizes[part]:
                continue
            around = (low[part] >= low[outer]).all() and (high[part] <= high[outer]).all()
            if around and _is_inside(vertices[a_vertex[part]], vertices, faces[group == outer]):
                turned[part] = negative[outer]
                break
    return turned[group]


def _volumes(vertices: np.ndarray, faces: np.ndarray, group: np.ndarray, n: int) -> np.ndarray:
    """Signed volume (n,) of each part, about its middle, so that small openings change little."""
    total = np.bincount(group, minlength=n)
    middle = np.stack([np.bincount(group, x[faces].mean(axis=1), n) for x in vertices.T], axis=1) / total[:, None]
    (ax, bx, cx), (ay, by, cy), (az, bz, cz) = ((vertices[:, i][faces] - middle[group, i, None]).T for i in range(3))
    six = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return np.bincount(group, six, n) / 6


def _boxes(vertices: np.ndarray, faces: np.ndarray, group: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
    for axis in range(3):
        values = vertices[:, axis][faces]
        np.minimum.at(low[:, axis], group, values.min(axis=1))
        np.maximum.at(high[:, axis], group, values.max(axis=1))
    return low, high


def _boxes_overlap(vertices: np.ndarray, faces: np.ndarray, group: np.ndarray, chosen: np.ndarray) -> bool:
    """Whether the boxes around any two of the chosen parts overlap."""
    low, high = _boxes(vertices, faces, group, len(chosen))
    low, high = low[chosen], high[chosen]
    order = np.argsort(low[:, 0])
    low, high = low[order], high[order]
    for i in range(len(low) - 1):
        others = slice(i + 1, int(np.searchsorted(low[:, 0], high[i, 0])))
        if ((low[others] < high[i]) & (high[others] > low[i])).all(axis=1).any():
            return True
    return False


def _is_inside(point: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> bool:
    """By the solid angle that the faces take up seen from the point (Van Oosterom and Strackee, 1983)."""
    a, b, c = (vertices[faces[:, i]] - point for i in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a))]
    below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    return bool(abs(np.arctan2(above, below).sum()) > np.pi)  # halves of 4 pi, and of half of that


def _union(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Along columns of rays: of each the stretches on which more surfaces were entered than left."""
    low = vertices.min(axis=0)
    cell = np.ptp(vertices, axis=0)[:2] / _COLUMNS
    points = (vertices - low) / [*cell, 1.0] - [0.5, 0.5, 0.0]
    a, b, c = (points[faces[:, i]] for i in range(3))
    first = np.ceil(np.minimum(np.minimum(a, b), c)[:, :2]).astype(int)
    last = np.floor(np.maximum(np.maximum(a, b), c)[:, :2]).astype(int)
    width, height = np.maximum(last - first + 1, 0).T
    face = np.repeat(np.arange(len(faces)), width * height)
    within = np.arange(len(face)) - np.repeat(np.cumsum(width * height) - width * height, width * height)
    column = first[face, 0] + within % np.maximum(width[face], 1)
    row = first[face, 1] + within // np.maximum(width[face], 1)
    ab, ac = (b - a)[face], (c - a)[face]
    twice = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    # Irrational steps off the grid, so that no ray runs along an edge.
    x, y = column + 0.0013717 - a[face, 0], row + 0.0029171 - a[face, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (x * ac[:, 1] - y * ac[:, 0]) / twice, (ab[:, 0] * y - ab[:, 1] * x) / twice
        hit = np.flatnonzero((twice != 0) & (s >= 0) & (t >= 0) & (s + t <= 1))
    ray = (column * (_COLUMNS + 2) + row)[hit]
    z = a[face[hit], 2] + s[hit] * ab[hit, 2] + t[hit] * ac[hit, 2]
    entered = np.where(twice[hit] < 0, 1, -1)  # a face that looks down is entered from below
    order = np.lexsort((z, ray))
    ray, z, entered = ray[order], z[order], entered[order]
    _, start, of_hit = np.unique(ray, return_index=True, return_inverse=True)
    # Rounding lets a ray slip through between two faces; what it would say of the rest is left out.
    sound = np.add.reduceat(entered, start) == 0
    total = np.cumsum(entered)
    depth = total - (total - entered)[start][of_hit]
    stretch = (of_hit[1:] == of_hit[:-1]) & (depth[:-1] > 0) & sound[of_hit[1:]]
    return float((z[1:] - z[:-1])[stretch].sum() * cell.prod() * len(sound) / max(sound.sum(), 1))
