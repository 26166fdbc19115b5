"""From grasp labels to a network that judges or proposes grasps; killed and started again, it goes on.

On a CPU with the same number of threads an interrupted run ends in the same weights, bit for bit.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter

from pec.common.atomic_files import write_json
from pec.common.devices import device_named
from pec.common.threads import torch_threads
from pec.grasps.checkpoint import read_grasp_checkpoint
from pec.grasps.network import GraspNetwork, build_network, multiply_adds
from pec.grasps.networks.graspnet_sampler import GraspNetSampler
from pec.grasps.training.config import GraspTrainConfig, read_grasp_config
from pec.grasps.training.data import GraspTensors, Splits, load_splits
from pec.grasps.training.figures import ranking_figures
from pec.grasps.training.run_state import grasp_run, grasp_state
from pec.grasps.training.sampled_grasps import coverage
from pec.grasps.views import GraspViews
from pec.training.epoch_bar import epoch_bar
from pec.training.epoch_state import EpochState
from pec.training.schedule import warm_cosine
from pec.training.step import take_step

__all__ = ["train_grasps"]

_TOGETHER = 256  # grasps that are only judged: bounds memory, changes no result


def train_grasps(cfg: Mapping[str, Any]) -> dict[str, Any]:
    """Train as `cfg` says (see `pec.grasps.training.config.GraspTrainConfig`).

    Returns what is also written to OUTPUT/results.json. OUTPUT/best and OUTPUT/last are checkpoints, OUTPUT/tensorboard
    the curves. A finished run is not repeated, an interrupted one goes on.
    Raises ConfigError, DatasetError, CheckpointError, or TrainingError where the loss is not finite.
    """
    config = read_grasp_config(cfg)
    device = device_named(config.device)
    with torch_threads(config.threads):
        normals = build_network(config.network).uses_normals
        data = load_splits(config.dataset, config.network, normals, config.seed).to(device)
        run = grasp_run(config, data.version)
        if (done := run.results()) is not None:
            return done
        state = grasp_state(config, run, device)
        _fit(config, state, data)
        results = _results(config, state, data, device)
    write_json(Path(config.output) / "results.json", results)
    return results


def _fit(config: GraspTrainConfig, state: EpochState[GraspNetwork], data: Splits) -> None:
    """Train up to the configured epoch, saving after each."""
    training, validation = data.training, data.validation
    if isinstance(state.network, GraspNetSampler):  # learns what holds, from nothing else
        training, validation = training.only(training.held), validation.only(validation.held)
    epochs = config.protocol.epochs
    # What an interrupted run wrote after its last saved epoch is hidden.
    writer = SummaryWriter(str(Path(config.output) / "tensorboard"), purge_step=state.epoch + 1)
    bar = epoch_bar(state.epoch, epochs, shown=config.progress)
    with writer, bar:
        for epoch in bar:
            begin = time.perf_counter()
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(config.seed * 1_000_003 + epoch)
                loss, rate = _run_epoch(config, state, training)
                torch.manual_seed(config.seed)
                validated = _mean_loss(state.network, validation)
            state.finish_epoch((loss, validated, rate), validated, time.perf_counter() - begin)
            for name, curve in state.history.items():
                writer.add_scalar(name.replace("_", "/", 1), curve[-1], epoch + 1)
            bar.set_postfix(loss=f"{loss:.3f}", validation=f"{validated:.3f}")


def _run_epoch(
    config: GraspTrainConfig, state: EpochState[GraspNetwork], training: GraspTensors
) -> tuple[float, float]:
    """One pass; the mean loss and the last learning rate. Raises TrainingError where the loss is not finite."""
    protocol, network, optimizer = config.protocol, state.network, state.optimizer
    n_steps = max(1, len(training) // protocol.batch_size)
    order = torch.randperm(len(training)).to(training.held.device)
    total, rate = 0.0, protocol.learning_rate
    network.train()
    for step, index in enumerate(order.tensor_split(n_steps)):
        rate = warm_cosine(protocol.learning_rate, (state.epoch * n_steps + step) / (protocol.epochs * n_steps))
        loss = _loss(network, training.drawn_views(index, config.augment), training.held[index])
        total += take_step(optimizer, loss, rate, state.epoch) * len(index)
    return total / len(training), rate


def _loss(network: GraspNetwork, views: GraspViews, held: torch.Tensor) -> torch.Tensor:
    if isinstance(network, GraspNetSampler):
        return network.loss(views)
    return torch.nn.functional.binary_cross_entropy_with_logits(network(views), held.float())


@torch.no_grad()
def _mean_loss(network: GraspNetwork, grasps: GraspTensors) -> float:
    network.eval()
    parts = torch.arange(len(grasps), device=grasps.held.device).split(_TOGETHER)
    losses = [_loss(network, grasps.views(index), grasps.held[index]).item() * len(index) for index in parts]
    return sum(losses) / len(grasps)


@torch.no_grad()
def _figures(network: GraspNetwork, grasps: GraspTensors, samplers: tuple[str, ...]) -> dict[str, Any]:
    """Of an evaluator `ranking_figures` of "all" grasps and of each sampler's; of a sampler `coverage`."""
    network.eval()
    if isinstance(network, GraspNetSampler):
        return coverage(network, grasps)
    parts = torch.arange(len(grasps), device=grasps.held.device).split(_TOGETHER)
    scores = torch.cat([network(grasps.views(index)) for index in parts]).double().cpu().numpy()
    held, scene_of = grasps.held.cpu().numpy(), grasps.scene_of.cpu().numpy()
    rows = {"all": ranking_figures(scores, held, scene_of)}
    drawn_by = grasps.sampler.cpu().numpy()
    for code, name in enumerate(samplers):
        if np.any(mine := drawn_by == code):
            rows[name] = ranking_figures(scores[mine], held[mine], scene_of[mine])
    return rows


def _results(
    config: GraspTrainConfig, state: EpochState[GraspNetwork], data: Splits, device: torch.device
) -> dict[str, Any]:
    """What the run was, and the figures of its best checkpoint."""
    best = Path(config.output) / "best"
    network = read_grasp_checkpoint(best).network
    counted = multiply_adds(network, config.network)
    network.to(device)
    parts = {"training": data.training, "validation": data.validation, "test": data.test}
    return {
        "network": config.network.name,
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "multiply_adds": counted,
        "data_sizes": {
            name: {"instances": len(set(part.instances)), "scenes": len(part.instances), "grasps": len(part)}
            for name, part in parts.items()
        },
        "best": state.best,
        "validation": _figures(network, data.validation, data.samplers),
        "test": _figures(network, data.test, data.samplers),
        "curves": state.history,
        "training_s": round(state.seconds, 2),
        "device": str(device),
        "threads": config.threads,
        "seed": config.seed,
        "checkpoint": str(best),
        "config": config.decisive(),
        "data": data.version,
    }
