"""The use of a trained network: a cloud in, a class and a confidence out."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
import torch

from pec.checkpoint import Checkpoint, read_checkpoint
from pec.common.threads import torch_threads
from pec.errors import CheckpointError, CloudError, ConfigError
from pec.networks.registry import fast_forward

__all__ = ["UNKNOWN", "Classifier", "Prediction"]

UNKNOWN = "unknown"

_TOGETHER = 128  # clouds in one forward: bounds memory, changes no result


@dataclass(frozen=True)
class Prediction:
    """label: the likeliest class, or UNKNOWN where its confidence is too low. confidence: the calibrated probability of
    the likeliest class. probabilities: of every class, sum 1."""

    label: str
    confidence: float
    probabilities: dict[str, float]


class Classifier:
    """Classifies clouds of single objects: `Classifier.load(directory).predict(points)`."""

    def __init__(self, checkpoint: Checkpoint, seed: int = 0) -> None:
        self._checkpoint = checkpoint
        self._model = fast_forward(checkpoint.model)
        self._seed = seed
        self._unused = np.random.default_rng(seed)

    @classmethod
    def load(
        cls,
        directory: str | os.PathLike[str],
        classes: Sequence[str] | None = None,
        seed: int = 0,
        unknown_below: float | None = None,
    ) -> Classifier:
        """Load a checkpoint. `classes`: those that the caller counts on, in any order; more or fewer are an error.

        seed: of the random start of farthest point sampling, in the published preprocessing only. unknown_below: the
        confidence below which a cloud is UNKNOWN, 0 for never; where not given the checkpoint's, which rejects one in a
        hundred clouds of known objects (`pec.metrics.rejection_threshold`).
        Raises CheckpointError where it is missing, broken, or of other classes, ConfigError where unknown_below is no
        confidence.
        """
        checkpoint = read_checkpoint(directory)
        if classes is not None and set(classes) != set(checkpoint.classes):
            raise CheckpointError(
                f"checkpoint {directory} knows the classes {', '.join(checkpoint.classes)}, not {', '.join(classes)}"
            )
        if unknown_below is not None:
            if not 0 <= unknown_below <= 1:
                raise ConfigError(f"unknown_below must be in [0, 1], got {unknown_below}")
            checkpoint = replace(checkpoint, unknown_below=unknown_below)
        return cls(checkpoint, seed)

    @property
    def classes(self) -> list[str]:
        """The class names, in the order of the network's outputs."""
        return list(self._checkpoint.classes)

    @property
    def n_points(self) -> int:
        """The fewest points that a cloud must have."""
        return self._checkpoint.preprocess.n_points

    @overload
    def predict(self, points: np.ndarray) -> Prediction: ...
    @overload
    def predict(self, points: Sequence[np.ndarray]) -> list[Prediction]: ...
    def predict(self, points: np.ndarray | Sequence[np.ndarray]) -> Prediction | list[Prediction]:
        """Classify one cloud (N, 3) of metres in any frame, or a list of clouds.

        A cloud is classified alike alone and in a list. Raises CloudError where a cloud is not finite (N, 3) or has
        fewer than `n_points` points; in a list it names which one.
        """
        if isinstance(points, np.ndarray):
            return self._predict([self._sample(points)])[0]
        predictions: list[Prediction] = []
        for begin in range(0, len(points), _TOGETHER):
            samples = []
            for index, cloud in enumerate(points[begin : begin + _TOGETHER], begin):
                try:
                    samples.append(self._sample(cloud))
                except CloudError as error:
                    raise CloudError(f"cloud {index}: {error}") from error
            predictions += self._predict(samples)
        return predictions

    def _sample(self, points: np.ndarray) -> np.ndarray:
        preprocess = self._checkpoint.preprocess
        rng = np.random.default_rng(self._seed) if preprocess.draws else self._unused
        return preprocess.sample(points, rng)

    def _predict(self, samples: list[np.ndarray]) -> list[Prediction]:
        checkpoint = self._checkpoint
        with torch_threads(1), torch.no_grad():
            # All at once: of a few clouds, the time goes into reading the weights, not into their products.
            views = torch.from_numpy(checkpoint.preprocess.views(samples))
            logits = self._model(views.flatten(0, 1)).view(*views.shape[:2], -1).tolist()
        predictions = []
        for of_cloud in logits:
            row = _probabilities(of_cloud, checkpoint.temperature)
            confidence = max(row)
            label = checkpoint.classes[row.index(confidence)] if confidence >= checkpoint.unknown_below else UNKNOWN
            predictions.append(Prediction(label, confidence, dict(zip(checkpoint.classes, row, strict=True))))
        return predictions


def _probabilities(logits: list[list[float]], temperature: float) -> list[float]:
    """The tempered mean of the probabilities over the views, from the logits (V, C) of one cloud; sum 1.

    As `pec.metrics.average_views` and a softmax; for so few numbers plain arithmetic is the quickest.
    """
    mean = [0.0] * len(logits[0])
    for view in logits:
        exponentials = _exponentials(view)
        total = sum(exponentials)
        mean = [share + value / total for share, value in zip(mean, exponentials, strict=True)]
    most = max(mean)
    tempered = [(share / most) ** (1 / temperature) for share in mean]
    total = sum(tempered)
    return [share / total for share in tempered]


def _exponentials(values: list[float]) -> list[float]:
    most = max(values)
    return [math.exp(value - most) for value in values]
