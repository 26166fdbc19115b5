"""How well trained classifiers do on test clouds that something has befallen: the table of ModelNet-C."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from pec.checkpoint import Checkpoint
from pec.common.threads import torch_threads
from pec.data.corruptions import CORRUPTIONS, LEVELS, corrupt
from pec.data.dataset import CloudDataset
from pec.experiments.grid_rows import order_name
from pec.metrics.predictions import predict_log_probabilities
from pec.metrics.scores import score
from pec.training.finished_runs import read_finished

__all__ = ["measure_robustness", "robustness_table"]


def measure_robustness(
    runs: Sequence[str | os.PathLike[str]], *, data: str | None = None, seed: int = 0, progress: bool = False
) -> list[dict[str, Any]]:
    """Accuracies of finished training runs (their output folders), each by its best checkpoint on its own test split.

    data: where the clouds lie, if not where they lay in training. Cloud i at a level of a corruption is drawn from
    (seed, i, corruption, level), so that runs with the same test split see the same clouds.
    Returns a row a run: `run`, `network`, `points`, `order`, `seed`, `settings`, `n_test`, `clean`, and of each
    corruption its five accuracies, level 1 first. Raises CheckpointError where a folder holds no finished run, or
    DatasetError.
    """
    members = [_member(Path(run), data) for run in runs]
    kinds = [("clean", 0), *((kind, level) for kind in CORRUPTIONS for level in LEVELS)]
    with torch_threads(1):
        for kind, level in tqdm(kinds, desc="corruptions", unit="set", disable=not progress):
            sampled: dict[str, tuple[torch.Tensor, torch.Tensor]] = {}
            for member in members:
                # Most of the time goes into the sampling, which members with the same test split and points share.
                if member.sampling not in sampled:
                    sampled[member.sampling] = _sampled(member, kind, level, seed)
                checkpoint = member.checkpoint
                log_probabilities = predict_log_probabilities(
                    checkpoint.model, checkpoint.preprocess, *sampled[member.sampling], checkpoint.forms
                )
                labels = torch.from_numpy(member.test.labels)
                accuracy = score(log_probabilities, labels, n_classes=len(checkpoint.classes)).accuracy
                if kind == "clean":
                    member.row[kind] = accuracy
                else:
                    member.row.setdefault(kind, []).append(accuracy)
    return [member.row for member in members]


def robustness_table(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: a line for the runs that differ in their seed only; of a corruption the mean over its levels, in %."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(json.dumps(row["settings"], sort_keys=True), []).append(row)
    head = ["model", "points", "order", "seeds", "clean", *CORRUPTIONS, "mean of the seven"]
    lines = [" | ".join(head), " | ".join(["---"] * len(head))]
    for members in groups.values():
        means = [[fmean(row[kind]) for row in members] for kind in CORRUPTIONS]
        overall = [fmean(values) for values in zip(*means, strict=True)]
        columns = [[row["clean"] for row in members], *means, overall]
        first = [members[0]["network"], str(members[0]["points"]), members[0]["order"], str(len(members))]
        lines.append(" | ".join([*first, *map(_percent, columns)]))
    n_test = sorted({row["n_test"] for row in rows})
    lines += [
        "",
        f"Test accuracy in %, mean ± standard deviation over the seeds, on {' / '.join(map(str, n_test))} test clouds; "
        "of a corruption the mean over its levels 1 to 5.",
    ]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Member:
    checkpoint: Checkpoint
    test: CloudDataset
    sampling: str
    """Equal where the test clouds and what FPS makes of them are."""
    row: dict[str, Any]


def _member(run: Path, data: str | None) -> _Member:
    finished = read_finished(run, data)
    config, checkpoint, test = finished.config, finished.checkpoint, finished.test
    preprocess = checkpoint.preprocess
    sampling: list[Any] = [finished.data, config.dataset.size, finished.places]
    sampling += [preprocess.n_points, preprocess.n_candidates, preprocess.sampling, preprocess.start]
    sampling.append(preprocess.drop_isolated)
    decisive = config.decisive()
    del decisive["seed"], decisive["dataset"]["path"]
    row = {
        "run": str(run),
        "network": checkpoint.network,
        "points": preprocess.n_points,
        "order": order_name(asdict(preprocess)),
        "seed": config.seed,
        "settings": decisive,
        "n_test": len(test),
    }
    return _Member(checkpoint, test, json.dumps(sampling), row)


def _sampled(member: _Member, kind: str, level: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Candidates (n, K, 3) and which of them exist (n, K), of every test cloud after the corruption."""
    test, preprocess = member.test, member.checkpoint.preprocess
    candidates = np.zeros((len(test), preprocess.n_candidates, 3), np.float32)
    valid = np.zeros((len(test), preprocess.n_candidates), bool)
    place = ["clean", *CORRUPTIONS].index(kind)
    for index in range(len(test)):
        rng = np.random.default_rng((seed, index, place, level))
        points = test.cloud(index)
        if kind != "clean":
            points = corrupt(points, kind, level, rng, least=preprocess.n_points)
        sample = preprocess.sample(points, rng)
        candidates[index, : len(sample)] = sample
        valid[index, : len(sample)] = True
    return torch.from_numpy(candidates), torch.from_numpy(valid)


def _percent(shares: Sequence[float]) -> str:
    mean = f"{100 * fmean(shares):.1f}"
    return f"{mean} ± {100 * stdev(shares):.1f}" if len(shares) > 1 else mean
