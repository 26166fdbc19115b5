"""Strangers made of the clouds themselves: things that none of the classes is, where nobody has given any.

Two halves of different things, two things that touch, a thing stretched, scaled, bent out of what its class may be, a
small piece of one. Near the classes as they are, they mark their borders better than other things far away: trained on
clouds of the five LARS classes and on these, a classifier refuses meshes that it has never seen
(docs/classifiers.md has the figures). Changes that an instance of a class may well have are left to it: all here are
stronger.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pec.known.shape_distribution import describe_cloud

__all__ = ["made_strangers"]

_MOST_POINTS = 4000  # of a half, a cloud and a pair
_JOIN = 20  # points by which the ends of two halves are found

_TRIES = 20  # for one that has points enough and is like none of the known
_COMPARED = 1500  # known clouds that it is compared with
_ORDINARY = 0.9
_DESCRIBED = 64  # points of each


def made_strangers(clouds: Sequence[np.ndarray], n: int, least: int, rng: np.random.Generator) -> list[np.ndarray]:
    """n clouds (N, 3) float32 about 0, metres, of `least` points at least, made of `clouds` (N, 3), some at least.

    None is as like one of `clouds` in its shape distribution as they are to each other: a can that is stretched may be
    a bottle. Fewer than n where nearly all of them are.
    """
    known = _Likeness(clouds, rng)
    made: list[np.ndarray] = []
    for _ in range(n * _TRIES):
        if len(made) == n:
            break
        first, second = (_centred(clouds[i], rng) for i in rng.integers(len(clouds), size=2))
        way = _WAYS[int(rng.choice(len(_WAYS), p=_SHARES))]
        cloud = way(first, second, rng).astype(np.float32)
        if len(cloud) >= least and not known.has_like(cloud, rng):
            made.append(cloud)
    return made


class _Likeness:
    """Whether a cloud is like some of `clouds` (N, 3): as near to one as nine in ten are to their nearest other."""

    def __init__(self, clouds: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        some = rng.permutation(len(clouds))[:_COMPARED]
        described = np.array([_described(clouds[i], rng) for i in some])
        self._mean, self._deviation = described.mean(axis=0), described.std(axis=0) + 1e-6
        self._known = ((described - self._mean) / self._deviation).astype(np.float32)
        squared = np.square(self._known).sum(axis=1)
        away = squared[:, None] + squared - 2 * self._known @ self._known.T
        np.fill_diagonal(away, np.inf)
        self._squared, self._near = squared, np.quantile(away.min(axis=1), _ORDINARY) if len(some) > 1 else 0.0

    def has_like(self, cloud: np.ndarray, rng: np.random.Generator) -> bool:
        described = ((_described(cloud, rng) - self._mean) / self._deviation).astype(np.float32)
        return bool((self._squared - 2 * self._known @ described).min() + described @ described < self._near)


def _described(cloud: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Descriptor of points of the cloud that lie as evenly as its own do."""
    return describe_cloud(np.asarray(cloud, np.float32)[rng.integers(len(cloud), size=_DESCRIBED)])


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
