"""Training of a network that gives every point a class; killed and started again, it goes on.

Every draw of epoch e comes from (seed, e): on a CPU with the same number of threads an interrupted run ends in the same
weights, bit for bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torch.utils.tensorboard import SummaryWriter

from pec.common.atomic_files import write_json
from pec.common.devices import device_named
from pec.common.threads import torch_threads
from pec.data.augment import Augment
from pec.errors import DatasetError
from pec.networks.baselines import PointNet
from pec.networks.initialise import scale_initial_weights
from pec.networks.pec_segmentation import PECSegmentation
from pec.segmentation.checkpoint import read_point_checkpoint
from pec.segmentation.clouds import LabelledClouds, drawn, read_clouds
from pec.segmentation.config import PointTrainConfig, read_point_config
from pec.segmentation.run_state import point_run, point_state
from pec.segmentation.scores import confusion_of, scores
from pec.training.costs import median_ms, multiply_adds
from pec.training.epoch_bar import epoch_bar
from pec.training.epoch_state import EpochState
from pec.training.precision import choose_precision
from pec.training.running_statistics import without_their_start
from pec.training.schedule import warm_cosine
from pec.training.step import take_step

__all__ = ["train_points"]

_SCALED_TO = 8  # clouds that PEC's initial weights are scaled to


def train_points(cfg: Mapping[str, Any]) -> dict[str, Any]:
    """Train as `cfg` says (see `pec.segmentation.config.PointTrainConfig`).

    Returns what is also written to OUTPUT/results.json. OUTPUT/best and OUTPUT/last are checkpoints, OUTPUT/tensorboard
    the curves. A finished run is not repeated, an interrupted one goes on.
    Raises ConfigError, DatasetError, CheckpointError, or TrainingError where the loss is not finite.
    """
    config = read_point_config(cfg)
    device = device_named(config.device)
    most = max(config.n_points, config.also_at or 0)
    clouds = read_clouds(Path(config.clouds), most)
    test = None if config.test is None else read_clouds(Path(config.test), most)
    if test is not None and test.classes != clouds.classes:
        raise DatasetError(f"{config.test} has the classes {test.classes}, {config.clouds} {clouds.classes}")
    data = f"{clouds.version} {test.version if test else ''}"
    run = point_run(config, data)
    if (done := run.results()) is not None:
        return done
    splits = {"validation": clouds.part(val=True)} | ({"test": test} if test else {})
    training = clouds.part(val=False)
    if len(training) < 2 or not len(splits["validation"]):
        raise DatasetError(
            f"{config.clouds} has {len(training)} clouds to train on and {len(splits['validation'])} to choose the "
            "epoch on: two and one at least are needed"
        )
    with torch_threads(config.threads):
        state = point_state(config, run, clouds.classes, device)
        _fit(config, state, training, splits["validation"])
        results = _results(config, state, training, splits, device) | {"data": data}
    write_json(Path(config.output) / "results.json", results)
    return results


def _fit(
    config: PointTrainConfig, state: EpochState[nn.Module], training: LabelledClouds, validation: LabelledClouds
) -> None:
    """Train up to the configured epoch, saving after each."""
    epochs, device = config.protocol.epochs, next(state.network.parameters()).device
    if state.epoch == 0 and isinstance(state.network, PECSegmentation):  # its decoder has no batch norm
        scale_initial_weights(state.network, training.points[:_SCALED_TO, : config.n_points].to(device), config.seed)
    if state.precision is None:
        state.precision = choose_precision(_trial(config, state.network, training), device)
    writer = SummaryWriter(str(Path(config.output) / "tensorboard"), purge_step=state.epoch + 1)
    bar = epoch_bar(state.epoch, epochs, shown=config.progress)
    with writer, bar:
        for epoch in bar:
            begin = time.perf_counter()
            loss, rate = _epoch(config, state, training, epoch)
            found = scores(confusion_of(state.network, validation, config.n_points), training.classes)
            values = (loss, found.accuracy, found.mean_iou, rate)
            state.finish_epoch(values, found.mean_iou, time.perf_counter() - begin)
            for name, curve in state.history.items():
                writer.add_scalar("/".join(name.rsplit("_", 1)), curve[-1], epoch + 1)
            for name, iou in found.iou.items():
                writer.add_scalar(f"iou_validation/{name}", math.nan if iou is None else iou, epoch + 1)
            bar.set_postfix(loss=f"{loss:.3f}", mean_iou=f"{found.mean_iou:.3f}")


def _epoch(
    config: PointTrainConfig, state: EpochState[nn.Module], training: LabelledClouds, epoch: int
) -> tuple[float, float]:
    """Train by one pass, the `epoch`-th from 0; returns the mean loss and the last learning rate."""
    protocol, seed = config.protocol, config.seed * 1_000_003 + epoch
    assert state.precision is not None
    generator = torch.Generator().manual_seed(seed)
    n_steps = math.ceil(len(training) / protocol.batch_size)
    order = torch.randperm(len(training), generator=generator)
    total, rate = 0.0, protocol.learning_rate
    state.network.train()
    with torch.random.fork_rng(), without_their_start(state.network):
        torch.manual_seed(seed)  # dropout draws from torch's own generator
        # Batches of equal size: what is left over may be one cloud.
        for step, index in enumerate(order.tensor_split(n_steps)):
            rate = warm_cosine(protocol.learning_rate, (epoch * n_steps + step) / (protocol.epochs * n_steps))
            points, label = drawn(training, index, config.n_points, config.augment, generator)
            loss = _loss(state.network, points, label, state.precision.used)
            total += take_step(state.optimizer, loss, rate, epoch) * len(index)
    return total / len(training), rate


def _loss(network: nn.Module, points: torch.Tensor, label: torch.Tensor, precision: str) -> torch.Tensor:
    device = next(network.parameters()).device
    with torch.autocast(device.type, torch.bfloat16, enabled=precision == "bfloat16"):
        logits = network(points.to(device))
    loss = nn.functional.cross_entropy(logits.float().flatten(0, 1), label.to(device).flatten())
    if isinstance(network, PointNet):
        assert network.penalty is not None
        loss = loss + network.penalty
    return loss


def _trial(config: PointTrainConfig, network: nn.Module, training: LabelledClouds) -> Any:
    """A step of training in the precision that it is given, on a copy of the network, to be timed."""
    copy, generator = deepcopy(network).train(), torch.Generator().manual_seed(0)
    index = torch.arange(min(config.protocol.batch_size, len(training)))
    points, label = drawn(training, index, config.n_points, Augment(), generator)

    def step(precision: str) -> None:
        with torch.random.fork_rng():
            _loss(copy, points, label, precision).backward()

    return step


def _results(
    config: PointTrainConfig,
    state: EpochState[nn.Module],
    training: LabelledClouds,
    splits: Mapping[str, LabelledClouds],
    device: torch.device,
) -> dict[str, Any]:
    """What the run was, and the figures and costs of its best checkpoint: only here is the test split read."""
    best = Path(config.output) / "best"
    network = read_point_checkpoint(best).network
    assert state.precision is not None
    at_points = []
    for n in (config.n_points, *([config.also_at] if config.also_at else [])):
        cloud = training.points[:1, :n]
        with torch_threads(1), torch.no_grad():
            cost = {"multiply_adds": multiply_adds(network, n), "network_ms": median_ms(partial(network, cloud))}
        figures = {
            name: scores(confusion_of(network.to(device), clouds, n), clouds.classes).as_dict()
            for name, clouds in splits.items()
        }
        at_points.append({"n_points": n, **cost, **figures})
        network.cpu()
    return {
        "network": config.network,
        "classes": training.classes,
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "n_clouds": {"train": len(training)} | {name: len(clouds) for name, clouds in splits.items()},
        "best": state.best,
        "at_points": at_points,
        "curves": state.history,
        "precision": state.precision.as_dict(),
        "training_s": round(state.seconds, 2),
        "device": str(device),
        "threads": config.threads,
        "seed": config.seed,
        "checkpoint": str(best),
        "config": config.decisive(),
    }
