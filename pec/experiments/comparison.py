"""Trained classifiers on the very same test clouds: who is right where, and what nobody gets right."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from pec.common.threads import torch_threads
from pec.data.tensor_dataset import prepare
from pec.errors import ConfigError, DatasetError
from pec.experiments.grid_rows import order_name, protocol_name
from pec.metrics.predictions import among_known, average_views, predict_log_probabilities
from pec.metrics.proportions import mcnemar, wilson_interval
from pec.training.costs import measure_costs
from pec.training.finished_runs import FinishedRun, read_finished

__all__ = ["compare_classifiers", "comparison_table"]


def compare_classifiers(
    runs: Sequence[str | os.PathLike[str]], *, data: str | None = None, seed: int = 0, progress: bool = False
) -> dict[str, Any]:
    """Compare the best checkpoints of finished training runs (their output folders) on their common test split.

    data: where the clouds lie, if not where they lay in training. seed: of what is drawn for a cloud, FPS' first point
    and what `dataset.removed` takes, alike for all runs.

    Returns `n_test`, `n_objects`; `runs`, a row each: `run`, `network`, `points`, `order`, `protocol`, `seed`,
    `accuracy`, `interval`, and what one cloud costs it, measured here one run after another (`pec.training.costs`):
    `parameters`, `multiply_adds`, `network_ms`, `raw_cloud_ms`; `pairs`: `first`, `second`, `only_first`,
    `only_second`, `p` of McNemar's exact test; `together`, the accuracy of the mean of all calibrated probabilities;
    and `missed`, the clouds that half of the runs or more get wrong, most missed first: `cloud` (its place in the
    stored data set), `class`, `taken_for` by most of those runs, `missed_by`. Intervals and p are for other clouds of
    the same objects, and for these trained networks.
    Raises CheckpointError where a folder holds no finished run, DatasetError where runs were tested on other clouds
    than the first, ConfigError where there are no runs.
    """
    if not runs:
        raise ConfigError("runs names no folder")
    first: FinishedRun | None = None
    rows, of_runs = [], []
    with torch_threads(1):
        for folder in tqdm(runs, desc="runs", unit="run", disable=not progress):
            run = read_finished(Path(folder), data)
            first = first or run
            difference = _difference(run, first)
            if difference:
                raise DatasetError(f"{folder} {difference} than {runs[0]}")
            of_runs.append(_answers(run, seed))
            rows.append(_row(folder, run) | measure_costs(run.checkpoint).as_dict())
    assert first is not None
    labels = torch.from_numpy(first.test.labels)
    answers = torch.stack(of_runs)
    predicted = answers.argmax(dim=2)
    right = predicted == labels
    for row, hits in zip(rows, right, strict=True):
        count = int(hits.sum())
        row |= {"accuracy": count / len(labels), "interval": list(wilson_interval(count, len(labels)))}
    together = average_views(answers).argmax(dim=1) == labels
    return {
        "n_test": len(labels),
        "n_objects": len(np.unique(first.test.instances)),
        "runs": rows,
        "pairs": [
            _pair(str(runs[i]), str(runs[j]), right[i], right[j])
            for i in range(len(runs))
            for j in range(i + 1, len(runs))
        ],
        "together": together.double().mean().item(),
        "missed": _missed(first, predicted, right),
    }


def comparison_table(comparison: dict[str, Any]) -> str:
    """Markdown: the runs, each against the first; then, by class, the clouds that the runs miss together."""
    rows, n_runs, n_test = comparison["runs"], len(comparison["runs"]), comparison["n_test"]
    head = ["run", "model", "points", "order", "protocol", "seed", "test %", "Wilson 95 %"]
    head += ["parameters", "multiply-adds", "network ms", "raw cloud ms"]
    head += ["only it is right", "only the first is right", "p, McNemar exact"]
    lines = [" | ".join(head), " | ".join(["---"] * len(head))]
    # The first run's pairs come first, in the order of the others.
    against = [["–", "–", "–"]] + [
        [str(pair["only_second"]), str(pair["only_first"]), f"{pair['p']:.3g}"]
        for pair in comparison["pairs"][: n_runs - 1]
    ]
    for row, counts in zip(rows, against, strict=True):
        low, high = row["interval"]
        said = ["/".join(Path(row["run"]).parts[-2:])]
        said += [str(row[name]) for name in ("network", "points", "order", "protocol", "seed")]
        said += [f"{100 * row['accuracy']:.2f}", f"{100 * low:.1f}–{100 * high:.1f}"]
        said += [f"{row['parameters']:,}", f"{row['multiply_adds']:,}"]
        said += [f"{row['network_ms']:.2f}", f"{row['raw_cloud_ms']:.2f}"]
        lines.append(" | ".join([*said, *counts]))
    missed = comparison["missed"]
    by_all = [cloud for cloud in missed if cloud["missed_by"] == n_runs]
    lines += [
        "",
        f"{n_test} test clouds of {comparison['n_objects']} objects; intervals and p are for other clouds of these "
        "objects, for the networks as they were trained, and not corrected for the number of pairs. "
        f"All {n_runs} together, by the mean of their probabilities: {100 * comparison['together']:.2f} %. "
        f"{len(missed)} clouds are missed by half of the runs or more, {len(by_all)} by all.",
    ]
    if missed:
        lines += ["", "class | missed by half or more | by all | taken for", "--- | --- | --- | ---"]
        for name, count in Counter(cloud["class"] for cloud in missed).most_common():
            of_class = [cloud for cloud in missed if cloud["class"] == name]
            taken = Counter(cloud["taken_for"] for cloud in of_class).most_common()
            of_all = sum(cloud["class"] == name for cloud in by_all)
            lines.append(f"{name} | {count} | {of_all} | " + ", ".join(f"{other} {n}" for other, n in taken))
    return "\n".join(lines) + "\n"


def _difference(run: FinishedRun, first: FinishedRun) -> str | None:
    """What keeps the runs from being compared."""
    for name, of_run, of_first in (
        ("knows other classes", run.checkpoint.classes, first.checkpoint.classes),
        ("has another dataset.removed", run.config.dataset.removed, first.config.dataset.removed),
        ("was tested on other clouds", (run.data, run.places), (first.data, first.places)),
    ):
        if of_run != of_first:
            return name
    return None


def _answers(run: FinishedRun, seed: int) -> torch.Tensor:
    """(n, C) calibrated log-probabilities."""
    checkpoint = run.checkpoint
    clouds = prepare(run.test, checkpoint.preprocess, removed=run.config.dataset.removed, seed=seed)
    parts = checkpoint.model, checkpoint.preprocess, clouds.candidates, clouds.valid, checkpoint.forms
    answers = predict_log_probabilities(*parts)
    return (among_known(answers, len(checkpoint.classes)) / checkpoint.temperature).log_softmax(dim=1)


def _row(folder: str | os.PathLike[str], run: FinishedRun) -> dict[str, Any]:
    preprocess = run.checkpoint.preprocess
    return {
        "run": str(folder),
        "network": run.checkpoint.network,
        "points": preprocess.n_points,
        "order": order_name(asdict(preprocess)),
        "protocol": protocol_name(asdict(run.config.protocol)),
        "seed": run.config.seed,
    }


def _pair(first: str, second: str, right_first: torch.Tensor, right_second: torch.Tensor) -> dict[str, Any]:
    only_first, only_second = int((right_first & ~right_second).sum()), int((right_second & ~right_first).sum())
    return {
        "first": first,
        "second": second,
        "only_first": only_first,
        "only_second": only_second,
        "p": mcnemar(only_first, only_second),
    }


def _missed(run: FinishedRun, predicted: torch.Tensor, right: torch.Tensor) -> list[dict[str, Any]]:
    test = run.test
    missed_by = (~right).sum(dim=0).tolist()
    clouds = []
    for place in sorted(range(len(test)), key=lambda place: -missed_by[place]):
        if 2 * missed_by[place] < len(right):
            break
        wrong = predicted[~right[:, place], place].tolist()
        clouds.append(
            {
                "cloud": run.places[place],
                "class": test.classes[test.labels[place]],
                "taken_for": test.classes[Counter(wrong).most_common(1)[0][0]],
                "missed_by": missed_by[place],
            }
        )
    return clouds
