"""Clouds of whole tables with a class for every point, as one file.

    FILE.safetensors
        points    (n, M, 3) float32  what stands on a table, m: z up from the table's plane, x and y about the mean
        label     (n, M) uint8       into `classes`
        distinct  (n,) int64         the first so many points of a cloud differ, the rest repeats them
        val       (n,) uint8         1: of a scene that is kept apart from training
    its metadata, texts: `classes` (JSON, the last is what is none of the others), `made_of` (what was read to make it)

The points of a cloud come in random order, so that the first m of them are a draw of m.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from pec.common.atomic_files import write_whole
from pec.data.augment import Augment, augment
from pec.errors import DatasetError

__all__ = ["LabelledClouds", "drawn", "read_clouds", "write_clouds"]


@dataclass(frozen=True)
class LabelledClouds:
    """As the module's docstring has it. version: decided by the content."""

    points: torch.Tensor
    label: torch.Tensor
    distinct: torch.Tensor
    val: torch.Tensor
    classes: list[str]
    made_of: str
    version: str = ""

    def __len__(self) -> int:
        return len(self.points)

    def part(self, val: bool) -> LabelledClouds:
        """The clouds that are kept apart from training, or the others."""
        kept = self.val == val
        return LabelledClouds(
            self.points[kept], self.label[kept], self.distinct[kept], self.val[kept], self.classes, self.made_of,
            self.version,
        )  # fmt: skip


def write_clouds(path: Path, clouds: LabelledClouds) -> None:
    """Write the file atomically."""
    tensors = {"points": clouds.points, "label": clouds.label, "distinct": clouds.distinct, "val": clouds.val}
    write_whole(path, save(tensors, {"classes": json.dumps(clouds.classes), "made_of": clouds.made_of}))


def read_clouds(path: Path, n_points: int) -> LabelledClouds:
    """Raises DatasetError where the file is missing, broken, empty, or has fewer points a cloud than `n_points`."""
    if not path.is_file():
        raise DatasetError(f"no labelled clouds: {path} does not exist; `pecgrasp train-points` makes them of frames")
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in ("points", "label", "distinct", "val")}
            about = file.metadata()
        classes, made_of = [str(name) for name in json.loads(about["classes"])], about["made_of"]
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise DatasetError(f"{path} is no file of labelled clouds: {error}; delete it, and it is made anew") from error
    n, most = tensors["points"].shape[:2]
    if not n:
        raise DatasetError(f"{path} has no cloud")
    if most < n_points:
        raise DatasetError(f"{path} has {most} points a cloud, {n_points} are asked for")
    tensors["val"] = tensors["val"].bool()
    return LabelledClouds(
        **tensors, classes=classes, made_of=made_of, version=hashlib.sha256(path.read_bytes()).hexdigest()
    )


def drawn(
    clouds: LabelledClouds, index: torch.Tensor, n_points: int, changes: Augment, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """A draw of the clouds `index` (B,): points (B, n_points, 3), changed, and labels (B, n_points) int64."""
    points, label = clouds.points[index], clouds.label[index]
    keys = torch.rand(label.shape, generator=generator)
    keys += torch.arange(label.shape[1]) >= clouds.distinct[index, None]  # what repeats others comes last
    chosen = keys.topk(n_points, dim=1, largest=False).indices
    points = points.gather(1, chosen[..., None].expand(-1, -1, 3))
    points, _ = augment(points, torch.ones(chosen.shape, dtype=torch.bool), changes, generator)
    return points, label.gather(1, chosen).long()
