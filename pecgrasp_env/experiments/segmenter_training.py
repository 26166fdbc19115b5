"""Train the trees by which the segmenter says which surfaces are of one object, from labelled frames.

The frames are cut into patches by the segmenter's own code, so that the trees meet its patches and its faults. A
patch's object is that of most of its pixels; a pair's example weighs as much as the smaller patch is large and pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping.errors import CloudError
from grasping.segmentation.boosted_trees import BoostedTrees, Relations
from grasping.segmentation.segmenter import Segmenter
from grasping.segmentation.surfaces import Surfaces

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]

TREES, LEAVES = 200, 24
RATE, LEAST_EXAMPLES, RIDGE = 0.08, 20, 1.0
OBJECTS = 2  # labels from this up are objects; 1 is the table, 0 all else
LEAST_PURITY = 0.6  # of a patch's pixels that are of one object; of a mixed patch nothing is right


@dataclass
class Examples:
    """Rows of features, whether the two patches are of one object, and the row's weight."""

    features: list[Float32Array] = field(default_factory=list)
    same: list[NDArray[np.bool_]] = field(default_factory=list)
    weight: list[FloatArray] = field(default_factory=list)

    def add(self, features: Float32Array, same: NDArray[np.bool_], weight: FloatArray) -> None:
        used = weight > 0
        self.features.append(features[used])
        self.same.append(same[used])
        self.weight.append(weight[used])

    def arrays(self) -> tuple[Float32Array, NDArray[np.bool_], FloatArray]:
        return np.concatenate(self.features), np.concatenate(self.same), np.concatenate(self.weight)


def examples(frames: Iterable[tuple[NDArray, NDArray]], without_table: float, seed: int) -> tuple[Examples, Examples]:
    """Of pairs that adjoin, and of pairs that do not, from frames: clouds (H, W, 3), m, with labels (H, W).

    without_table: the share of frames that are cut once more as if no table had been found in them.
    """
    near, far = Examples(), Examples()
    rng = np.random.default_rng(seed)
    for cloud, labels in frames:
        ways = (True, False) if rng.uniform() < without_table else (True,)
        for with_table in ways:
            try:
                surfaces = Segmenter().surfaces(cloud, with_table=with_table)
            except CloudError:
                continue
            if surfaces is None or not surfaces.count:
                continue
            owner, purity = owners(surfaces, labels)
            for first, second, features, found in (
                (surfaces.borders.first, surfaces.borders.second, surfaces.near_features, near),
                (surfaces.far_first, surfaces.far_second, surfaces.far_features, far),
            ):
                one, other = owner[first], owner[second]
                smaller = np.minimum(surfaces.measures.pixels[first], surfaces.measures.pixels[second])
                weight = np.sqrt(smaller) * np.minimum(purity[first], purity[second])
                weight[np.minimum(purity[first], purity[second]) < LEAST_PURITY] = 0
                weight[(one < OBJECTS) & (other < OBJECTS)] = 0
                found.add(features, one == other, weight)
    return near, far


def owners(surfaces: Surfaces, labels: NDArray) -> tuple[IntArray, FloatArray]:
    """(n + 1,) the label that most points of each patch have, and their share of it."""
    cells = surfaces.image.cells
    seen = (cells >= 0) & (surfaces.image.point_inverse_depth > 0)
    patch = surfaces.labels.ravel()[cells[seen]]
    label = labels.ravel()[seen].astype(np.int64)
    most = int(label.max(initial=0)) + 1
    counts = np.bincount(patch * most + label, minlength=(surfaces.count + 1) * most).reshape(-1, most)
    return counts.argmax(axis=1), counts.max(axis=1) / np.maximum(counts.sum(axis=1), 1)


def fit_trees(found: Examples, seed: int) -> BoostedTrees:
    """Gradient boosting (Friedman 2001; histograms as in LightGBM) by scikit-learn, as arrays.

    Raises ImportError with the way out where scikit-learn is not installed.
    """
    try:
        from sklearn.ensemble import HistGradientBoostingClassifier
    except ImportError as error:
        raise ImportError("training the segmenter needs scikit-learn: pip install 'pecgrasp[segmenter]'") from error
    features, same, weight = found.arrays()
    model = HistGradientBoostingClassifier(
        max_iter=TREES,
        max_leaf_nodes=LEAVES,
        learning_rate=RATE,
        min_samples_leaf=LEAST_EXAMPLES,
        l2_regularization=RIDGE,
        early_stopping=False,
        random_state=seed,
    )
    model.fit(features, same, sample_weight=weight / weight.mean())
    return as_arrays([trees[0].nodes for trees in model._predictors], float(np.ravel(model._baseline_prediction)[0]))


def as_arrays(trees: Sequence[NDArray[Any]], baseline: float) -> BoostedTrees:
    """scikit-learn's nodes of each tree as one set of arrays."""
    nodes = np.concatenate(trees)
    start = np.cumsum([0, *(len(tree) for tree in trees[:-1])])
    offset = np.repeat(start, [len(tree) for tree in trees])
    leaf = nodes["is_leaf"].astype(bool)
    # A float32 is at most a float64 threshold where it is at most the largest float32 that is.
    threshold = nodes["num_threshold"].astype(np.float32)
    above = threshold.astype(np.float64) > nodes["num_threshold"]
    threshold[above] = np.nextafter(threshold[above], np.float32(-np.inf))
    return BoostedTrees(
        feature=np.where(leaf, -1, nodes["feature_idx"]).astype(np.int32),
        threshold=np.where(leaf, np.float32(0), threshold).astype(np.float32),
        left=np.where(leaf, 0, nodes["left"].astype(np.int64) + offset).astype(np.int32),
        right=np.where(leaf, 0, nodes["right"].astype(np.int64) + offset).astype(np.int32),
        missing_left=nodes["missing_go_to_left"].astype(np.int32),
        value=np.where(leaf, nodes["value"], 0.0),
        start=start.astype(np.int32),
        baseline=baseline,
    )


def precision_recall(trees: BoostedTrees, found: Examples) -> dict[str, float]:
    """Of pairs said to be of one object, with the pairs' weights: how many are, and how many of those are found."""
    features, same, weight = found.arrays()
    said = trees.log_odds(features) > 0
    right = float(weight[said & same].sum())
    return {
        "pairs": len(same),
        "precision": right / max(float(weight[said].sum()), 1e-9),
        "recall": right / max(float(weight[same].sum()), 1e-9),
    }


def train(near: Examples, far: Examples, about: dict[str, Any], seed: int) -> Relations:
    """Trees for both kinds of pairs."""
    return Relations(fit_trees(near, seed), fit_trees(far, seed), about)
