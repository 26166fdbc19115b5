"""The settings of a training run of a network for grasps; an unknown or senseless one is an error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pec.common.settings import one_of, positive, settings_as
from pec.errors import ConfigError
from pec.grasps.network import NetworkConfig

__all__ = ["GraspAugment", "GraspDataConfig", "GraspProtocol", "GraspTrainConfig", "read_grasp_config"]


@dataclass(frozen=True)
class GraspDataConfig:
    """path: a directory of grasp labels. train_fraction: share of each class's instances that are trained on; of the
    others half choose the epoch, half are the test. passed_over: outcomes that are left out of it all: of grasps that a
    planner refuses by geometry alone."""

    path: str
    train_fraction: float = 0.7
    passed_over: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class GraspProtocol:
    """Adam with weight decay, a warm cosine of the learning rate."""

    epochs: int = 10
    batch_size: int = 64
    learning_rate: float = 0.002
    weight_decay: float = 0.01


@dataclass(frozen=True)
class GraspAugment:
    """What each draw does to a cloud with its grasp. jitter: standard deviation of the points, m. yaw: whether both are
    turned about the vertical."""

    jitter: float = 0.001
    yaw: bool = True


@dataclass(frozen=True)
class GraspTrainConfig:
    """Everything that decides the weights, and where they go."""

    dataset: GraspDataConfig
    output: str
    network: NetworkConfig = field(default_factory=NetworkConfig)
    protocol: GraspProtocol = field(default_factory=GraspProtocol)
    augment: GraspAugment = field(default_factory=GraspAugment)
    seed: int = 0
    threads: int = 1
    device: str = "auto"
    progress: bool = True

    def decisive(self) -> dict[str, Any]:
        """The settings that decide the result: what must be equal for a run to go on."""
        settings = asdict(self)
        for name in ("output", "threads", "device", "progress"):
            del settings[name]
        del settings["dataset"]["path"]  # wherever the labels lie
        return settings


def read_grasp_config(settings: Mapping[str, Any]) -> GraspTrainConfig:
    """A checked GraspTrainConfig. Raises ConfigError that names the setting and its value."""
    config = settings_as(GraspTrainConfig, settings)
    one_of("device", config.device, ("auto", "cpu", "cuda"))
    protocol = config.protocol
    positive(protocol__epochs=protocol.epochs, protocol__learning_rate=protocol.learning_rate, threads=config.threads)
    if protocol.batch_size < 2:
        raise ConfigError(f"protocol.batch_size must be 2 at least, got {protocol.batch_size}: batch norm needs two")
    for name, amount in (("protocol.weight_decay", protocol.weight_decay), ("augment.jitter", config.augment.jitter)):
        if amount < 0:
            raise ConfigError(f"{name} must not be negative, got {amount}")
    if not 0 < config.dataset.train_fraction < 1:
        raise ConfigError(f"dataset.train_fraction must be between 0 and 1, got {config.dataset.train_fraction}")
    return config
