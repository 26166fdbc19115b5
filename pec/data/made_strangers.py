"""Strangers made of the clouds themselves: things that none of the classes is, where nobody has given any.

Two halves of different things, two things that touch, a thing stretched, scaled, bent out of what its class may be, a
small piece of one. Near the classes as they are, they mark their borders better than other things far away: trained on
clouds of the five LARS classes and on these, a classifier refuses meshes that it has never seen
(docs/strangers.md has the figures). Changes that an instance of a class may well have are left to it: all here are
stronger.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

__all__ = ["made_strangers"]

_MOST_POINTS = 4000  # of a half, a cloud and a pair
_JOIN = 20  # points by which the ends of two halves are found

_TRIES = 20  # for one that has points enough


def made_strangers(clouds: Sequence[np.ndarray], n: int, least: int, rng: np.random.Generator) -> list[np.ndarray]:
    """n clouds (N, 3) float32 about 0, metres, of `least` points at least, made of `clouds` (N, 3), some at least."""
    made: list[np.ndarray] = []
    for _ in range(n * _TRIES):
        if len(made) == n:
            break
        first, second = (_centred(clouds[i], rng) for i in rng.integers(len(clouds), size=2))
        way = _WAYS[int(rng.choice(len(_WAYS), p=_SHARES))]
        cloud = way(first, second, rng)
        if len(cloud) >= least:
            made.append(cloud.astype(np.float32))
    return made


def _halves(first: np.ndarray, second: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What lies beyond a plane of one and before a plane of the other, turned anyhow, end to end."""
    second, normal = second @ _rotation(rng).T, _direction(rng)
    ahead, behind = first @ normal, second @ normal
    first = first[ahead >= np.quantile(ahead, rng.uniform(0.3, 0.7))]
    second = second[behind <= np.quantile(behind, rng.uniform(0.3, 0.7))]
    first_end = first[np.argsort(first @ normal)[:_JOIN]].mean(axis=0)
    second_end = second[np.argsort(-(second @ normal))[:_JOIN]].mean(axis=0)
    return np.concatenate([first - first_end, second - second_end])


def _touching(first: np.ndarray, second: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    second, normal = second @ _rotation(rng).T, _direction(rng)
    return np.concatenate([first - normal * (first @ normal).min(), second - normal * (second @ normal).max()])


def _stretched(first: np.ndarray, _second: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Along its principal axes, one of them by more than 2."""
    axes = _axes(first)
    factors = rng.uniform(-0.4, 0.4, 3)
    factors[rng.integers(3)] = rng.choice([-1, 1]) * rng.uniform(0.75, 1.4)
    return ((first @ axes.T) * np.exp(factors)) @ axes


def _scaled(first: np.ndarray, _second: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """By more than 2."""
    return first * np.exp(rng.choice([-1, 1]) * rng.uniform(0.75, 1.2))


def _bent(first: np.ndarray, _second: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Along its longest axis into a parabola, its ends off by half to all of its half length."""
    axes = _axes(first)
    turned = first @ axes.T
    length = np.abs(turned[:, 0]).max() + 1e-9
    turned[:, rng.integers(1, 3)] += rng.choice([-1, 1]) * rng.uniform(0.5, 1.2) * turned[:, 0] ** 2 / length
    return turned @ axes


def _fragment(first: np.ndarray, _second: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    ahead = first @ _direction(rng)
    return first[ahead >= np.quantile(ahead, rng.uniform(0.65, 0.85))]


_WAYS: tuple[Callable[[np.ndarray, np.ndarray, np.random.Generator], np.ndarray], ...] = (
    _halves,
    _touching,
    _stretched,
    _scaled,
    _bent,
    _fragment,
)
_SHARES = (0.35, 0.2, 0.15, 0.1, 0.1, 0.1)


def _centred(cloud: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    points = np.asarray(cloud, np.float64)
    if len(points) > _MOST_POINTS:
        points = points[rng.choice(len(points), _MOST_POINTS, replace=False)]
    return points - points.mean(axis=0)


def _axes(points: np.ndarray) -> np.ndarray:
    """(3, 3) principal axes, a row each, the longest first."""
    return np.linalg.eigh(points.T @ points)[1].T[::-1]


def _direction(rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def _rotation(rng: np.random.Generator) -> np.ndarray:
    """(3, 3), uniform."""
    rotation, triangle = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.diagonal(triangle))
    return rotation if np.linalg.det(rotation) > 0 else -rotation
