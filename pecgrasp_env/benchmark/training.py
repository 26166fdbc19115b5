"""How soon the published training is done, beside the multiply-adds that it cannot do without."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.benchmark.timing import Row, Timing, limited, rows_of, side_by_side
from pecgrasp_env.objects import LARS_CLASSES

# The published job: 10,000 clouds of the LARS set, three quarters of them to train on, as one batch.
_TRAINING, _EVALUATED, _EPOCHS = 7500, 2500, 150
_POINTS, _RAW_POINTS = 64, 200
_YARDSTICK, _OWN_SIZES = "its multiply-adds alone", "at the layers' own sizes"
_PRODUCT = (8192, 512, 512)


def training(settings: Mapping[str, Any]) -> list[Row]:
    """One epoch of the published job on random clouds: a step on all of them, evaluation, both checkpoints.

    What a run of settings["training_epochs"] + 1 epochs takes longer than a run of one, preprocessing and the final
    report aside. The yardstick is the step's multiply-adds, three times a forward's, in float32 as products of large
    matrices, which is as fast as this machine multiplies; a row says what they take as products of the layers' own
    sizes. Second where precision=auto takes bfloat16 is a run in it.
    """
    threads, epochs = settings["training_threads"], settings["training_epochs"]
    with tempfile.TemporaryDirectory() as folder:
        data = _clouds(Path(folder) / "clouds.npz", settings["seed"])
        times = _products(threads, settings.get("training_repeats", 1))
        for precision in ("float32", "auto"):
            short, used = _run(data, precision, threads, 1)
            if used in times:
                continue  # what auto means here has been measured
            long, _ = _run(data, precision, threads, 1 + epochs)
            times[used] = Timing((long.wall - short.wall) / epochs, (long.cpu - short.cpu) / epochs)
    rows = rows_of(times, _YARDSTICK, f"an epoch of {_TRAINING:,} clouds, {threads} threads")
    for place, row in enumerate(rows[2:], start=2):
        rows[place] = limited(row, settings.get("train_at_most"))
        rows[place]["extrapolated_s"] = _EPOCHS * row["wall_ms"] / 1000
    return rows


def _clouds(path: Path, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    arrays: dict[str, np.ndarray] = {"class_names": np.array(LARS_CLASSES)}
    for part, n in (("train", _TRAINING), ("test", _EVALUATED)):
        labels = np.arange(n) % len(LARS_CLASSES)
        shapes = rng.uniform(0.01, 0.06, (len(LARS_CLASSES), 1, 3))[labels]
        arrays[f"{part}_points"] = (rng.normal(size=(n, _RAW_POINTS, 3)) * shapes).astype(np.float32)
        arrays[f"{part}_labels"] = labels
    np.savez(path, allow_pickle=False, **arrays)
    return path


def _run(data: Path, precision: str, threads: int, epochs: int) -> tuple[Timing, str]:
    """Of a whole run, and the precision of its products."""
    from pec.training.loop import train

    published = {"selection": "evaluation split", "batch_size": None, "learning_rate": 0.01, "schedule": "constant"}
    published |= {"weight_decay": 0.0, "label_smoothing": 0.0, "running_statistics": "torch"}
    begin, cpu = time.perf_counter(), time.process_time()
    results = train(
        {
            "dataset": {"path": str(data), "split": "official"},
            "output": str(data.with_name(f"{precision}_{epochs}")),
            "preprocess": {"ordering": "groups", "group_size": 16},
            "protocol": published | {"epochs": epochs, "precision": precision},
            "augment": {"remove": 0.0},
            "threads": threads,
            "device": "cpu",
            "cache": str(data.with_name("cache")),
            "progress": False,
        }
    )
    return Timing(time.perf_counter() - begin, time.process_time() - cpu), results["precision"]["used"]


def _products(threads: int, repeats: int) -> dict[str, Timing]:
    """The multiply-adds of a step on all clouds, as products of large matrices and as the layers' own."""
    import torch

    from pec.common.threads import torch_threads
    from pec.networks.registry import build_model
    from pec.training.costs import multiply_adds

    model = build_model("pec", _POINTS, len(LARS_CLASSES)).eval()
    needed = 3 * _TRAINING * multiply_adds(model, _POINTS)
    large = [_PRODUCT] * round(needed / np.prod(_PRODUCT))
    own = []
    for m, k, n in _shapes(model, torch.zeros(2, _POINTS, 3)):
        m *= _TRAINING // 2
        own += [(m, k, n), (m, n, k), (k, m, n)]  # the outputs, the gradients of the inputs and of the weights
    with torch_threads(threads):
        return side_by_side({_YARDSTICK: _multiplier(large), _OWN_SIZES: _multiplier(own)}, repeats)


def _multiplier(shapes: list[tuple[int, int, int]]) -> Callable[[], None]:
    """Makes products (m, k) @ (k, n), with nothing else to do."""
    import torch

    sizes = {size for m, k, n in shapes for size in ((m, k), (k, n), (m, n))}
    matrices, results = ({size: torch.ones(size) for size in sizes} for _ in range(2))

    def run() -> None:
        for m, k, n in shapes:
            torch.mm(matrices[m, k], matrices[k, n], out=results[m, n])

    return run


def _shapes(model: Any, points: Any) -> list[tuple[int, int, int]]:
    """(m, k, n) of every product in a forward of `points`."""
    import torch
    from torch.utils._python_dispatch import TorchDispatchMode

    found: list[tuple[int, int, int]] = []

    class Listener(TorchDispatchMode):
        def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
            if func.overloadpacket in (torch.ops.aten.mm, torch.ops.aten.addmm):
                one, other = args[-2:]
                found.append((*one.shape, other.shape[1]))
            return func(*args, **(kwargs or {}))

    with torch.no_grad(), Listener():
        model(points)
    return found
