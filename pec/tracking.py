"""What a training run shows in TensorBoard."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np
from torch.utils.tensorboard import SummaryWriter

from pec.evaluation import Scores

__all__ = ["Tracker", "confusion_image"]


class Tracker:
    """Writes curves and confusion matrices below `directory`; use it as a context.

    first_epoch: epochs done before; what an interrupted run wrote after them is hidden.
    """

    def __init__(self, directory: Path, first_epoch: int | None) -> None:
        purge = None if first_epoch is None else first_epoch + 1
        self._writer = SummaryWriter(str(directory), purge_step=purge)

    def __enter__(self) -> Tracker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()

    def epoch(self, epoch: int, loss: float, accuracy: float, selection: Scores, rate: float) -> None:
        """The numbers of one finished epoch (counted from 1)."""
        self._writer.add_scalar("loss/train", loss, epoch)
        self._writer.add_scalar("loss/selection", selection.loss, epoch)
        self._writer.add_scalar("accuracy/train", accuracy, epoch)
        self._writer.add_scalar("accuracy/selection", selection.accuracy, epoch)
        self._writer.add_scalar("learning_rate", rate, epoch)

    def confusion(self, name: str, epoch: int, classes: list[str], scores: Scores) -> None:
        """The confusion on the test split of the checkpoint `name`, as a picture and as a table."""
        self._writer.add_image(f"confusion/{name}", confusion_image(scores.confusion), epoch, dataformats="HW")
        rows = [" | ".join(["truth ↓ predicted →", *classes]), " | ".join(["---"] * (len(classes) + 1))]
        rows += [
            " | ".join([truth, *map(str, counts)]) for truth, counts in zip(classes, scores.confusion, strict=True)
        ]
        self._writer.add_text(f"confusion/{name}", "\n".join(rows), epoch)


def confusion_image(confusion: list[list[int]], cell: int = 32) -> np.ndarray:
    """(C·cell, C·cell) uint8: a row a true class, brightness the share of the row; a white diagonal is perfect."""
    counts = np.array(confusion, float)
    share = counts / counts.sum(axis=1, keepdims=True).clip(min=1)
    return np.kron(np.round(255 * share), np.ones((cell, cell))).astype(np.uint8)
