"""What a classifier costs: parameters, multiply-adds, and the time of one cloud on one CPU thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from pec.checkpoint import Checkpoint
from pec.classifier import Classifier
from pec.common.threads import torch_threads
from pec.networks.registry import fast_forward

__all__ = ["Costs", "counted_multiply_adds", "measure_costs", "median_ms", "multiply_adds"]

RAW_POINTS = 2000  # of the cloud that is classified: a mug-sized object half a metre from a D435

_REPEATS = 30


@dataclass(frozen=True)
class Costs:
    """Of one cloud in one pose. network_ms: the forward alone. raw_cloud_ms: from a raw cloud of RAW_POINTS points to
    class and confidence, over all poses that the preprocessing asks for. Both medians, on one CPU thread."""

    parameters: int
    multiply_adds: int
    network_ms: float
    raw_cloud_ms: float

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


def measure_costs(checkpoint: Checkpoint) -> Costs:
    """The costs of a checkpoint on this machine, as busy as it is."""
    model = checkpoint.model.cpu().eval()
    classifier = Classifier(checkpoint)
    cloud = np.random.default_rng(0).normal(scale=0.04, size=(RAW_POINTS, 3)).astype(np.float32)
    points = torch.from_numpy(cloud[None, : checkpoint.preprocess.n_points])
    forward = fast_forward(model)
    with torch_threads(1), torch.no_grad():
        network_ms = median_ms(lambda: forward(points))
        raw_cloud_ms = median_ms(lambda: classifier.predict(cloud))
    return Costs(
        sum(parameter.numel() for parameter in model.parameters()),
        multiply_adds(model, checkpoint.preprocess.n_points),
        network_ms,
        raw_cloud_ms,
    )


def multiply_adds(model: nn.Module, n_points: int) -> int:
    """Of one cloud, in matrix products and convolutions; additions, norms, activations and sorting are not counted."""
    was_training = model.training
    model.eval()
    points = torch.randn(1, n_points, 3, generator=torch.Generator().manual_seed(0))
    counted = counted_multiply_adds(lambda: model(points))
    model.train(was_training)
    return counted


def counted_multiply_adds(call: Callable[[], object]) -> int:
    """Of whatever is called, as `multiply_adds` counts them."""
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        call()
    return counter.get_total_flops() // 2


def median_ms(call: Callable[[], object]) -> float:
    """Milliseconds of a call, the median of 30 after 3."""
    for _ in range(3):
        call()
    times = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return round(1e3 * float(np.median(times)), 4)
