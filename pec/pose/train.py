"""Training of the pose network: from settings to checkpoints, curves and figures; killed and started again, it goes on.

On a CPU with the same number of threads an interrupted run ends in the same weights, bit for bit.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch.utils.tensorboard import SummaryWriter

from pec.common.atomic_files import write_json
from pec.common.devices import device_named
from pec.common.threads import torch_threads
from pec.errors import ConfigError
from pec.pose.checkpoint import read_pose_checkpoint
from pec.pose.clouds import PosedClouds, load_posed_clouds
from pec.pose.config import PoseTrainConfig, read_pose_config
from pec.pose.distance import PoseDistance
from pec.pose.epoch import run_epoch
from pec.pose.evaluation import evaluate, proposal_figures
from pec.pose.models import PoseModels, read_models
from pec.pose.network import PoseNetwork
from pec.pose.run_state import pose_run, pose_state
from pec.training.epoch_bar import epoch_bar
from pec.training.epoch_state import EpochState

__all__ = ["train_pose"]


@dataclass(frozen=True)
class _Data:
    models: PoseModels
    distance: PoseDistance
    training: PosedClouds
    validation: PosedClouds
    test: PosedClouds | None
    version: str


def train_pose(cfg: Mapping[str, Any]) -> dict[str, Any]:
    """Train as `cfg` says (see `pec.pose.config.PoseTrainConfig`).

    Returns what is also written to OUTPUT/results.json. OUTPUT/best and OUTPUT/last are checkpoints, OUTPUT/tensorboard
    the curves. A finished run is not repeated, an interrupted one goes on.
    Raises ConfigError, DatasetError, ModelsError, CheckpointError, or TrainingError where the loss is not finite.
    """
    config = read_pose_config(cfg)
    device = device_named(config.device)
    with torch_threads(config.threads):
        data = _load(config, read_models(config.models), device)
        run = pose_run(config, data.version)
        if (done := run.results()) is not None:
            return done
        state = pose_state(config, run, data.models, device)
        _fit(config, state, data)
        results = _results(config, state, data, device)
    write_json(Path(config.output) / "results.json", results)
    return results


def _load(config: PoseTrainConfig, models: PoseModels, device: torch.device) -> _Data:
    settings, n_points = config.dataset, config.network.n_points
    clouds = load_posed_clouds(settings.path, models, n_points).to(device)
    test = None if settings.test is None else load_posed_clouds(settings.test, models, n_points).to(device)
    order = torch.randperm(len(clouds), generator=torch.Generator().manual_seed(config.seed)).to(device)
    n_validation = max(1, round(settings.validation_fraction * len(clouds)))
    if len(clouds) - n_validation < 2:
        raise ConfigError(f"dataset.path {settings.path} has only {len(clouds)} clouds: too few to train on")
    version = f"{clouds.version} {models.version} {test.version if test else ''}"
    return _Data(
        models,
        PoseDistance.of(models, device),
        clouds.subset(order[n_validation:]),
        clouds.subset(order[:n_validation]),
        test,
        version,
    )


def _fit(config: PoseTrainConfig, state: EpochState[PoseNetwork], data: _Data) -> None:
    """Train up to the configured epoch, saving after each."""
    epochs = config.protocol.epochs
    # What an interrupted run wrote after its last saved epoch is hidden.
    writer = SummaryWriter(str(Path(config.output) / "tensorboard"), purge_step=state.epoch + 1)
    bar = epoch_bar(state.epoch, epochs, shown=config.progress)
    with writer, bar:
        for epoch in bar:
            begin = time.perf_counter()
            loss, rate = run_epoch(config, state.network, state.optimizer, data.distance, data.training, epoch)
            validation = proposal_figures(state.network, data.distance, data.validation)
            values = (loss, validation["likeliest"], validation["nearest"], rate)
            state.finish_epoch(values, validation["likeliest"], time.perf_counter() - begin)
            for name, curve in state.history.items():
                writer.add_scalar(name.replace("_", "/", 1), curve[-1], epoch + 1)
            bar.set_postfix(loss=f"{loss:.3f}", **{name: f"{value:.3f}" for name, value in validation.items()})


def _results(
    config: PoseTrainConfig, state: EpochState[PoseNetwork], data: _Data, device: torch.device
) -> dict[str, Any]:
    """What the run was, and the figures of its best checkpoint."""
    best = Path(config.output) / "best"
    network = read_pose_checkpoint(best).network.to(device)
    splits = {"validation": data.validation} | ({"test": data.test} if data.test else {})
    return {
        "models": list(data.models.names),
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "n_samples": {"train": len(data.training)} | {name: len(clouds) for name, clouds in splits.items()},
        "best": state.best,
        **{name: evaluate(network, data.distance, data.models, clouds) for name, clouds in splits.items()},
        "curves": state.history,
        "training_s": round(state.seconds, 2),
        "device": str(device),
        "threads": config.threads,
        "seed": config.seed,
        "checkpoint": str(best),
        "config": config.decisive(),
        "data": data.version,
    }
