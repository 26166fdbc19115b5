"""In what precision the products of training are made: as asked, or as this machine's own speed says.

bfloat16 is several times as fast as float32 on GPUs and on processors with instructions for it, and two hundred times
as slow on others. What a machine has cannot be read off its name, so a few steps are timed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

__all__ = ["LEAST_SPEEDUP", "Precision", "choose_precision"]

LEAST_SPEEDUP = 1.15  # what bfloat16 must gain to be taken: less than that is noise, and costs digits

_HOPELESS = 3.0  # times as slow in a small product: not tried on the network, where it would take minutes
_PRODUCT = 128
_TURNS, _FEWEST, _ENOUGH_S = 5, 2, 2.0


@dataclass(frozen=True)
class Precision:
    """asked: of the setting. used: "float32" or "bfloat16". bfloat16_speedup: how many times as fast a step was in
    bfloat16 as in float32 when the run began (a small product, where that was three times as slow); None where nothing
    was measured."""

    asked: str
    used: str
    bfloat16_speedup: float | None = None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def choose_precision(step: Callable[[str], object], device: torch.device) -> Precision:
    """What `precision=auto` means on this machine, as busy as it is: bfloat16 only where it is clearly faster.

    step: makes one step of training in the precision that it is given, and leaves nothing behind.
    """
    product = torch.ones(_PRODUCT, _PRODUCT, device=device)
    halved = product.bfloat16()
    products = {"float32": lambda: product @ product, "bfloat16": lambda: halved @ halved}
    speedup = _speedup(lambda name: products[name](), device)
    if speedup * _HOPELESS > 1:
        speedup = _speedup(step, device)
    return Precision("auto", "bfloat16" if speedup > LEAST_SPEEDUP else "float32", float(f"{speedup:.3g}"))


def _speedup(run: Callable[[str], object], device: torch.device) -> float:
    """How many times as fast `run` is in bfloat16 as in float32: by medians of a few turns after one of each."""
    seconds: dict[str, list[float]] = {"float32": [], "bfloat16": []}
    begin = time.perf_counter()
    for turn in range(_TURNS + 1):
        if turn > _FEWEST and time.perf_counter() - begin > _ENOUGH_S:
            break
        for name, taken in seconds.items():
            before = _now(device)
            run(name)
            if turn:
                taken.append(_now(device) - before)
    return float(np.median(seconds["float32"]) / np.median(seconds["bfloat16"]))


def _now(device: torch.device) -> float:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()
