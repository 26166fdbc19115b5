"""The use of a trained network: a cloud in, a class and a confidence out, and whether it is of a class at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
import torch

from pec.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from pec.common.threads import torch_threads
from pec.data.dataset import UNKNOWN
from pec.errors import CheckpointError, CloudError, ConfigError
from pec.known.evidence import answers_of, described, tempered
from pec.known.form_witness import form_numbers
from pec.networks.registry import fast_embed

__all__ = ["UNKNOWN", "Classifier", "Prediction"]

_TOGETHER = 128  # clouds in one forward: bounds memory, changes no result


@dataclass(frozen=True)
class Prediction:
    """label: the likeliest class, or UNKNOWN where `known` is too low. confidence: the calibrated probability of the
    likeliest class, if the cloud is of one of them. probabilities: of every class, sum 1, if it is. known: in [0, 1],
    the calibrated probability that it is of one of them, of as many strangers as known things."""

    label: str
    confidence: float
    probabilities: dict[str, float]
    known: float


class Classifier:
    """Classifies clouds of single objects: `Classifier.load(directory).predict(points)`."""

    def __init__(self, checkpoint: Checkpoint, seed: int = 0) -> None:
        self._checkpoint = checkpoint
        self._embed = fast_embed(checkpoint.model)
        self._classes = [*checkpoint.classes, *checkpoint.enrolled.names]
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
        `Prediction.known` below which a cloud is UNKNOWN, 0 for never; where not given the checkpoint's, which rejects
        one in twenty clouds of unseen instances of its classes (`pec.metrics.rejection`). A checkpoint of an older
        version has nothing but its confidence to know by: there `known` is the confidence.
        Raises CheckpointError where it is missing, broken, or of other classes, ConfigError where unknown_below is no
        probability.
        """
        checkpoint = read_checkpoint(directory)
        there = [*checkpoint.classes, *checkpoint.enrolled.names]
        if classes is not None and set(classes) != set(there):
            raise CheckpointError(
                f"checkpoint {directory} knows the classes {', '.join(there)}, not {', '.join(classes)}"
            )
        if unknown_below is not None:
            if not 0 <= unknown_below <= 1:
                raise ConfigError(f"unknown_below must be in [0, 1], got {unknown_below}")
            checkpoint = replace(checkpoint, unknown_below=unknown_below)
        return cls(checkpoint, seed)

    @property
    def classes(self) -> list[str]:
        """The names of the known classes: those of the network's outputs, then those that were enrolled."""
        return list(self._classes)

    @property
    def unknown_below(self) -> float:
        """The `Prediction.known` below which a cloud is UNKNOWN."""
        return self._checkpoint.unknown_below

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
            predictions += self._predict(self._samples(points[begin : begin + _TOGETHER], begin))
        return predictions

    def _sample(self, points: np.ndarray) -> np.ndarray:
        preprocess = self._checkpoint.preprocess
        rng = np.random.default_rng(self._seed) if preprocess.draws else self._unused
        return preprocess.sample(points, rng)

    def enrol(self, name: str, clouds: Sequence[np.ndarray]) -> Classifier:
        """A classifier that knows one class more, from clouds (N, 3) of it, one at least; this one stays as it is.

        Nothing is trained: what is near to one of the clouds is of the class (`pec.known.enrolled`), as far as no other
        class is likelier. The more sides the clouds show, the better; eight are a good start.
        Raises ConfigError where the name is empty, reserved or taken, CloudError where there is no cloud or a bad one,
        CheckpointError where the checkpoint is of an older version, which knows nothing of nearness.
        """
        checkpoint = self._checkpoint
        if not name or name == UNKNOWN:
            raise ConfigError(f"a class cannot be called {name!r}")
        if name in self.classes:
            raise ConfigError(f"there is a class {name!r} already; the classes are {', '.join(self.classes)}")
        if checkpoint.knowing is None:
            raise CheckpointError("this checkpoint is of a version that cannot be shown new classes: train it anew")
        if not len(clouds):
            raise CloudError(f"class {name!r} needs at least one cloud")
        samples = self._samples(clouds, 0)
        enrolled = checkpoint.enrolled.with_class(name, described(samples))
        return Classifier(replace(checkpoint, enrolled=enrolled), self._seed)

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write it as a checkpoint that `load` reads, enrolled classes included; atomically."""
        write_checkpoint(directory, self._checkpoint)

    def _samples(self, clouds: Sequence[np.ndarray], first: int) -> list[np.ndarray]:
        """Candidates of each; an error names a cloud by its number, `first` that of the first."""
        samples = []
        for index, cloud in enumerate(clouds, first):
            try:
                samples.append(self._sample(cloud))
            except CloudError as error:
                raise CloudError(f"cloud {index}: {error}") from error
        return samples

    def _predict(self, samples: list[np.ndarray]) -> list[Prediction]:
        checkpoint = self._checkpoint
        knowing, n_trained = checkpoint.knowing, len(checkpoint.classes)
        # Before the weights push all else out of the caches.
        descriptors = described(samples if knowing else [])
        by_form, weight = None, 1.0
        if checkpoint.forms is not None:
            weight = float(checkpoint.forms.network_weight[0])
            by_form = checkpoint.forms.log_probabilities(form_numbers(samples, descriptors if knowing else None))
        with torch_threads(1), torch.no_grad():
            # All at once: of a few clouds, the time goes into reading the weights, not into their products.
            views = torch.from_numpy(checkpoint.preprocess.views(samples))
            logits, features = self._embed(views.flatten(0, 1))
        answers = answers_of(logits, features, descriptors, n_trained, views.shape[1], by_form, weight)
        rows = tempered(answers.log_probabilities[:, :n_trained], checkpoint.temperature)
        known = rows.max(axis=1) if knowing is None else knowing.known(answers)
        if knowing is not None and checkpoint.enrolled.names:
            rows, known = checkpoint.enrolled.answer(knowing.nearness, descriptors, rows, known)
        predictions = []
        for row, score in zip(rows.tolist(), known.tolist(), strict=True):
            confidence = max(row)
            label = self._classes[row.index(confidence)] if score >= checkpoint.unknown_below else UNKNOWN
            predictions.append(Prediction(label, confidence, dict(zip(self._classes, row, strict=True)), score))
        return predictions
