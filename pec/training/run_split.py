"""Which clouds of a data set a run learns from, which choose its epoch and set its threshold, and which test it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pec.data.dataset import CloudDataset
from pec.data.splits import divide, split_by_instance, split_by_sample
from pec.errors import DatasetError
from pec.training.config import DatasetConfig

__all__ = ["Parts", "hold_out_instances", "split"]

_FEWEST = 4  # instances of a class of which one can be spared


@dataclass(frozen=True)
class Parts:
    """Indices of the clouds for each purpose. calibration: sets the threshold of the unknown. seen: classes of which
    calibration has instances that training sees, too."""

    training: np.ndarray
    selection: np.ndarray
    test: np.ndarray
    calibration: np.ndarray
    seen: list[str]


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
        len(np.unique(dataset.things[rest][dataset.labels[rest] == label])) > 2 for label in range(len(dataset.classes))
    )
    cut = split_by_instance if enough else split_by_sample
    training, validation = cut(dataset, 1 - settings.validation_fraction, rng, rest)
    return training, validation, test


def hold_out_instances(
    dataset: CloudDataset, parts: tuple[np.ndarray, np.ndarray, np.ndarray], fraction: float, seed: int
) -> Parts:
    """`split`'s parts with instances of each class for calibration.

    Where selection has unseen instances of a class only, those are taken. Where it has not, `fraction` of the class's
    instances, one at least, leave training and selection for calibration, each with its deformed copies; their test
    clouds stay test clouds. Of a class with fewer than 4 instances, and with fraction 0, calibration takes the
    selection clouds: seen instances.
    """
    training, selection, test = parts
    rng = np.random.default_rng((seed, 0xCA1B))
    held, seen, calibration = [], [], [np.empty(0, np.int64)]
    for label, name in enumerate(dataset.classes):
        chosen = selection[dataset.labels[selection] == label]
        learnt = np.unique(dataset.things[training][dataset.labels[training] == label])
        if np.isin(dataset.things[chosen], learnt).any() and fraction and len(learnt) >= _FEWEST:
            held.append(rng.permutation(learnt)[: max(1, round(fraction * len(learnt)))])
            continue
        calibration.append(chosen)
        if np.isin(dataset.things[chosen], learnt).any():
            seen.append(name)
    kept_out = np.concatenate([np.empty(0, np.int64), *held])
    for part in (training, selection):
        calibration.append(part[np.isin(dataset.things[part], kept_out)])
    training, selection = (part[~np.isin(dataset.things[part], kept_out)] for part in (training, selection))
    return Parts(training, selection, test, np.sort(np.concatenate(calibration)), seen)
