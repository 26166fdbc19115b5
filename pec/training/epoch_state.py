"""What a training has come to, kept in OUTPUT/last after each epoch, and resumed: of a network that has own files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import nn

from pec.checkpoint import TrainingState, read_training_state
from pec.common.optimizer_state import adam_moments, adamw, restore_adam_moments
from pec.common.run_identity import check_same_run
from pec.training.precision import Precision

__all__ = ["EpochState", "NetworkFiles", "TrainingRun"]

Net = TypeVar("Net", bound=nn.Module)


@dataclass(frozen=True)
class TrainingRun:
    """Which run an output folder is for: the settings that decide what it comes to, and a hash of its data.

    other_data: how an error calls data that are not the run's.
    """

    output: str
    settings: Mapping[str, Any]
    data: str
    other_data: str

    def check(self, earlier: Mapping[str, Any]) -> None:
        """ConfigError where `earlier`, what is in the folder, is of another run."""
        check_same_run(self.output, self.settings, self.data, earlier, self.other_data)

    def results(self) -> dict[str, Any] | None:
        """OUTPUT/results.json of a run that is done, else None. Raises ConfigError where it is another's."""
        file = Path(self.output) / "results.json"
        if not file.is_file():
            return None
        results: dict[str, Any] = json.loads(file.read_text())
        self.check(results)
        return results


@dataclass(frozen=True)
class NetworkFiles(Generic[Net]):
    """How a network's checkpoint is written, given the epoch and the state that training goes on from, and read."""

    write: Callable[[Path, Net, int, TrainingState | None], None]
    read: Callable[[Path], Net]


class EpochState(Generic[Net]):
    """The state after `epoch` epochs of a run: where its folder is new 0, otherwise those that were saved.

    best: of the epoch whose checkpoint is OUTPUT/best: "epoch", and what it was judged by. history: a value an epoch of
    each curve. precision: what the first epoch was made in; None where that is still to be chosen, or never is.
    Raises ConfigError where the folder holds another run, CheckpointError where what it holds is broken.
    """

    def __init__(
        self,
        run: TrainingRun,
        build: Callable[[], Net],
        files: NetworkFiles[Net],
        *,
        seed: int,
        learning_rate: float,
        weight_decay: float,
        device: torch.device,
        curves: Sequence[str],
        judged_by: str,
        least_is_best: bool,
        precision: Precision | None = None,
    ) -> None:
        self._run, self._files, self._judged_by, self._least_is_best = run, files, judged_by, least_is_best
        self._output = Path(run.output)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.network = build()
        self.network.to(device)
        self.optimizer = adamw(self.network, learning_rate, weight_decay, device)
        self.epoch, self.seconds = 0, 0.0
        self.best: dict[str, float] = {"epoch": 0, judged_by: math.inf if least_is_best else -math.inf}
        self.history: dict[str, list[float]] = {name: [] for name in curves}
        self.precision = precision
        self._resume()

    def finish_epoch(self, values: Sequence[float], judged: float, seconds: float) -> None:
        """Count one more epoch, values: of the curves; save OUTPUT/best where it is the best yet, and OUTPUT/last."""
        self.epoch += 1
        self.seconds += seconds
        best = self.best[self._judged_by]
        if judged < best if self._least_is_best else judged > best:
            self.best = {"epoch": self.epoch, self._judged_by: judged}
            self._files.write(self._output / "best", self.network, self.epoch, None)
        for name, value in zip(self.history, values, strict=True):
            self.history[name].append(value)
        progress = {
            "epoch": self.epoch,
            "seconds": self.seconds,
            "best": self.best,
            "history": self.history,
            "config": self._run.settings,
            "data": self._run.data,
        }
        if self.precision is not None:
            progress["precision"] = self.precision.as_dict()
        state = TrainingState(adam_moments(self.network, self.optimizer), progress)
        self._files.write(self._output / "last", self.network, self.epoch, state)

    def _resume(self) -> None:
        state = read_training_state(self._output / "last")
        if state is None:
            return
        progress = state.progress
        self._run.check(progress)
        self.network.load_state_dict(self._files.read(self._output / "last").state_dict())
        restore_adam_moments(self.network, self.optimizer, state.optimizer)
        self.epoch, self.seconds = progress["epoch"], progress["seconds"]
        self.best, self.history = progress["best"], progress["history"]
        if "precision" in progress:
            self.precision = Precision(**progress["precision"])
