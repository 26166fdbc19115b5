"""The `surface` scenario: points from all over a mesh, inside and out, as the clouds of ModelNet10 are made; no camera.

Poisson-disk samples by throwing darts: of points that are uniform on the surface, in random order, each is kept that
has no kept one within a distance, and the distance is the largest that leaves enough. So no two points are near each
other, and no part of the surface is bare. As meshes of such sets have no unit, clouds are centred and scaled to the
unit sphere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from pec.data.shards import CloudSample
from pecgrasp_env.capture.config import CaptureConfig
from pecgrasp_env.capture.scenarios.base import Captured, Subject, sample_seed
from pecgrasp_env.objects.meshing.surface_points import doubled_normals, uniform_points

__all__ = ["SurfaceScenario", "poisson_disk"]

_CANDIDATES = 5  # darts a point
_HALVINGS = 8  # of the interval in which the distance lies: to 0.3 % of it


class SurfaceScenario:
    """`surface_points` points of each subject's surface."""

    def __init__(self, config: CaptureConfig) -> None:
        self._config = config

    def capture(self, subjects: Sequence[Subject], first: int, count: int) -> Captured[CloudSample]:
        captured = Captured[CloudSample]()
        for subject in subjects:
            model = subject.model
            vertices = np.concatenate([part.vertices for part in model.parts]).astype(float)
            starts = np.cumsum([0] + [len(part.vertices) for part in model.parts])
            faces = np.concatenate([part.faces + start for part, start in zip(model.parts, starts, strict=False)])
            for number in range(first, first + count):
                seed = sample_seed(self._config.seed, model.class_name, model.instance, number)
                points = poisson_disk(vertices, faces, self._config.surface_points, np.random.default_rng(seed))
                if points is None:
                    captured.given_up[subject.name] = "its faces have no area"
                    break
                centre = points.mean(axis=0)
                scale = 1 / float(np.linalg.norm(points - centre, axis=1).max())
                similarity = np.diag([scale, scale, scale, 1.0])
                similarity[:3, 3] = -scale * centre
                indices = subject.class_index, subject.instance_index
                captured.samples.append(CloudSample((points - centre) * scale, *indices, similarity, seed))
        return captured


def poisson_disk(vertices: np.ndarray, faces: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray | None:
    """`n` points (n, 3) of a surface (V, 3), (F, 3), far from each other; None where it has no area."""
    corners = vertices[faces]
    area = np.linalg.norm(doubled_normals(corners), axis=1) / 2
    total = float(area.sum())
    if not total > 0:
        return None
    darts, _ = uniform_points(corners, area, _CANDIDATES * n, rng)
    # No two of n points on a plane of this area are all farther apart than in a triangular lattice.
    widest = np.sqrt(2 * total / (np.sqrt(3) * n))
    tree = cKDTree(darts)
    low, high, kept = 0.0, widest, np.arange(n)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        found = _darts_kept(tree, middle)
        if len(found) >= n:
            low, kept = middle, found
        else:
            high = middle
    return darts[kept[:n]]


def _darts_kept(tree: cKDTree, distance: float) -> np.ndarray:
    """Indices of the points that have no kept point of a smaller index within `distance`."""
    pairs = tree.query_pairs(distance, output_type="ndarray")  # the smaller index first
    pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
    first = np.searchsorted(pairs[:, 0], np.arange(tree.n + 1)).tolist()
    later = pairs[:, 1]
    alive = np.ones(tree.n, bool)
    for index in range(tree.n):
        if alive[index] and first[index] < first[index + 1]:
            alive[later[first[index] : first[index + 1]]] = False
    return np.flatnonzero(alive)
