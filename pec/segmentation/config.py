"""The settings of a training that gives every point a class; an unknown or senseless one is an error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pec.common.settings import one_of, positive, settings_as
from pec.data.augment import Augment
from pec.errors import ConfigError
from pec.networks.segmentation import SEGMENTATION

__all__ = ["PointProtocol", "PointTrainConfig", "read_point_config"]

_MOVES = ("yaw", "mirror", "jitter", "scale", "stretch")  # all others leave points out


@dataclass(frozen=True)
class PointProtocol:
    """Adam with weight decay, a one-cycle learning rate, cross-entropy over all points. precision: of the products in
    training, as `pec.training.config.ProtocolConfig` has it."""

    epochs: int = 20
    batch_size: int = 16
    learning_rate: float = 0.002
    weight_decay: float = 0.01
    precision: str = "auto"


@dataclass(frozen=True)
class PointTrainConfig:
    """Everything that decides the weights, and where they go.

    clouds, test: files as `pec.segmentation.clouds` writes them; test None: figures of validation only. network: of
    `pec.networks.segmentation`. n_points: of a cloud, in training. also_at: another number of points that figures are
    given at; None: no other.
    """

    clouds: str
    output: str
    test: str | None = None
    network: str = "pec"
    n_points: int = 1024
    also_at: int | None = None
    protocol: PointProtocol = field(default_factory=PointProtocol)
    augment: Augment = field(default_factory=lambda: Augment(yaw=180.0, mirror=0.5, jitter=0.001))
    seed: int = 0
    threads: int = 1
    device: str = "auto"
    progress: bool = True

    def decisive(self) -> dict[str, Any]:
        """The settings that decide the result: what must be equal for a run to go on."""
        settings = asdict(self)
        for name in ("clouds", "test", "output", "threads", "device", "progress"):
            del settings[name]
        return settings


def read_point_config(settings: Mapping[str, Any]) -> PointTrainConfig:
    """A checked PointTrainConfig. Raises ConfigError that names the setting and its value."""
    config = settings_as(PointTrainConfig, settings)
    protocol = config.protocol
    one_of("device", config.device, ("auto", "cpu", "cuda"))
    one_of("network", config.network, tuple(SEGMENTATION))
    one_of("protocol.precision", protocol.precision, ("auto", "float32", "bfloat16"))
    positive(protocol__epochs=protocol.epochs, protocol__learning_rate=protocol.learning_rate, threads=config.threads)
    if protocol.batch_size < 2:
        raise ConfigError(f"protocol.batch_size must be 2 at least, got {protocol.batch_size}: batch norm needs two")
    if protocol.weight_decay < 0:
        raise ConfigError(f"protocol.weight_decay must not be negative, got {protocol.weight_decay}")
    for name, number in (("n_points", config.n_points), ("also_at", config.also_at)):
        if number is not None and (number < 256 or number % 64):
            raise ConfigError(f"{name} must be a multiple of 64, 256 at least, got {number}")
    if config.network == "pec_whole" and config.also_at is not None:
        raise ConfigError(f"also_at={config.also_at}: network=pec_whole takes no other number of points than n_points")
    for name, strength in asdict(config.augment).items():
        if name not in _MOVES and strength != getattr(Augment(), name):
            raise ConfigError(
                f"augment.{name} must be {getattr(Augment(), name)} here: points that are left out have no class"
            )
    return config
