"""A data set of simple shapes, written in the product's own format: quick to make, and easy to tell apart; and
trainings that are stopped before they are done."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pec.data.shards import CloudSample, Manifest, shard_name, write_manifest, write_shard
from pec.training.epoch_state import EpochState

CLASSES = ["ball", "plate", "rod"]
_SIZES = {"ball": (0.05, 0.05, 0.05), "plate": (0.09, 0.07, 0.004), "rod": (0.12, 0.01, 0.008)}


def shape(name: str, rng: np.random.Generator, n: int = 200) -> np.ndarray:
    """(n, 3) points on an ellipsoid's surface at a random pose half a metre before the camera; metres."""
    points = rng.normal(size=(n, 3))
    points *= np.array(_SIZES[name]) / np.linalg.norm(points, axis=1, keepdims=True)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return (points @ rotation.T + [0.1, -0.05, 0.5]).astype(np.float32)


def write_shapes(directory: Path, samples_per_instance: int = 20, instances: int = 2, seed: int = 0) -> Path:
    rng = np.random.default_rng(seed)
    records, listed = [], []
    for label, name in enumerate(CLASSES):
        samples = []
        for instance in range(instances):
            index = len(listed)
            listed.append({"name": f"{name}_{instance}", "class": name})
            for i in range(samples_per_instance):
                samples.append(CloudSample(shape(name, rng), label, index, np.eye(4), i))
        records.append(write_shard(directory / shard_name(label), samples))
    write_manifest(directory, Manifest(CLASSES, listed, [{"name": "any"}], {}, seed, {}, records, complete=True))
    return directory


@pytest.fixture(scope="session")
def shapes(tmp_path_factory) -> Path:
    return write_shapes(tmp_path_factory.mktemp("shapes"))


@pytest.fixture
def stopped_after(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], AbstractContextManager[None]]:
    """A context in which a training must be stopped, as by Ctrl-C, once so many epochs are saved."""
    finish = EpochState.finish_epoch

    @contextmanager
    def stopped(epochs: int) -> Iterator[None]:
        def stop(state: EpochState, *figures: Any) -> None:
            finish(state, *figures)
            if state.epoch == epochs:
                raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(EpochState, "finish_epoch", stop)
            with pytest.raises(KeyboardInterrupt):
                yield

    return stopped
