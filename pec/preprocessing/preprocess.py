"""From a raw cloud to the ordered points that the network takes.

Two steps, because the first is slow and needs the raw cloud, and the second is quick and must follow each augmentation:

1. `Preprocess.sample`: drop isolated points where that is asked for, centre, then at most `n_candidates` points, by
   farthest point sampling (FPS) or by chance (NumPy, one cloud).
2. `Preprocess.arrange`: pose, then ordering, to exactly `n_points` points (torch, a batch). `Preprocess.views` is the
   same of one cloud in all its poses, for prediction.

Both are quick by compiled kernels where this installation has them (`pec.preprocessing.compiled`); what is here is
their reference.

Published (the dissertation's): n_candidates = n_points, pose "given", ordering "groups" (or "none").
Canonical (ours): turn the cloud to its principal axes and let each of n fixed positions take its nearest candidate.
Upright (ours): the same for clouds that stand upright and face along x or y, as given, and without FPS: what the
nearest of 1,000 points says of a surface, the nearest of 128 says less exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from pec.errors import CloudError, ConfigError
from pec.preprocessing import compiled as kernels
from pec.preprocessing.isolated import without_isolated
from pec.preprocessing.ordering import anchor_positions, group_order, nearest_candidates
from pec.preprocessing.pose import FLIPS, principal_pose

__all__ = ["Preprocess", "check_cloud", "farthest_point_sampling", "farthest_points"]

ORDERINGS = ("none", "groups", "anchors")
POSES = ("given", "principal", "upright")
SIZES = ("kept", "unit", "root")
_ROOTED_SPREADS = (0.02, 2.0)  # m: a mouse has 0.04, a bed 0.9
# The given cloud and its mirror images in the vertical planes: as likely where front and back or left and right are.
_MIRRORS = ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (-1.0, -1.0, 1.0))
# By pose, what a cloud's coordinates are multiplied by in each of its views.
_SIGNS = {
    "given": np.ones((1, 3), np.float32),
    "principal": np.array(FLIPS, np.float32),
    "upright": np.array(_MIRRORS, np.float32),
}


def check_cloud(points: np.ndarray, n_points: int) -> np.ndarray:
    """`points` as an (N, 3) array of floats with N ≥ n_points, finite or not.

    Raises CloudError that says what is wrong otherwise.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise CloudError(f"a cloud must have shape (N, 3), got {points.shape}")
    if not np.issubdtype(points.dtype, np.floating):
        raise CloudError(f"a cloud must hold floats (metres), got {points.dtype}")
    if len(points) < n_points:
        raise CloudError(f"the network takes {n_points} points, the cloud has only {len(points)}")
    return points


def _centred(points: np.ndarray) -> np.ndarray:
    """(N, 3) float32 about the centroid. Raises CloudError where points are not finite."""
    if not np.isfinite(points).all():
        bad = np.count_nonzero(~np.isfinite(points).all(axis=1))
        raise CloudError(f"{bad} of {len(points)} points are not finite; drop them first")
    # Contiguous, since a sum depends on its order to the last bit, and NumPy's order on the layout.
    points = np.ascontiguousarray(points)
    return (points - points.mean(axis=0, dtype=np.float64)).astype(np.float32)


def farthest_points(points: np.ndarray, n: int, start: int | None) -> np.ndarray:
    """Points (n, 3) float32 about the centroid of all, by farthest point sampling of `points` (N, 3), N ≥ n.

    start: index of the first point; None for the one farthest from the centroid.
    Raises CloudError where points are not finite.
    """
    centred = _centred(points)
    if start is None:
        start = int((centred**2).sum(axis=1).argmax())
    return centred[farthest_point_sampling(centred, n, start)]


def farthest_point_sampling(points: np.ndarray, n: int, start: int) -> np.ndarray:
    """Indices (n,) of a farthest point sampling of `points` (N, 3), N ≥ n, beginning with index `start`.

    Each further point is the one farthest from all chosen so far; of equally far ones the first.
    """
    # One row an axis and sums in place: about ten times as fast as the obvious (N, 3) form.
    x, y, z = np.ascontiguousarray(points.T, dtype=np.float32)
    squared = np.full(len(x), np.inf, np.float32)
    distance, term = np.empty_like(x), np.empty_like(x)
    indices = np.empty(n, np.int64)
    index = start
    for k in range(n):
        indices[k] = index
        np.subtract(x, x[index], out=distance)
        np.multiply(distance, distance, out=distance)
        for axis in (y, z):
            np.subtract(axis, axis[index], out=term)
            np.multiply(term, term, out=term)
            np.add(distance, term, out=distance)
        np.minimum(squared, distance, out=squared)
        index = int(squared.argmax())
    return indices


def _resized(points: torch.Tensor, valid: torch.Tensor, size: str) -> torch.Tensor:
    """`points` (B, K, 3) at `size`; a cloud's spread is the root mean square of the valid ones' distances from 0."""
    if size == "kept":
        return points
    squared = (points.square().sum(dim=2) * valid).sum(dim=1) / valid.sum(dim=1)
    spread = squared.sqrt()[:, None, None]
    unit = points / spread.clamp_min(1e-9)
    return unit if size == "unit" else unit * spread.clamp(*_ROOTED_SPREADS).sqrt()


@dataclass(frozen=True)
class Preprocess:
    """How a cloud becomes the network's input; part of a checkpoint.

    drop_isolated: points are dropped first that stand more than this many times as far from their neighbours as is
    usual in the cloud (`pec.preprocessing.isolated`); None keeps all.
    n_points: points that the network takes. n_candidates: points that are left for the ordering to pick from.
    sampling: how they are picked: "farthest" (FPS), or "random" (all, of a cloud that has no more).
    start: "random" first point of FPS (published), or "farthest" from the centroid (no chance in it).
    pose: "given", "principal" (axes of the cloud's covariance, signs by third moments), or "upright" (as given, and
    mirrored in x, in y and in both: four views).
    ordering: "none" (the order of FPS), "groups" (published grouping of `group_size`), "anchors" (fixed positions).
    anchor_unit: what the fixed positions are measured in, the cloud's spread along each "axis" or of the whole "cloud".
    size: "kept" in metres (published: it tells classes apart), "unit": divided by the cloud's spread, or "root": of
    unit size times the square root of its spread, which counts as 0.02 m at least and 2 m at most, so that one model in
    millimetres does not drown its batch.
    """

    n_points: int = 64
    n_candidates: int = 64
    sampling: str = "farthest"
    start: str = "random"
    pose: str = "given"
    ordering: str = "groups"
    group_size: int = 16
    anchor_unit: str = "axis"
    size: str = "kept"
    drop_isolated: float | None = None

    def __post_init__(self) -> None:
        if self.ordering not in ORDERINGS:
            raise ConfigError(f"preprocess.ordering must be one of {ORDERINGS}, got {self.ordering!r}")
        if self.pose not in POSES:
            raise ConfigError(f"preprocess.pose must be one of {POSES}, got {self.pose!r}")
        if self.sampling not in ("farthest", "random"):
            raise ConfigError(f"preprocess.sampling must be 'farthest' or 'random', got {self.sampling!r}")
        if self.start not in ("random", "farthest"):
            raise ConfigError(f"preprocess.start must be 'random' or 'farthest', got {self.start!r}")
        if self.n_points < 2 or self.n_points % 2:
            raise ConfigError(f"preprocess.n_points must be even and positive, got {self.n_points}")
        if self.n_candidates < self.n_points:
            raise ConfigError(f"preprocess.n_candidates {self.n_candidates} is less than n_points {self.n_points}")
        if self.anchor_unit not in ("axis", "cloud"):
            raise ConfigError(f"preprocess.anchor_unit must be 'axis' or 'cloud', got {self.anchor_unit!r}")
        if self.size not in SIZES:
            raise ConfigError(f"preprocess.size must be one of {SIZES}, got {self.size!r}")
        if self.drop_isolated is not None and self.drop_isolated < 1:
            raise ConfigError(
                f"preprocess.drop_isolated must be 1 or more, or null to keep all, got {self.drop_isolated}"
            )
        if self.ordering != "anchors" and self.n_candidates != self.n_points:
            raise ConfigError(
                f"preprocess.ordering {self.ordering!r} takes every candidate: n_candidates must be n_points"
            )
        if self.ordering == "groups" and (self.group_size < 1 or self.n_points % self.group_size):
            raise ConfigError(f"preprocess.group_size {self.group_size} does not divide n_points {self.n_points}")

    @property
    def n_views(self) -> int:
        """In how many equally valid poses a cloud can be arranged: 4 where the signs of two axes are open."""
        return 1 if self.pose == "given" else 4

    @property
    def draws(self) -> bool:
        """Whether chance has a part in `sample`."""
        return self.sampling == "random" or self.start == "random"

    def sample(self, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Centred candidates (K, 3) float32, n_points ≤ K ≤ n_candidates, of a raw cloud (N, 3) in metres.

        Raises CloudError where the cloud is not finite (N, 3) with N ≥ n_points.
        """
        points = check_cloud(points, self.n_points)
        if self.drop_isolated is not None and np.isfinite(points).all():  # what is not is refused below
            points = without_isolated(points, self.drop_isolated, self.n_points)
        n = min(self.n_candidates, len(points))
        if self.sampling == "random":
            centred = _centred(points)
            return centred if n == len(centred) else centred[rng.choice(len(centred), n, replace=False)]
        start = int(rng.integers(len(points))) if self.start == "random" else None
        sampled = None
        if kernels.AVAILABLE and points.dtype in (np.float32, np.float64):
            sampled = kernels.farthest_points(points, n, start)
        return farthest_points(points, n, start) if sampled is None else sampled

    def arrange(self, candidates: torch.Tensor, valid: torch.Tensor, view: torch.Tensor | None = None) -> torch.Tensor:
        """The network's input (B, n_points, 3).

        candidates (B, K, 3) centred metres; valid (B, K) bool, at least one a row; view (B,) int in [0, n_views):
        which of the equally valid poses, 0 where not given.
        """
        candidates = _resized(candidates, valid, self.size)
        if self.ordering == "none":
            return candidates
        if self.ordering == "groups":
            order = group_order(candidates, self.group_size)
        else:
            if self.pose == "principal":
                candidates = principal_pose(candidates, valid, view)
            elif self.pose == "upright" and view is not None:
                candidates = candidates * torch.from_numpy(_SIGNS["upright"]).to(candidates)[view, None]
            anchors = anchor_positions(self.n_points).to(candidates)
            order = nearest_candidates(candidates, valid, anchors, each_axis=self.anchor_unit == "axis")
        return candidates.gather(1, order[..., None].expand(-1, -1, 3))

    def views(self, samples: Sequence[np.ndarray]) -> np.ndarray:
        """The network's inputs (B, n_views, n_points, 3) float32, of the candidates of B clouds as `sample` gives them.

        As `arrange` gives them in each of the equally valid poses, but for rounding; the poses come in any order.
        """
        if kernels.AVAILABLE and self.ordering != "none":
            return np.stack([self._compiled_views(candidates) for candidates in samples])
        lengths = np.array([len(candidates) for candidates in samples])
        padded = np.zeros((len(samples), lengths.max(), 3), np.float32)
        for row, candidates in zip(padded, samples, strict=True):
            row[: len(candidates)] = candidates
        valid = torch.from_numpy(np.arange(lengths.max()) < lengths[:, None])
        copies = torch.from_numpy(padded).repeat_interleave(self.n_views, dim=0)
        view = torch.arange(self.n_views).repeat(len(samples))
        inputs = self.arrange(copies, valid.repeat_interleave(self.n_views, dim=0), view)
        return inputs.unflatten(0, (len(samples), self.n_views)).numpy()

    def _compiled_views(self, candidates: np.ndarray) -> np.ndarray:
        """`views` of one cloud's candidates (K, 3): (n_views, n_points, 3)."""
        if self.size != "kept":  # as _resized
            spread = math.sqrt(np.vdot(candidates, candidates) / len(candidates))
            root = math.sqrt(min(max(spread, _ROOTED_SPREADS[0]), _ROOTED_SPREADS[1])) if self.size == "root" else 1.0
            candidates = candidates * np.float32(root / max(spread, 1e-9))
        if self.ordering == "groups":
            return candidates[kernels.group_order(candidates, self.group_size)][None]
        return kernels.arranged(
            candidates,
            anchor_positions(self.n_points).numpy(),
            _SIGNS[self.pose],
            principal=self.pose == "principal",
            each_axis=self.anchor_unit == "axis",
        )
