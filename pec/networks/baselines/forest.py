"""Extremely randomised trees on numbers of a cloud that no rotation changes, for clouds that were cut out of heaps.

What is cut out of a heap has some of its neighbours at its edges, and lacks what they hide. That turns the principal
axes and shifts the middle, by which points are ordered, while most distances and most curvatures stay: so the numbers
are quantiles of distances between points, of spreads along the axes, and of how flat and how long the nearest
neighbours of each point lie. The trees are those of Geurts, Ernst and Wehenkel, "Extremely randomized trees", Machine
Learning 2006, each grown on a draw of the clouds with replacement, so that the others tell how good it is. There is no
gradient: `fit` grows them.
"""

from __future__ import annotations

import numpy as np
import torch

from pec.networks.baselines.memorising import Memorising

__all__ = ["Forest", "invariants"]

_TREES = 150
_TRIED = 8  # numbers at a fork, about the root of how many there are
_LEAST = 2  # clouds in a leaf
_SMOOTHING = 0.02  # of each share, so that its logarithm is finite
_NEIGHBOURS = (0.1, 0.2)  # share of the points that are near one
_QUANTILES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
_OF_DISTANCES = np.array([0.05, 0.15, 0.25, 0.35, 0.5, 0.65, 0.75, 0.85, 0.95, 0.99])
_OF_RADII = np.array([0.1, 0.25, 0.5, 0.75, 0.9, 0.98])
_OF_AXES = np.array([0.5, 0.75, 0.9, 0.98])
_BLOCK = 64  # clouds at once: bounds memory, changes no result


def invariants(points: torch.Tensor) -> torch.Tensor:
    """(B, N, 3) points in any order and orientation, metres → (B, 64) numbers, float32."""
    clouds = points.detach().cpu().numpy().astype(np.float64)
    blocks = [_invariants(clouds[i : i + _BLOCK]) for i in range(0, len(clouds), _BLOCK)]
    numbers = np.concatenate([np.empty((0, 64)), *blocks])
    return torch.from_numpy(numbers.astype(np.float32)).to(points.device)


def _invariants(clouds: np.ndarray) -> np.ndarray:
    n = clouds.shape[1]
    centred = clouds - clouds.mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(centred.transpose(0, 2, 1) @ centred / n)
    along = centred @ axes[:, :, ::-1]
    along -= np.median(along, axis=1, keepdims=True)
    squared = (clouds * clouds).sum(axis=2)
    distances = squared[:, :, None] + squared[:, None] - 2 * (clouds @ clouds.transpose(0, 2, 1))
    distances = np.sqrt(np.maximum(distances, 0.0))
    one, other = np.triu_indices(n, 1)
    numbers = [
        np.sqrt(np.maximum(spread, 0.0)),
        np.ptp(along, axis=1),
        _quantiles(np.abs(along).transpose(0, 2, 1), _OF_AXES),
        _quantiles(np.linalg.norm(along, axis=2), _OF_RADII),
        _quantiles(distances[:, one, other], _OF_DISTANCES),
    ]
    for share in _NEIGHBOURS:
        count = max(4, round(share * n))
        nearest = np.argpartition(distances, count - 1, axis=2)[:, :, :count]
        around = np.take_along_axis(clouds[:, None], nearest[..., None], axis=2)
        around = around - around.mean(axis=2, keepdims=True)
        lengths = np.maximum(np.linalg.eigvalsh(around.swapaxes(2, 3) @ around / count), 1e-14)
        flat = np.sqrt(lengths[..., 0])
        numbers += [
            _quantiles(each, _QUANTILES)
            for each in (flat, flat / np.sqrt(lengths.sum(axis=2)), np.sqrt(lengths[..., 1] / lengths[..., 2]))
        ]
    return np.concatenate([each.reshape(len(clouds), -1) for each in numbers], axis=1)


def _quantiles(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(..., K) of values (..., N)."""
    place = np.rint(at * (values.shape[-1] - 1)).astype(int)
    return np.sort(values, axis=-1)[..., place]


class Forest(Memorising):
    """Votes of trees. Called like a network, and kept in a checkpoint like one."""

    _sized = ("number", "threshold", "left", "shares", "roots", "mean", "spread")
    shares: torch.Tensor
    roots: torch.Tensor

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.n_classes = n_classes
        for name in ("threshold", "shares", "mean", "spread"):
            self.register_buffer(name, torch.empty(0))
        for name in ("number", "left", "roots"):
            self.register_buffer(name, torch.empty(0, dtype=torch.int32))

    @torch.no_grad()
    def fit(self, points: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Grow the trees on clouds (n, N, 3) of known `labels` (n,); returns their log-probabilities (n, n_classes),
        each by the trees that were grown without it.
        """
        numbers = invariants(points)
        self.mean, self.spread = numbers.mean(dim=0), numbers.std(dim=0).clamp_min(1e-12)
        values, which = numbers.cpu().numpy(), labels.cpu().numpy()
        votes = np.zeros((len(which), self.n_classes))
        grown: list[_Tree] = []
        for k in range(_TREES):
            rng = np.random.default_rng([0xF0, k])
            drawn = rng.integers(len(which), size=len(which))
            tree = _Tree(values, which, self.n_classes, drawn, rng)
            unseen = np.setdiff1d(np.arange(len(which)), drawn)
            votes[unseen] += tree.shares[_leaves(tree.number, tree.threshold, tree.left, values[unseen], 0)]
            grown.append(tree)
        starts = np.cumsum([0, *(len(tree.number) for tree in grown)])
        device = points.device
        self.roots = torch.from_numpy(starts[:-1].astype(np.int32)).to(device)
        left = [np.where(tree.left > 0, tree.left + start, 0) for tree, start in zip(grown, starts, strict=False)]
        for name, parts in (
            ("number", [tree.number for tree in grown]),
            ("threshold", [tree.threshold for tree in grown]),
            ("left", left),
            ("shares", [tree.shares for tree in grown]),
        ):
            kind = np.float32 if name in ("threshold", "shares") else np.int32
            setattr(self, name, torch.from_numpy(np.concatenate(parts).astype(kind)).to(device))
        return torch.from_numpy(_logarithm(votes)).to(device)

    def embed(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, N, 3) points → (B, n_classes) logarithms of the shares of the votes, and the standardised numbers."""
        numbers = invariants(points)
        values, votes = numbers.cpu().numpy(), np.zeros((len(numbers), self.n_classes))
        number, threshold, left = (getattr(self, name).cpu().numpy() for name in ("number", "threshold", "left"))
        shares = self.shares.cpu().numpy()
        for root in self.roots.tolist():
            votes += shares[_leaves(number, threshold, left, values, root)]
        return torch.from_numpy(_logarithm(votes)).to(points.device), (numbers - self.mean) / self.spread


def _logarithm(votes: np.ndarray) -> np.ndarray:
    """(B, C) float32 of shares whose sum is not 1."""
    shares = votes / np.maximum(votes.sum(axis=1, keepdims=True), 1e-12) + _SMOOTHING
    return np.asarray(np.log(shares / shares.sum(axis=1, keepdims=True)), dtype=np.float32)


def _leaves(number: np.ndarray, threshold: np.ndarray, left: np.ndarray, values: np.ndarray, root: int) -> np.ndarray:
    """(B,) the leaf that each of values (B, D) comes to."""
    at = np.full(len(values), root)
    rows = np.arange(len(values))
    while len(rows):
        rows = rows[left[at[rows]] > 0]
        here = at[rows]
        at[rows] = left[here] + (values[rows, number[here]] >= threshold[here])
    return at


class _Tree:
    """number, threshold (M,): at a fork, values[number] < threshold goes to `left`, the others to the node behind it;
    left is 0 at a leaf. shares (M, C): of the classes there.
    """

    def __init__(
        self, values: np.ndarray, labels: np.ndarray, n_classes: int, drawn: np.ndarray, rng: np.random.Generator
    ) -> None:
        one_hot = np.eye(n_classes)[labels]
        number, threshold, left, shares = [0], [0.0], [0], [one_hot[drawn].mean(axis=0)]
        pending = [(0, drawn)]
        while pending:
            node, index = pending.pop()
            fork = _fork(values, one_hot, index, rng)
            if fork is None:
                continue
            number[node], threshold[node], left[node] = fork[0], fork[1], len(left)
            below = values[index, fork[0]] < fork[1]
            for part in (index[below], index[~below]):
                pending.append((len(left), part))
                number.append(0)
                threshold.append(0.0)
                left.append(0)
                shares.append(one_hot[part].mean(axis=0))
        self.number, self.threshold = np.array(number), np.array(threshold, np.float32)
        self.left, self.shares = np.array(left), np.array(shares)


def _fork(
    values: np.ndarray, one_hot: np.ndarray, index: np.ndarray, rng: np.random.Generator
) -> tuple[int, float] | None:
    """The best of a few random forks (number, threshold) by Gini's impurity, None where none pays."""
    counts = one_hot[index].sum(axis=0)
    if len(index) < 2 * _LEAST or counts.max() == len(index):
        return None
    tried = rng.permutation(values.shape[1])[:_TRIED]
    here = values[index[:, None], tried]
    low, high = here.min(axis=0), here.max(axis=0)
    thresholds = (low + rng.uniform(size=_TRIED) * (high - low)).astype(np.float32)
    below = here < thresholds
    of_left = below.T.astype(float) @ one_hot[index]
    n_left = of_left.sum(axis=1)
    n_right = len(index) - n_left
    fair = (n_left >= _LEAST) & (n_right >= _LEAST)
    if not fair.any():
        return None
    of_right = counts - of_left
    purity = (of_left**2).sum(axis=1) / np.maximum(n_left, 1) + (of_right**2).sum(axis=1) / np.maximum(n_right, 1)
    best = int(np.where(fair, purity, -np.inf).argmax())
    return int(tried[best]), float(thresholds[best])
