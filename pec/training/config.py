"""The settings of a training run, from a Hydra config or any mapping; an unknown or senseless one is an error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pec.common.settings import one_of, settings_as
from pec.data.augment import Augment
from pec.data.loading import SIZES
from pec.errors import ConfigError
from pec.networks.registry import check_model
from pec.preprocessing.preprocess import Preprocess

__all__ = ["DatasetConfig", "ModelConfig", "ProtocolConfig", "TrainConfig", "read_config"]


@dataclass(frozen=True)
class DatasetConfig:
    """path: a generated data set's directory or a ModelNet .npz. classes: None for all. split: "sample", "instance" or
    "official". train_fraction: share of train and validation together. removed: greatest fraction that the published
    defect takes from every cloud, test ones too. size: of clouds that were scaled to one size, as ModelNet's: as they
    are "stored", or of the "mesh" (`pec.data.dataset.CloudDataset.in_mesh_size`). calibration_fraction: share of each
    class's instances that training does not see, where the split lets it see all: on them the threshold of the unknown
    is set (`pec.training.run_split.hold_out_instances`). 0, and in the published protocol: none."""

    path: str
    classes: list[str] | None = None
    split: str = "sample"
    train_fraction: float = 0.75
    validation_fraction: float = 0.1
    calibration_fraction: float = 0.15
    samples_per_instance: int | None = None
    removed: float = 0.0
    size: str = "stored"


@dataclass(frozen=True)
class ModelConfig:
    """name: of `pec.networks.registry.MODELS`, or "module.Class" of an importable network of one's own."""

    name: str = "pec"


@dataclass(frozen=True)
class ProtocolConfig:
    """selection: "validation" (honest: the epoch is chosen on a part cut from train, test is read once at the end) or
    "evaluation split" (published: the best epoch on the split that is also reported). batch_size None: full batch.
    initial_weights: torch's "default", or "scaled" to the data (`pec.networks.initialise`). running_statistics: of
    batch norm, as "torch" has them (published), or "corrected" for what they start as
    (`pec.training.running_statistics`). precision: of the products in training, "float32", "bfloat16"
    (torch.autocast), or "auto": bfloat16 where it is clearly faster when the run begins; weights keep float32. A run is
    the same whatever "auto" came to, and goes on as it began. logit_adjustment: how far training makes up for classes
    of unequal number, 0 not at all, 1 as if all were as many: the loss sees the logits plus that many times the log of
    the class's share (Menon et al., ICLR 2021). made_strangers: how many strangers there are to be in training,
    times the clouds of the known classes: where fewer are given, others are made of the known clouds
    (`pec.data.made_strangers`); with any the network has one output more, "none of these". surface_forms: whether a
    second witness, which reads the forms of a cloud's surface, is fitted in the end (`pec.known.form_witness`)."""

    selection: str = "validation"
    epochs: int = 60
    batch_size: int | None = 128
    learning_rate: float = 0.002
    initial_weights: str = "default"
    schedule: str = "one_cycle"
    weight_decay: float = 0.01
    label_smoothing: float = 0.1
    running_statistics: str = "corrected"
    precision: str = "auto"
    logit_adjustment: float = 0.0
    made_strangers: float = 0.5
    surface_forms: bool = True


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides the weights, and where they go."""

    dataset: DatasetConfig
    output: str
    preprocess: Preprocess = field(
        default_factory=lambda: Preprocess(
            n_points=64, n_candidates=128, start="farthest", pose="principal", ordering="anchors"
        )
    )
    model: ModelConfig = field(default_factory=ModelConfig)
    protocol: ProtocolConfig = field(default_factory=ProtocolConfig)
    augment: Augment = field(default_factory=lambda: Augment(remove=0.4, crop=0.2, jitter=0.001, scale=0.05))
    seed: int = 0
    threads: int = 1
    device: str = "auto"
    cache: str | None = None
    progress: bool = True

    def decisive(self) -> dict[str, Any]:
        """The settings that decide the result: what must be equal for a run to go on."""
        settings = asdict(self)
        for name in ("output", "threads", "device", "cache", "progress"):
            del settings[name]
        return settings


def read_config(settings: Mapping[str, Any]) -> TrainConfig:
    """A checked TrainConfig. Raises ConfigError that names the setting and its value."""
    config = settings_as(TrainConfig, settings)
    protocol, dataset = config.protocol, config.dataset
    one_of("protocol.selection", protocol.selection, ("validation", "evaluation split"))
    one_of("protocol.schedule", protocol.schedule, ("constant", "one_cycle"))
    one_of("protocol.initial_weights", protocol.initial_weights, ("default", "scaled"))
    one_of("protocol.running_statistics", protocol.running_statistics, ("torch", "corrected"))
    one_of("protocol.precision", protocol.precision, ("auto", "float32", "bfloat16"))
    one_of("dataset.split", dataset.split, ("sample", "instance", "official"))
    one_of("dataset.size", dataset.size, SIZES)
    check_model(config.model.name)
    one_of("device", config.device, ("auto", "cpu", "cuda"))
    for name, value in (
        ("protocol.epochs", protocol.epochs),
        ("protocol.batch_size", protocol.batch_size),
        ("protocol.learning_rate", protocol.learning_rate),
        ("dataset.samples_per_instance", dataset.samples_per_instance),
        ("threads", config.threads),
    ):
        if value is not None and value <= 0:
            raise ConfigError(f"{name} must be positive, got {value}")
    for name, share in (
        ("dataset.train_fraction", dataset.train_fraction),
        ("dataset.validation_fraction", dataset.validation_fraction),
    ):
        if not 0 < share < 1:
            raise ConfigError(f"{name} must be between 0 and 1, got {share}")
    if protocol.batch_size == 1:
        raise ConfigError("protocol.batch_size must be 2 at least, got 1: batch norm has no variance of one cloud")
    if protocol.logit_adjustment < 0:
        raise ConfigError(f"protocol.logit_adjustment must not be negative, got {protocol.logit_adjustment}")
    if protocol.made_strangers < 0:
        raise ConfigError(f"protocol.made_strangers must not be negative, got {protocol.made_strangers}")
    if not 0 <= dataset.calibration_fraction < 1:
        raise ConfigError(f"dataset.calibration_fraction must be in [0, 1), got {dataset.calibration_fraction}")
    if not 0 <= dataset.removed < 1:
        raise ConfigError(f"dataset.removed must be in [0, 1), got {dataset.removed}")
    return config
