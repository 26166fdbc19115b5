"""How soon a raw cloud has a class and a confidence, by ours and the rivals, and how soon the published job is done."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pecgrasp_env.benchmark.timing import Row, Timing, rows_of, side_by_side
from pecgrasp_env.objects import LARS_CLASSES, make_object

_POINTS = 64  # that every classifier takes
_SCENE = 6  # clouds of one scene
_KNOWN = 1000  # clouds that k-nearest-neighbour knows; its time grows with them

# The published job: 10,000 clouds of the LARS set, three quarters of them to train on, as one batch.
_TRAINING, _EVALUATED, _EPOCHS = 7500, 2500, 150
_ONE_PRODUCT = "its multiply-adds alone"
_PRODUCT_SIZE = 512
_RAW_POINTS = 200


def classification(settings: Mapping[str, Any]) -> list[Row]:
    """From one raw cloud to class and confidence on one thread, beside a k-d tree of the same cloud.

    default, published: PEC by the default and by the published preprocessing; upright: ModelNet10's, four views. Then
    the rivals on as many points, in the order of farthest point sampling. Last, ours on all clouds of a scene at once.
    """
    targets = {int(n): float(most) for n, most in settings.get("classify_at_most_ms", {}).items()}
    ours, rivals = _classifiers(settings["seed"])
    mesh = make_object("stapler", settings["seed"]).visual_mesh()
    rows = []
    for n in settings["classified_sizes"]:
        points = np.asarray(mesh.sample(n, seed=settings["seed"]), np.float32)
        routines: dict[str, Callable[[], Any]] = {"k-d tree": partial(cKDTree, points)}
        for name, classifier in (ours | rivals).items():
            routines[name] = partial(classifier.predict, points)
        of_size = rows_of(
            side_by_side(routines, settings["repeats"], warm=True), "k-d tree", f"{n:,} points, {_POINTS} taken"
        )
        for row in of_size:
            if row["name"] in ours and n in targets:
                row["at_most_ms"] = targets[n]
        scene: dict[str, Callable[[], Any]] = {"k-d tree": partial(cKDTree, points)}
        for name, classifier in ours.items():
            scene[name] = partial(classifier.predict, [points] * _SCENE)
        times = side_by_side(scene, settings["repeats"], warm=True)
        each = {
            name: time if name == "k-d tree" else Timing(time.wall / _SCENE, time.cpu / _SCENE)
            for name, time in times.items()
        }
        rows += of_size + rows_of(each, "k-d tree", f"{n:,} points, one of {_SCENE} clouds at once")[1:]
    return rows


def _classifiers(seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Ours and the rivals by name, with fresh weights, which do not matter to the time."""
    import torch

    from pec import Classifier
    from pec.checkpoint import Checkpoint
    from pec.networks.baselines import NearestNeighbours
    from pec.networks.registry import MODELS, build_model
    from pec.preprocessing.preprocess import Preprocess
    from pec.training.config import DatasetConfig, TrainConfig

    torch.manual_seed(seed)
    classes = list(LARS_CLASSES)

    def classifier(network: str, preprocess: Preprocess) -> Classifier:
        model = build_model(network, _POINTS, len(classes)).eval()
        if isinstance(model, NearestNeighbours):
            model.fit(torch.randn(_KNOWN, _POINTS, 3), torch.arange(_KNOWN) % len(classes))
        return Classifier(Checkpoint(model, classes, preprocess, 1.0, 0, network))

    upright = Preprocess(n_candidates=1024, sampling="random", pose="upright", ordering="anchors", anchor_unit="cloud")
    ours = {
        "default": classifier("pec", TrainConfig(DatasetConfig(""), "").preprocess),
        "published": classifier("pec", Preprocess(ordering="groups", group_size=16)),
        "pec upright": classifier("pec", replace(upright, size="root")),
        "pec2 upright": classifier("pec2", upright),
    }
    rivals = [name for name in MODELS if not name.startswith("pec")]
    return ours, {name: classifier(name, Preprocess(ordering="none")) for name in rivals}


def training(settings: Mapping[str, Any]) -> list[Row]:
    """One epoch of the published job on random clouds: a step on all of them, evaluation, both checkpoints.

    What a run of settings["training_epochs"] + 1 epochs takes longer than a run of one, preprocessing and the final
    report aside. Beside it the multiply-adds of the epoch's step as products of large matrices, in float32.
    """
    threads, epochs = settings["training_threads"], settings["training_epochs"]
    with tempfile.TemporaryDirectory() as folder:
        data = _clouds(Path(folder) / "clouds.npz", settings["seed"])
        times = {_ONE_PRODUCT: _products(threads)}
        for precision in ("float32", "bfloat16"):
            short, long = (_run(data, precision, threads, n) for n in (1, 1 + epochs))
            times[precision] = Timing((long.wall - short.wall) / epochs, (long.cpu - short.cpu) / epochs)
    rows = rows_of(times, _ONE_PRODUCT, f"an epoch of {_TRAINING:,} clouds, {threads} threads")
    for row in rows[1:]:
        row["extrapolated_s"] = _EPOCHS * row["wall_ms"] / 1000
        if "train_at_most_s" in settings:
            row["at_most_ms"] = round(1000 * settings["train_at_most_s"] / _EPOCHS)
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


def _run(data: Path, precision: str, threads: int, epochs: int) -> Timing:
    from pec.training.loop import train

    output = data.with_name(f"{precision}_{epochs}")
    published = {"selection": "evaluation split", "batch_size": None, "learning_rate": 0.01, "schedule": "constant"}
    begin, cpu = time.perf_counter(), time.process_time()
    train(
        {
            "dataset": {"path": str(data), "split": "official"},
            "output": str(output),
            "preprocess": {"ordering": "groups", "group_size": 16},
            "protocol": {**published, "epochs": epochs, "weight_decay": 0.0, "label_smoothing": 0.0}
            | {"precision": precision},
            "augment": {"remove": 0.0},
            "threads": threads,
            "device": "cpu",
            "cache": str(data.with_name("cache")),
            "progress": False,
        }
    )
    return Timing(time.perf_counter() - begin, time.process_time() - cpu)


def _products(threads: int) -> Timing:
    """Products of large matrices with as many multiply-adds as a step on all clouds: forward, and twice that back."""
    import torch

    from pec.common.threads import torch_threads
    from pec.networks.registry import build_model
    from pec.training.costs import multiply_adds

    needed = 3 * _TRAINING * multiply_adds(build_model("pec", _POINTS, len(LARS_CLASSES)), _POINTS)
    rows = 16 * _PRODUCT_SIZE
    repeats = round(needed / (rows * _PRODUCT_SIZE**2))
    one, other = torch.randn(rows, _PRODUCT_SIZE), torch.randn(_PRODUCT_SIZE, _PRODUCT_SIZE)

    def run() -> None:
        for _ in range(repeats):
            one @ other

    with torch_threads(threads):
        return side_by_side({_ONE_PRODUCT: run}, 1)[_ONE_PRODUCT]
