"""Trained classifiers on the very same test clouds: who is right where, and what nobody gets right."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from pec.ablation_table import order_name
from pec.clouds import data_version
from pec.errors import ConfigError, DatasetError
from pec.evaluation import average_views, predict_log_probabilities
from pec.finished import FinishedRun, read_finished
from pec.prepared import prepare
from pec.proportions import mcnemar, wilson_interval
from pec.threads import torch_threads

__all__ = ["compare_classifiers", "comparison_table"]


def compare_classifiers(
    runs: Sequence[str | os.PathLike[str]], *, data: str | None = None, progress: bool = False
) -> dict[str, Any]:
    """Compare the best checkpoints of finished training runs (their output folders) on their common test split.

    data: where the clouds lie, if not where they lay in training. Each run sees its test clouds as in its own report.
    Returns `runs` (a row each: `run`, `network`, `points`, `order`, `seed`, `accuracy`, `interval`), `pairs` (`first`,
    `second`, `only_first`, `only_second`, `p` of McNemar's exact test), `n_test`, `together` (accuracy of the mean of
    all probabilities), and `missed`: the clouds that half of the runs or more get wrong, most missed first (`cloud`:
    index in the data set, `class`, `taken_for`: by most of those runs, `missed_by`).
    Raises CheckpointError where a folder holds no finished run, DatasetError where runs were tested on other clouds
    than the first, ConfigError where there are no runs.
    """
    if not runs:
        raise ConfigError("runs names no folder")
    bar = tqdm(runs, desc="runs", unit="run", disable=not progress)
    with torch_threads(1):
        members = [_member(read_finished(Path(run), data)) for run in bar]
    first = members[0]
    for run, member in zip(runs, members, strict=True):
        if member.tested != first.tested:
            raise DatasetError(f"{run} was tested on other clouds than {runs[0]}")
    answers = torch.stack([member.log_probabilities for member in members])
    labels = torch.from_numpy(first.run.dataset.labels[first.run.test])
    predicted = answers.argmax(dim=2)
    right = predicted == labels
    together = average_views(answers).argmax(dim=1) == labels
    return {
        "n_test": len(labels),
        "runs": [_row(run, member.run, hits) for run, member, hits in zip(runs, members, right, strict=True)],
        "pairs": [
            _pair(str(runs[i]), str(runs[j]), right[i], right[j])
            for i in range(len(runs))
            for j in range(i + 1, len(runs))
        ],
        "together": together.double().mean().item(),
        "missed": _missed(first.run, predicted, right),
    }


def comparison_table(comparison: dict[str, Any]) -> str:
    """Markdown: the runs, each against the first; then, by class, the clouds that the runs miss together."""
    rows, n_runs, n_test = comparison["runs"], len(comparison["runs"]), comparison["n_test"]
    head = ["model", "points", "order", "seed", "test %", "Wilson 95 %"]
    head += ["only it is right", "only the first is right", "p, McNemar exact"]
    lines = [" | ".join(head), " | ".join(["---"] * len(head))]
    # The first run's pairs come first, in the order of the others.
    against = [["–", "–", "–"]] + [
        [str(pair["only_second"]), str(pair["only_first"]), f"{pair['p']:.3g}"]
        for pair in comparison["pairs"][: n_runs - 1]
    ]
    for row, counts in zip(rows, against, strict=True):
        low, high = row["interval"]
        said = [row["network"], str(row["points"]), row["order"], str(row["seed"])]
        lines.append(" | ".join([*said, f"{100 * row['accuracy']:.2f}", f"{100 * low:.1f}–{100 * high:.1f}", *counts]))
    missed = comparison["missed"]
    by_all = [cloud for cloud in missed if cloud["missed_by"] == n_runs]
    lines += [
        "",
        f"All {n_runs} together, by the mean of their probabilities: {100 * comparison['together']:.2f} %. Of {n_test} "
        f"test clouds {len(missed)} are missed by half of them or more, {len(by_all)} by all.",
    ]
    if missed:
        lines += ["", "class | missed by half or more | by all | taken for", "--- | --- | --- | ---"]
        for name, count in Counter(cloud["class"] for cloud in missed).most_common():
            of_class = [cloud for cloud in missed if cloud["class"] == name]
            taken = Counter(cloud["taken_for"] for cloud in of_class).most_common()
            of_all = sum(cloud["class"] == name for cloud in by_all)
            lines.append(f"{name} | {count} | {of_all} | " + ", ".join(f"{other} {n}" for other, n in taken))
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Member:
    run: FinishedRun
    tested: tuple[Any, ...]
    """Equal where runs were tested on the same clouds."""
    log_probabilities: torch.Tensor


def _member(run: FinishedRun) -> _Member:
    config, preprocess = run.config, run.checkpoint.preprocess
    clouds = prepare(run.dataset, preprocess, removed=config.dataset.removed, seed=config.seed, cache=config.cache)
    test = clouds.subset(run.test)
    tested = (data_version(config.dataset.path), run.checkpoint.classes, run.test.tolist(), test.labels.tolist())
    answers = predict_log_probabilities(run.checkpoint.model, preprocess, test.candidates, test.valid)
    return _Member(run, tested, answers)


def _row(run: str | os.PathLike[str], finished: FinishedRun, right: torch.Tensor) -> dict[str, Any]:
    preprocess = finished.checkpoint.preprocess
    n = len(right)
    count = int(right.sum())
    return {
        "run": str(run),
        "network": finished.checkpoint.network,
        "points": preprocess.n_points,
        "order": order_name(asdict(preprocess)),
        "seed": finished.config.seed,
        "accuracy": count / n,
        "interval": list(wilson_interval(count, n)),
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
    classes, labels = run.checkpoint.classes, run.dataset.labels[run.test]
    missed_by = (~right).sum(dim=0).tolist()
    clouds = []
    for place in sorted(range(len(labels)), key=lambda place: -missed_by[place]):
        if 2 * missed_by[place] < len(right):
            break
        wrong = predicted[~right[:, place], place].tolist()
        clouds.append(
            {
                "cloud": int(run.test[place]),
                "class": classes[labels[place]],
                "taken_for": classes[Counter(wrong).most_common(1)[0][0]],
                "missed_by": missed_by[place],
            }
        )
    return clouds
