"""The settings of a training run of the pose network; an unknown or senseless one is an error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pec.common.settings import one_of, positive, settings_as
from pec.data.augment import Augment
from pec.errors import ConfigError
from pec.pose.network import NetworkConfig

__all__ = ["PoseDataConfig", "PoseProtocol", "PoseTrainConfig", "read_pose_config"]


@dataclass(frozen=True)
class PoseDataConfig:
    """path: a generated data set's directory. test: another, of other seeds, whose figures are given besides; None:
    those of validation only. validation_fraction: share of the clouds that the epoch is chosen on."""

    path: str
    test: str | None = None
    validation_fraction: float = 0.1


@dataclass(frozen=True)
class PoseProtocol:
    """Adam with weight decay, a one-cycle learning rate. spread: share of the loss that is the mean over all hypotheses
    and not the nearest's alone, so that none is left without a gradient. confidence: weight of the loss of telling
    how far off each one is."""

    epochs: int = 60
    batch_size: int = 64
    learning_rate: float = 0.002
    weight_decay: float = 0.01
    spread: float = 0.05
    confidence: float = 0.3


@dataclass(frozen=True)
class PoseTrainConfig:
    """Everything that decides the weights, and where they go. models: a file as `pec.pose.models` writes it."""

    dataset: PoseDataConfig
    models: str
    output: str
    network: NetworkConfig = field(default_factory=NetworkConfig)
    protocol: PoseProtocol = field(default_factory=PoseProtocol)
    augment: Augment = field(default_factory=lambda: Augment(remove=0.3, crop=0.1, jitter=0.001))
    seed: int = 0
    threads: int = 1
    device: str = "auto"
    progress: bool = True

    def decisive(self) -> dict[str, Any]:
        """The settings that decide the result: what must be equal for a run to go on."""
        settings = asdict(self)
        for name in ("models", "output", "threads", "device", "progress"):
            del settings[name]
        settings["dataset"] = {"validation_fraction": self.dataset.validation_fraction}  # wherever the data lie
        return settings


def read_pose_config(settings: Mapping[str, Any]) -> PoseTrainConfig:
    """A checked PoseTrainConfig. Raises ConfigError that names the setting and its value."""
    config = settings_as(PoseTrainConfig, settings)
    protocol = config.protocol
    one_of("device", config.device, ("auto", "cpu", "cuda"))
    positive(protocol__epochs=protocol.epochs, protocol__learning_rate=protocol.learning_rate, threads=config.threads)
    if protocol.batch_size < 2:
        raise ConfigError(f"protocol.batch_size must be 2 at least, got {protocol.batch_size}: batch norm needs two")
    if not 0 < config.dataset.validation_fraction < 1:
        raise ConfigError(
            f"dataset.validation_fraction must be between 0 and 1, got {config.dataset.validation_fraction}"
        )
    if not 0 <= protocol.spread < 1:
        raise ConfigError(f"protocol.spread must be in [0, 1), got {protocol.spread}")
    for name in ("weight_decay", "confidence"):
        if getattr(protocol, name) < 0:
            raise ConfigError(f"protocol.{name} must not be negative, got {getattr(protocol, name)}")
    for name in ("scale", "stretch", "yaw", "mirror"):
        if getattr(config.augment, name):
            raise ConfigError(f"augment.{name} must be 0 here: what it does to a cloud, no pose of its model does")
    return config
