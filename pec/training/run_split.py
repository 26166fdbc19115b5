"""Which clouds of a data set a run learns from, which choose its epoch, and which it is tested on."""

from __future__ import annotations

import numpy as np

from pec.data.dataset import CloudDataset
from pec.data.splits import divide, split_by_instance, split_by_sample
from pec.errors import DatasetError
from pec.training.config import DatasetConfig

__all__ = ["split"]


def split(
    dataset: CloudDataset, settings: DatasetConfig, selection: str, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices (train, selection, test). Published protocol: selection and test are one and the same split.

    Test is the one that the data set stores, equal for every seed, where it stores one of this fraction.
    """
    rng = np.random.default_rng((seed, 0x5911))
    if settings.split == "official":
        if dataset.official_test is None:
            raise DatasetError(f"{settings.path} has no official split; use dataset.split=sample or instance")
        rest, test = np.flatnonzero(~dataset.official_test), np.flatnonzero(dataset.official_test)
    else:
        rest, test = divide(dataset, settings.split, settings.train_fraction, rng)
    if selection == "evaluation split":
        return rest, test, test
    # Instances kept apart from test are too few to be cut again where a class has only two of them.
    enough = settings.split == "instance" and all(
        len(np.unique(dataset.instances[rest][dataset.labels[rest] == label])) > 2
        for label in range(len(dataset.classes))
    )
    cut = split_by_instance if enough else split_by_sample
    training, validation = cut(dataset, 1 - settings.validation_fraction, rng, rest)
    return training, validation, test
