"""What may befall a cloud, in seven kinds and five levels each, in the manner of ModelNet-C.

Source: Ren, Pan, Liu, "Benchmarking and Analyzing Point Cloud Classification under Corruptions", ICML 2022; the numbers
are those of its released data. They are meant for 1,024 points in the unit sphere: lengths here are in units of the
cloud's own radius, and counts are shares of its points, so that clouds of any size and number can be corrupted.

Other than there: a cloud that was stretched gets its radius back (there it is scaled to the unit sphere, as all are);
added points beyond the sphere are put onto it (there divided by the square of their distance).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pec.errors import ConfigError

__all__ = ["CORRUPTIONS", "LEVELS", "corrupt"]

LEVELS = (1, 2, 3, 4, 5)

SCALE = (1.6, 1.7, 1.8, 1.9, 2.0)
"""Greatest factor of each axis by itself; the least is its inverse."""
JITTER = (0.01, 0.02, 0.03, 0.04, 0.05)
"""Standard deviation of each coordinate, radii."""
ROTATE = (6.0, 12.0, 18.0, 24.0, 30.0)
"""Greatest angle about each of the three axes, degrees."""
DROP_GLOBAL = (0.25, 0.375, 0.5, 0.625, 0.75)
"""Share of the points that is missing, at random."""
DROP_LOCAL = tuple(100 * level / 1024 for level in LEVELS)
"""Share of the points that is missing, in one to MOST_CLUSTERS neighbourhoods."""
ADD_GLOBAL = tuple(10 * level / 1024 for level in LEVELS)
"""Points in the cloud's sphere beside its own, as a share of those."""
ADD_LOCAL = tuple(100 * level / 1024 for level in LEVELS)
"""Points around one to MOST_CLUSTERS of its own beside them, as a share of those."""
MOST_CLUSTERS = 7
ADD_LOCAL_SPREAD = (0.075, 0.125)
"""Range of the standard deviation of the points that are added around one, radii."""


def corrupt(points: np.ndarray, kind: str, level: int, rng: np.random.Generator, least: int = 1) -> np.ndarray:
    """`points` (N, 3) after a corruption of `CORRUPTIONS` at a level of 1 to 5, in the same frame and unit, float32.

    least: points that remain of whatever is dropped, or all where there are no more.
    Raises ConfigError for a kind or level that there is not.
    """
    if kind not in CORRUPTIONS:
        raise ConfigError(f"corruption must be one of {', '.join(CORRUPTIONS)}, got {kind!r}")
    if level not in LEVELS:
        raise ConfigError(f"level must be 1 to 5, got {level}")
    centre = points.mean(axis=0, dtype=np.float64)
    centred = points - centre
    radius = max(float(np.linalg.norm(centred, axis=1).max()), 1e-12)
    unit = CORRUPTIONS[kind](centred / radius, level - 1, rng, min(least, len(points)))
    return (unit * radius + centre).astype(np.float32)


def _scale(points: np.ndarray, level: int, rng: np.random.Generator, least: int) -> np.ndarray:
    stretched = points * rng.uniform(1 / SCALE[level], SCALE[level], 3)
    return stretched / max(np.linalg.norm(stretched, axis=1).max(), 1e-12)


def _jitter(points: np.ndarray, level: int, rng: np.random.Generator, least: int) -> np.ndarray:
    return points + rng.normal(scale=JITTER[level], size=points.shape)


def _rotate(points: np.ndarray, level: int, rng: np.random.Generator, least: int) -> np.ndarray:
    for axis, angle in enumerate(np.deg2rad(rng.uniform(-ROTATE[level], ROTATE[level], 3))):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
        points = points @ turn.T
    return points


def _drop_global(points: np.ndarray, level: int, rng: np.random.Generator, least: int) -> np.ndarray:
    n = max(int(len(points) * (1 - DROP_GLOBAL[level])), least)
    return points[rng.permutation(len(points))[:n]]


def _drop_local(points: np.ndarray, level: int, rng: np.random.Generator, least: int) -> np.ndarray:
    for size in _cluster_sizes(DROP_LOCAL[level], len(points), rng):
        size = min(size, len(points) - least)
        if size > 0:
            squared = np.square(points - points[rng.integers(len(points))]).sum(axis=1)
            points = points[np.sort(np.argpartition(squared, size - 1)[size:])]
    return points


def _add_global(points: np.ndarray, level: int, rng: np.random.Generator, least: int) -> np.ndarray:
    n = round(ADD_GLOBAL[level] * len(points))
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.concatenate([points, direction * rng.uniform(size=(n, 1)) ** (1 / 3)])


def _add_local(points: np.ndarray, level: int, rng: np.random.Generator, least: int) -> np.ndarray:
    added = [
        points[rng.integers(len(points))] + rng.uniform(*ADD_LOCAL_SPREAD) * rng.normal(size=(size, 3))
        for size in _cluster_sizes(ADD_LOCAL[level], len(points), rng)
    ]
    new = np.concatenate(added)
    return np.concatenate([points, new / np.maximum(1, np.linalg.norm(new, axis=1, keepdims=True))])


def _cluster_sizes(share: float, n_points: int, rng: np.random.Generator) -> list[int]:
    """Sizes of one to MOST_CLUSTERS clusters that sum to `share` of the points; each point draws its cluster."""
    n_clusters = int(rng.integers(1, MOST_CLUSTERS + 1))
    return np.bincount(rng.integers(n_clusters, size=round(share * n_points)), minlength=n_clusters).tolist()


Corruption = Callable[[np.ndarray, int, np.random.Generator, int], np.ndarray]

CORRUPTIONS: dict[str, Corruption] = {
    "scale": _scale,
    "jitter": _jitter,
    "rotate": _rotate,
    "drop-global": _drop_global,
    "drop-local": _drop_local,
    "add-global": _add_global,
    "add-local": _add_local,
}
"""(points of a centred cloud of radius 1, level - 1, generator, least points to keep) → points."""
