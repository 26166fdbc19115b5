"""What a training run shows in TensorBoard: curves; in the end what it got wrong, what it cost, how it was set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams

from pec.checkpoint import Checkpoint
from pec.common.run_identity import flat_settings
from pec.data.tensor_dataset import PreparedClouds
from pec.metrics.scores import Scores
from pec.training.config import TrainConfig

__all__ = ["Tracker", "confusion_image"]

_MOST_CLOUDS = 12  # of the misclassified ones are shown
_POINTS_MATERIAL = {"material": {"cls": "PointsMaterial", "size": 0.06}}  # the clouds are shown at radius 1


class Tracker:
    """Writes below `directory`; use it as a context.

    first_epoch: epochs done before; what an interrupted run wrote after them is hidden. None: hide nothing.
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

    def epoch(
        self, epoch: int, loss: float, accuracy: float, selection: Scores, rate: float, classes: list[str]
    ) -> None:
        """The numbers of one finished epoch (counted from 1)."""
        self._writer.add_scalar("loss/train", loss, epoch)
        self._writer.add_scalar("loss/selection", selection.loss, epoch)
        self._writer.add_scalar("accuracy/train", accuracy, epoch)
        self._writer.add_scalar("accuracy/selection", selection.accuracy, epoch)
        self._writer.add_scalar("learning_rate", rate, epoch)
        for name, share in zip(classes, selection.per_class, strict=True):
            self._writer.add_scalar(f"accuracy_of_class/selection/{name}", share, epoch)

    def final(self, name: str, checkpoint: Checkpoint, scores: Scores) -> None:
        """The confusion and the classes on the test split by the checkpoint `name`, as a picture and as a table."""
        epoch, classes = checkpoint.epoch, checkpoint.classes
        self._writer.add_image(f"confusion/{name}", confusion_image(scores.confusion), epoch, dataformats="HW")
        rows = [
            " | ".join(["truth ↓ predicted →", *classes, "right %"]),
            " | ".join(["---"] * (len(classes) + 2)),
        ]
        for truth, counts, share in zip(classes, scores.confusion, scores.per_class, strict=True):
            rows.append(" | ".join([truth, *map(str, counts), f"{100 * share:.1f}"]))
            self._writer.add_scalar(f"accuracy_of_class/test_{name}/{truth}", share, epoch)
        self._writer.add_text(f"confusion/{name}", "\n".join(rows), epoch)

    def misclassified(self, checkpoint: Checkpoint, clouds: PreparedClouds, predicted: torch.Tensor) -> None:
        """The first clouds whose `predicted` (n,) class is wrong, as points that one can turn, scaled to radius 1."""
        classes = checkpoint.classes
        for index in (predicted != clouds.labels).nonzero()[:_MOST_CLOUDS, 0].tolist():
            points = clouds.candidates[index][clouds.valid[index]].cpu()
            points = points / points.norm(dim=1).max().clamp_min(1e-9)
            shade = (0.5 + 0.5 * points[:, 2:]).clamp(0, 1)  # by height: depth is hard to see in bare points
            colours = (255 * torch.cat([shade, 0.4 + 0 * shade, 1 - shade], dim=1)).to(torch.uint8)
            tag = f"misclassified/{classes[clouds.labels[index]]}_taken_for_{classes[predicted[index]]}/{index}"
            self._writer.add_mesh(tag, points[None], colours[None], config_dict=_POINTS_MATERIAL)

    def settings(self, config: TrainConfig, costs: Mapping[str, float], metrics: Mapping[str, float]) -> None:
        """The settings and the costs as hyper-parameters beside what came of them."""
        settings = flat_settings(config.decisive())
        # Lists and None as text: TensorBoard takes plain values only.
        plain = {name: v if isinstance(v, bool | int | float | str) else str(v) for name, v in settings.items()}
        values = {**plain, **costs}
        # Into this run itself: SummaryWriter.add_hparams makes a run of its own, apart from the curves.
        for summary in hparams(values, dict(metrics)):
            self._writer._get_file_writer().add_summary(summary)
        for name, value in metrics.items():
            self._writer.add_scalar(name, value)


def confusion_image(confusion: list[list[int]], cell: int = 32) -> np.ndarray:
    """(C·cell, C·cell) uint8: a row a true class, brightness the share of the row; a white diagonal is perfect."""
    counts = np.array(confusion, float)
    share = counts / counts.sum(axis=1, keepdims=True).clip(min=1)
    return np.kron(np.round(255 * share), np.ones((cell, cell))).astype(np.uint8)
