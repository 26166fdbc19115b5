"""A whole data set as one tensor of candidates, sampled once and cached under the hash of what decides it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file
from tqdm import tqdm

from pec.common.atomic_files import replacing
from pec.common.run_identity import settings_key
from pec.data.dataset import CloudDataset, remove_around_random_point
from pec.preprocessing.preprocess import Preprocess

__all__ = ["PreparedClouds", "prepare"]


@dataclass(frozen=True)
class PreparedClouds:
    """candidates (n, K, 3) float32, valid (n, K) bool, labels (n,) int64: what `Preprocess.arrange` takes. instances
    and things (n,) int64: as `CloudDataset` has them."""

    candidates: torch.Tensor
    valid: torch.Tensor
    labels: torch.Tensor
    instances: torch.Tensor
    things: torch.Tensor

    def __len__(self) -> int:
        return len(self.labels)

    def subset(self, indices: np.ndarray | torch.Tensor) -> PreparedClouds:
        index = torch.as_tensor(indices)
        return PreparedClouds(*(part[index] for part in self._parts))

    def to(self, device: torch.device) -> PreparedClouds:
        return PreparedClouds(*(part.to(device) for part in self._parts))

    @classmethod
    def joined(cls, parts: Sequence[PreparedClouds]) -> PreparedClouds:
        """One after the other; all with equally many candidates."""
        return cls(*(torch.cat(of_all) for of_all in zip(*(part._parts for part in parts), strict=True)))

    @property
    def _parts(self) -> tuple[torch.Tensor, ...]:
        return self.candidates, self.valid, self.labels, self.instances, self.things

    def of_known(self, n_classes: int) -> PreparedClouds:
        """Without strangers: the clouds whose label is one of the first `n_classes`."""
        return self.subset((self.labels < n_classes).nonzero()[:, 0])


def prepare(
    dataset: CloudDataset,
    preprocess: Preprocess,
    *,
    removed: float = 0.0,
    seed: int = 0,
    cache: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> PreparedClouds:
    """Sample every cloud of `dataset`; sample i draws from (seed, i), so subsets and order of work change nothing.

    removed: greatest fraction that the published defect takes from each cloud first, as far as enough points remain.
    cache: directory of files that a later call with equal settings and data reads instead.
    """
    path = None
    if cache is not None:
        path = Path(cache) / f"{_key(dataset, preprocess, removed, seed)}.safetensors"
        if path.is_file():
            try:
                return _prepared(load_file(path), dataset)
            except SafetensorError:
                path.unlink()  # a broken cache is only lost time
    candidates = np.zeros((len(dataset), preprocess.n_candidates, 3), np.float32)
    counts = np.zeros(len(dataset), np.int64)
    for index in tqdm(range(len(dataset)), desc="preprocessing", unit="cloud", disable=not progress, leave=False):
        rng = np.random.default_rng((seed, index))
        points = dataset.cloud(index)
        if removed:
            reduced = remove_around_random_point(points, removed, rng)
            points = reduced if len(reduced) >= preprocess.n_points else points
        sample = preprocess.sample(points, rng)
        candidates[index, : len(sample)] = sample
        counts[index] = len(sample)
    arrays: dict[str, np.ndarray] = {"candidates": candidates, "counts": counts}
    if path is not None:
        with replacing(path) as temporary:
            save_file(arrays, temporary)
    return _prepared(arrays, dataset)


def _prepared(arrays: dict[str, np.ndarray], dataset: CloudDataset) -> PreparedClouds:
    candidates = torch.from_numpy(arrays["candidates"])
    valid = torch.arange(candidates.shape[1])[None] < torch.from_numpy(arrays["counts"])[:, None]
    named = (torch.from_numpy(array) for array in (dataset.labels, dataset.instances, dataset.things))
    return PreparedClouds(candidates, valid, *named)


def _key(dataset: CloudDataset, preprocess: Preprocess, removed: float, seed: int) -> str:
    digest = hashlib.sha256()
    names = ("n_points", "n_candidates", "sampling", "start", "drop_isolated")
    sampling = {name: asdict(preprocess)[name] for name in names}
    for array in (dataset.offsets, dataset.labels, dataset.instances):
        digest.update(array.tobytes())
    return settings_key(1, sampling, removed, seed, dataset.fingerprint, digest.hexdigest())
