"""Does it transfer? Train on each kind of data set, test on clouds that the environment's own pipeline cuts out.

A recipe is a scenario, a sensor, the augmentation by defects, and a network. Each is trained with several seeds on
objects of the catalogue, and tested on other objects of the same classes, in scenes with the D435's faults. The epoch
is chosen on the recipe's own validation split: the scenes are looked at once a training, at the end.

OUT/data/… are the data sets, OUT/scenes the test clouds, OUT/train/… the runs, OUT/results.json the table. All of it
goes on where it was stopped.
"""

from __future__ import annotations

import itertools
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pec import Classifier
from pec.common.atomic_files import write_json
from pec.data.dataset import CloudDataset
from pec.data.loading import load_dataset
from pec.training.loop import train
from pecgrasp_env.capture import CaptureConfig, generate
from pecgrasp_env.experiments.scene_clouds import capture_scenes

__all__ = ["cluster_interval", "run_transfer", "table"]

_DRAWS = 2000


def run_transfer(settings: Mapping[str, Any], say: Callable[[str], None] = print) -> dict[str, Any]:
    """Generate, train and test all recipes, or what is left of it.

    settings: what conf/transfer.yaml makes. Returns what is also written to OUT/results.json: `recipes`, a row each,
    with `accuracy` (mean over the seeds), `interval` (95 %, over objects), `of_seeds` and `of_classes`; `scenes`.
    """
    out = Path(settings["out"])
    warnings.filterwarnings("ignore", message=".*Box (low|high)'s precision lowered")  # ManiSkill's float64 limits
    capture_scenes(settings["scenes"], out / "scenes")
    scenes = load_dataset(out / "scenes")
    say(f"test: {len(scenes)} clouds of {len(np.unique(scenes.instances))} objects that training does not draw")
    rows = []
    axes = (settings["scenarios"], settings["sensors"], settings["augments"].items(), settings["models"].items())
    for scenario, sensor, (defects, augment), (name, model) in itertools.product(*axes):
        data = out / "data" / f"{scenario}_{sensor}"
        _generate(settings, scenario, sensor, data)
        right = np.stack(
            [
                _right(
                    settings,
                    data,
                    out / "train" / f"{scenario}_{sensor}_{defects}_{name}_{seed}",
                    augment,
                    model,
                    seed,
                    scenes,
                )
                for seed in settings["seeds"]
            ]
        )
        rows.append(
            {
                "scenario": scenario,
                "sensor": sensor,
                "defects": defects,
                "model": name,
                "accuracy": float(right.mean()),
                "interval": cluster_interval(right.mean(axis=0), scenes.instances),
                "of_seeds": right.mean(axis=1).tolist(),
                "of_classes": {
                    each: float(right[:, scenes.labels == label].mean()) for label, each in enumerate(scenes.classes)
                },
            }
        )
        say(_line(rows[-1]))
        results = {"scenes": {"clouds": len(scenes), **settings["scenes"]}, "recipes": rows}
        write_json(out / "results.json", results)
    return results


def _generate(settings: Mapping[str, Any], scenario: str, sensor: str, directory: Path) -> None:
    generation = settings["generation"]
    chosen = {**generation, "scenario": scenario, "sensor": {**generation["sensor"], "mode": sensor}}
    generate(CaptureConfig.from_settings(chosen), directory, workers=settings["workers"])


def _right(
    settings: Mapping[str, Any],
    data: Path,
    run: Path,
    augment: Mapping[str, Any],
    model: Mapping[str, Any],
    seed: int,
    scenes: CloudDataset,
) -> np.ndarray:
    """Which of the scenes' clouds one training calls right, (n,) bool; kept in RUN/scenes.json."""
    path = run / "scenes.json"
    training = settings["training"]
    chosen = {**training, "augment": augment, "model": model, "seed": seed, "output": str(run)}
    # A finished run is read, an interrupted one goes on, and another one in its place is refused.
    trained = train({**chosen, "dataset": {**training["dataset"], "path": str(data), "classes": scenes.classes}})
    if path.is_file():
        kept = json.loads(path.read_text())
        if kept["fingerprint"] == scenes.fingerprint:
            return np.array(kept["right"], bool)
    predictions = Classifier.load(trained["checkpoint"]).predict(scenes.clouds)
    names = [scenes.classes[label] for label in scenes.labels]
    # Which class is likeliest: whether it is one at all is another question.
    likeliest = [max(each.probabilities, key=lambda name: each.probabilities[name]) for each in predictions]
    right = [answer == name for answer, name in zip(likeliest, names, strict=True)]
    write_json(path, {"fingerprint": scenes.fingerprint, "right": right})
    return np.array(right, bool)


def cluster_interval(right: np.ndarray, clusters: np.ndarray, seed: int = 0) -> tuple[float, float]:
    """95 % interval of the mean of `right` (n,) by a bootstrap over clusters (n,): clouds of one object are alike.

    Percentile bootstrap (Efron, 1979) of whole clusters, 2,000 draws.
    """
    _, member = np.unique(clusters, return_inverse=True)
    sums = np.bincount(member, weights=right.astype(float))
    counts = np.bincount(member)
    drawn = np.random.default_rng(seed).integers(len(counts), size=(_DRAWS, len(counts)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def table(results: Mapping[str, Any]) -> str:
    """The recipes, the best first, as text."""
    rows: Sequence[Mapping[str, Any]] = sorted(results["recipes"], key=lambda row: -row["accuracy"])
    return "\n".join(map(_line, rows))


def _line(row: Mapping[str, Any]) -> str:
    low, high = row["interval"]
    seeds = ", ".join(f"{100 * value:.1f}" for value in row["of_seeds"])
    return (
        f"{row['model']:<12}{row['scenario']:<10}{row['sensor']:<7}{row['defects']:<9}{100 * row['accuracy']:>6.1f} %  "
        f"[{100 * low:.1f}, {100 * high:.1f}]  seeds {seeds}"
    )
