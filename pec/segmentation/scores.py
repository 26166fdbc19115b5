"""What a labelling of points is worth: accuracy, and intersection over union by class."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

from pec.segmentation.clouds import LabelledClouds

__all__ = ["PointScores", "confusion_of", "predicted", "scores"]

_TOGETHER = 8  # clouds: bounds memory, changes no result


@dataclass(frozen=True)
class PointScores:
    """accuracy: share of all points that are right. iou: of each class, over the points of all clouds; None of one that
    is neither there nor said to be. mean_iou: over the classes that have one. confusion[truth][said]: points."""

    accuracy: float
    mean_iou: float
    iou: dict[str, float | None]
    confusion: list[list[int]]

    def as_dict(self) -> dict[str, object]:
        return {"accuracy": self.accuracy, "mean_iou": self.mean_iou, "iou": self.iou, "confusion": self.confusion}


@torch.inference_mode()
def predicted(network: nn.Module, points: torch.Tensor) -> torch.Tensor:
    """(n, N) uint8: the likeliest class of each of points (n, N, 3)."""
    network.eval()
    parts = [network(part).argmax(dim=2).to(torch.uint8) for part in points.split(_TOGETHER)]
    return torch.cat(parts)


def confusion_of(network: nn.Module, clouds: LabelledClouds, n_points: int) -> torch.Tensor:
    """(C, C) points of each class and what they are said to be, of the first `n_points` of each cloud."""
    n = len(clouds.classes)
    device = next(network.parameters()).device
    said = predicted(network, clouds.points[:, :n_points].to(device)).cpu()
    pairs = clouds.label[:, :n_points].long() * n + said.long()
    return pairs.flatten().bincount(minlength=n * n).view(n, n)


def scores(confusion: torch.Tensor, classes: list[str]) -> PointScores:
    """Scores of a confusion (C, C)."""
    right = confusion.diag()
    union = confusion.sum(dim=0) + confusion.sum(dim=1) - right
    iou = [(r / u).item() if u else None for r, u in zip(right.double(), union, strict=True)]
    there = [value for value in iou if value is not None]
    accuracy = (right.sum() / confusion.sum()).item()
    return PointScores(accuracy, sum(there) / len(there), dict(zip(classes, iou, strict=True)), confusion.tolist())
