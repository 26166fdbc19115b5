"""What a classifier makes of things that it has not seen: known ones, and strangers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pec.classifier import Classifier
from pec.data.dataset import CloudDataset
from pec.data.loading import load_dataset
from pec.data.shards import MANIFEST_NAME, read_manifest
from pec.errors import DatasetError
from pec.metrics.rejection import UNSEEN_REJECTED, area_under_roc
from pecgrasp_env.experiments.transfer import cluster_interval

__all__ = ["Answered", "answered", "measure"]

_CURVE = 200  # points of it that are kept


@dataclass(frozen=True)
class Answered:
    """Clouds of one kind and what was said of them. names (n,): "class/instance" of each. truth (n,): its class;
    likeliest (n,): the class that is; known (n,)."""

    dataset: CloudDataset
    names: np.ndarray
    truth: np.ndarray
    likeliest: np.ndarray
    known: np.ndarray

    def __len__(self) -> int:
        return len(self.known)


def answered(classifier: Classifier, folder: str, *, strangers: bool) -> Answered:
    """Of a data set the clouds of the classifier's classes, or where `strangers` those of all others.

    Raises DatasetError where there is none of them.
    """
    whole = load_dataset(folder, min_points=classifier.n_points)
    is_known = np.isin(np.array(whole.classes), classifier.classes)[whole.labels]
    chosen = np.flatnonzero(~is_known if strangers else is_known)
    if not len(chosen):
        kind = "none but clouds of these" if strangers else "no cloud of these"
        raise DatasetError(f"{folder}: {kind} classes: {', '.join(classifier.classes)}")
    dataset = whole.subset(chosen)
    truth = np.array(dataset.classes)[dataset.labels]
    instances = _instance_names(folder, whole)
    predictions = classifier.predict(dataset.clouds)
    return Answered(
        dataset,
        np.array([f"{name}/{instances[i]}" for name, i in zip(truth, dataset.instances, strict=True)]),
        truth,
        np.array([max(each.probabilities, key=lambda name: each.probabilities[name]) for each in predictions]),
        np.array([each.known for each in predictions]),
    )


def measure(parts: Mapping[str, Answered], threshold: float) -> dict[str, Any]:
    """`parts`: "known" (of unseen instances) and "strangers", and where there is such "seen".

    Returns `threshold`, that of the checkpoint, and `threshold_95`, which 95 % of the clouds of "known" pass; `auc` of
    known against strangers and `roc`, (share of strangers kept, share of known kept) pairs; of each part `parts`:
    `clouds`, `instances`, and at each threshold (`at`, `at_95`) `kept`, with its interval over instances, and where it
    is known `right`, the share that is kept and right; `likeliest_right`, whether kept or not. `instances`, a row each:
    `part`, `name`, `clouds`, `kept`, `right` or null, `median_known`, `taken_for`, counts of the likeliest class.
    """
    known, strangers = parts["known"], parts["strangers"]
    at_95 = float(np.quantile(known.known, UNSEEN_REJECTED))
    results: dict[str, Any] = {
        "threshold": threshold,
        "threshold_95": at_95,
        "auc": area_under_roc(known.known, strangers.known),
        "roc": _roc(known.known, strangers.known),
        "parts": {},
        "instances": [],
    }
    for name, part in parts.items():
        row: dict[str, Any] = {"clouds": len(part), "instances": len(np.unique(part.names))}
        right = part.likeliest == part.truth
        for label, limit in (("at", threshold), ("at_95", at_95)):
            kept = part.known >= limit
            row[label] = {"kept": float(kept.mean()), "interval": cluster_interval(kept, part.names)}
            if name != "strangers":
                row[label]["right"] = float((kept & right).mean())
        if name != "strangers":
            row["likeliest_right"] = float(right.mean())
        results["parts"][name] = row
        results["instances"] += [_instance(name, part, each, threshold) for each in dict.fromkeys(part.names.tolist())]
    return results


def _instance(name: str, part: Answered, instance: str, threshold: float) -> dict[str, Any]:
    mine = part.names == instance
    kept = part.known[mine] >= threshold
    right = part.likeliest[mine] == part.truth[mine]
    return {
        "part": name,
        "name": instance,
        "clouds": int(mine.sum()),
        "kept": float(kept.mean()),
        "right": None if name == "strangers" else float((kept & right).mean()),
        "median_known": float(np.median(part.known[mine])),
        "taken_for": dict(Counter(part.likeliest[mine].tolist()).most_common()),
    }


def _roc(known: np.ndarray, strangers: np.ndarray) -> list[tuple[float, float]]:
    limits = np.unique(np.concatenate([known, strangers, [np.inf]]))
    limits = limits[np.unique(np.linspace(0, len(limits) - 1, _CURVE).round().astype(int))]
    return [(float((strangers >= limit).mean()), float((known >= limit).mean())) for limit in limits[::-1]]


def _instance_names(folder: str, dataset: CloudDataset) -> Sequence[str]:
    if (Path(folder) / MANIFEST_NAME).is_file():
        return [str(instance["name"]) for instance in read_manifest(folder).instances]
    return [str(i) for i in range(int(dataset.instances.max()) + 1)]
