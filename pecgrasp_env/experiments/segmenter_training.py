"""Train the trees by which the segmenter says which surfaces are of one object, from labelled frames.

The frames are cut into patches by the segmenter's own code, so that the trees meet its patches and its faults. A
patch's object is that of most of its pixels; a pair's example weighs as much as the smaller patch is large and pure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grasping.errors import CloudError
from grasping.segmentation.boosted_trees import KINDS, BoostedTrees, Relations
from grasping.segmentation.by_surfaces import group_patches, parts_of
from grasping.segmentation.segmenter import Segmenter
from grasping.segmentation.surfaces import Surfaces
from pecgrasp_env.experiments.kept_examples import Examples, KeptExamples

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
NumberedFrame = tuple[int, NDArray, NDArray]
"""A frame's number among all, which draws what is done to it; its cloud (H, W, 3), m; labels (H, W): 0 background, 1
the table, from 2 up the objects."""

STEPS = {"pairs": ("near", "far"), "parts": ("near_again", "far_again"), "groups": ("thing", "whole")}
"""What is learnt one after the other, each from what the trees before it make of frames that they did not see."""

TREES, LEAVES = 300, 31
TREES_OF_HALF = 100  # suffice to make groups with the faults that such trees make
RATE, LEAST_EXAMPLES, RIDGE = 0.08, 20, 1.0
OBJECTS = 2  # labels from this up are objects; 1 is the table, 0 all else
WITHOUT_TABLE = 0.15  # of the frames are cut once more as if no table had been found
WITH_BARS = 0.5  # of the frames are cut once more with bars before some objects
MOST_BARS, LEAST_HIDDEN = 3, 400  # of them, and pixels of an object that one is held before
LENGTHWISE = 0.7  # of the bars stand across the object's long side
PARTS_RATHER = (-3.0, -1.5, 0.0)  # log odds by which patches are grouped to the parts that are learnt from
WHOLE = 0.75  # of the union of a group and its object, that both have
LEAST_PURITY = 0.6  # of a patch's pixels that are of one object; of a mixed patch nothing is right


@dataclass(frozen=True)
class CutFrame:
    """A frame's patches, the label (n + 1,) that most points of each have, that label's share of them, and the number
    of points of each label.
    """

    surfaces: Surfaces
    owner: IntArray
    purity: FloatArray
    points: IntArray


def cut_frames(
    frames: Iterable[NumberedFrame], without_table: float, with_bars: float, seed: int
) -> Iterator[tuple[int, CutFrame]]:
    """Number and patches of frames; those of a frame do not depend on the others.

    without_table, with_bars: shares of frames that are cut once more, as if no table had been found in them, and with
    bars before some of the objects.
    """
    for number, cloud, labels in frames:
        rng = np.random.default_rng((seed, number))
        ways = [(cloud, labels, True)]
        if rng.uniform() < without_table:
            ways.append((cloud, labels, False))
        if rng.uniform() < with_bars:
            ways.append((*hide_middles(cloud, labels, rng), True))
        for seen, owned, with_table in ways:
            try:
                surfaces = Segmenter().surfaces(seen, with_table=with_table)
            except CloudError:
                continue
            if surfaces is not None and surfaces.count:
                yield number, CutFrame(surfaces, *owners(surfaces, owned))


def hide_middles(cloud: NDArray, labels: NDArray, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """A frame with bars held before some of its objects, so that what is seen of these are two ends.

    Few simulated scenes show that, and whether two ends are of one thing is what is hardest to say.
    """
    cloud, labels = cloud.copy(), labels.copy()
    row, column = (np.asarray(part) for part in np.indices(labels.shape))
    for label in rng.permutation(np.unique(labels[labels >= OBJECTS]))[:MOST_BARS]:
        own = (labels == label) & np.isfinite(cloud[..., 2])
        if np.count_nonzero(own) < LEAST_HIDDEN:
            continue
        r, c = row[own], column[own]
        axes: FloatArray = np.linalg.eigh(np.cov(np.stack([r, c]))).eigenvectors
        along = axes[:, 1] if rng.uniform() < LENGTHWISE else rng.normal(size=2)
        along = along / np.linalg.norm(along) + rng.normal(0, 0.2, 2)
        along /= np.linalg.norm(along)
        reach = (r - r.mean()) * along[0] + (c - c.mean()) * along[1]
        half = rng.uniform(0.08, 0.3) * np.ptp(reach) / 2 + 2
        offset = rng.uniform(-0.3, 0.3) * np.ptp(reach) / 2
        across = (row - r.mean()) * along[0] + (column - c.mean()) * along[1] - offset
        length = np.abs((row - r.mean()) * along[1] - (column - c.mean()) * along[0])
        bar = (np.abs(across) < half) & (length < rng.uniform(0.5, 1.2) * np.ptp(reach)) & np.isfinite(cloud[..., 2])
        own_z = cloud[..., 2][own]
        front = np.quantile(own_z, 0.02) - rng.uniform(0.01, 0.15)
        # Flat or round, as noisy as what was there.
        grain = np.clip(np.nan_to_num(cloud[..., 2] - _smooth(cloud[..., 2])), -0.003, 0.003)
        z = front + rng.choice([0.0, 0.02]) * (across / half) ** 2 + grain
        with np.errstate(invalid="ignore"):
            bar &= z < cloud[..., 2]
        cloud[bar] *= (z / cloud[..., 2])[bar, None]
        labels[bar] = labels.max() + 1
        shadow = (across > half) & (across < half + rng.uniform(0, 8)) & (length < np.ptp(reach))
        cloud[shadow] = np.nan
    return cloud, labels


def _smooth(depth: NDArray) -> NDArray:
    known = np.isfinite(depth)
    total = ndimage.uniform_filter(np.where(known, depth, 0.0), 5)
    return np.where(known, total / np.maximum(ndimage.uniform_filter(known.astype(float), 5), 1e-3), np.nan)


def add_pairs(cut: CutFrame, near: Examples, far: Examples) -> None:
    """Add pairs that adjoin, and pairs that do not: whether they are of one object."""
    surfaces = cut.surfaces
    for first, second, features, found in (
        (surfaces.borders.first, surfaces.borders.second, surfaces.near_features, near),
        (surfaces.far_first, surfaces.far_second, surfaces.far_features, far),
    ):
        one, other = cut.owner[first], cut.owner[second]
        purity = np.minimum(cut.purity[first], cut.purity[second])
        weight = np.sqrt(np.minimum(surfaces.sums.pixels[first], surfaces.sums.pixels[second])) * purity
        weight[purity < LEAST_PURITY] = 0
        weight[(one < OBJECTS) & (other < OBJECTS)] = 0
        found.add(features, one == other, weight)


def add_pairs_again(cut: CutFrame, near: BoostedTrees, far: BoostedTrees, examples: tuple[Examples, Examples]) -> None:
    """Add pairs of the parts that patches make by trees, near and far, as `add_pairs` adds those of patches."""
    for rather in PARTS_RATHER:
        of_patch = parts_of(cut.surfaces, cut.surfaces.group(near, far, rather))
        of_label = _pixels_of_labels(cut, of_patch)
        purity = of_label.max(axis=1) / np.maximum(np.bincount(of_patch, cut.surfaces.sums.pixels), 1)
        add_pairs(CutFrame(cut.surfaces.merged(of_patch), of_label.argmax(axis=1), purity, cut.points), *examples)


def _pixels_of_labels(cut: CutFrame, group: IntArray) -> FloatArray:
    """(G + 1, L) the pixels of each group that are of each label; of patches, what most of each is. group: (n + 1,)."""
    of_label = np.zeros((int(group.max()) + 1, max(len(cut.points), OBJECTS + 1)))
    np.add.at(of_label, (group, cut.owner), cut.surfaces.sums.pixels * cut.purity)
    return of_label


def add_groups(cut: CutFrame, relations: Relations, thing: Examples, whole: Examples) -> None:
    """Add groups as the trees for pairs make them: whether they are things, and whether whole ones."""
    groups = group_patches(cut.surfaces, relations)
    group = groups.grouping.group[groups.of_patch]
    of_objects = _pixels_of_labels(cut, group)[:, OBJECTS:]
    points = np.zeros(OBJECTS + of_objects.shape[1])
    points[: len(cut.points)] = cut.points
    total = np.bincount(group, cut.surfaces.sums.pixels)
    best = of_objects.argmax(axis=1)
    shared = of_objects[np.arange(len(total)), best]
    union = total + points[OBJECTS:][best] - shared
    weight = np.sqrt(total)
    weight[0] = 0
    thing.add(groups.features, of_objects.sum(axis=1) > total / 2, weight)
    whole.add(groups.features, shared > WHOLE * union, weight)


def owners(surfaces: Surfaces, labels: NDArray) -> tuple[IntArray, FloatArray, IntArray]:
    """(n + 1,) the label that most points of each patch have, and their share of it; (L,) pixels of each label."""
    cells = surfaces.image.cells
    seen = (cells >= 0) & (surfaces.image.point_inverse_depth > 0)
    patch = surfaces.labels.ravel()[cells[seen]]
    label = labels.ravel()[seen].astype(np.int64)
    most = int(label.max(initial=0)) + 1
    counts = np.bincount(patch * most + label, minlength=(surfaces.count + 1) * most).reshape(-1, most)
    points_a_pixel = np.count_nonzero(seen) / max(int(np.count_nonzero(surfaces.image.inverse_depth)), 1)
    points = (np.bincount(label, minlength=most) / max(points_a_pixel, 1.0)).astype(np.int64)
    return counts.argmax(axis=1), counts.max(axis=1) / np.maximum(counts.sum(axis=1), 1), points


def fit_trees(found: Examples, seed: int, trees: int = TREES) -> BoostedTrees:
    """Gradient boosting (Friedman 2001; histograms as in LightGBM) by scikit-learn, as arrays.

    Raises ImportError with the way out where scikit-learn is not installed.
    """
    try:
        from sklearn.ensemble import HistGradientBoostingClassifier
    except ImportError as error:
        raise ImportError("training the segmenter needs scikit-learn: pip install 'pecgrasp[segmenter]'") from error
    features, so, weight = found.arrays()
    model = HistGradientBoostingClassifier(
        max_iter=trees,
        max_leaf_nodes=LEAVES,
        learning_rate=RATE,
        min_samples_leaf=LEAST_EXAMPLES,
        l2_regularization=RIDGE,
        early_stopping=False,
        random_state=seed,
    )
    model.fit(features, so, sample_weight=weight / weight.mean())
    return as_arrays([grown[0].nodes for grown in model._predictors], float(np.ravel(model._baseline_prediction)[0]))


def as_arrays(trees: Sequence[NDArray[Any]], baseline: float) -> BoostedTrees:
    """scikit-learn's nodes of each tree as one set of arrays."""
    if not trees:
        nothing, none = np.zeros(1, dtype=np.int32), np.full(1, -1, dtype=np.int32)
        return BoostedTrees(none, np.zeros(1, np.float32), nothing, nothing, nothing, np.zeros(1), nothing, baseline)
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


def share_name(step: str, share: int) -> str:
    """What the examples of a share of the frames are kept by. step: of `STEPS`."""
    return f"{step}_{share:05d}"


def train(
    shares: Sequence[Callable[[], Iterable[NumberedFrame]]], kept: KeptExamples, about: dict[str, Any], seed: int
) -> Relations:
    """Trees for pairs of all frames, for pairs of the parts that the trees of one half of the frames make of the other,
    and for groups likewise.

    shares: of the frames, each called once for each of `STEPS`, and not where `kept` has what it gives.
    """
    halves = [_trees(dict.fromkeys(KINDS, as_arrays([], 0.0)), {})] * 2
    found: dict[str, Examples] = {}
    for step, kinds in STEPS.items():
        for i, frames in enumerate(shares):
            new = kept.examples(share_name(step, i), partial(_examples, step, frames, halves, seed))
            found |= {name: found.get(name, Examples()) + new[name] for name in new}
        if step != "groups":  # nothing is learnt from what is made of them
            halves = [kept.trees(f"{step}_{i}", partial(_half, i, kinds, found, halves[i], seed)) for i in (0, 1)]

    def all_trees() -> Relations:
        return _trees({name: fit_trees(found[f"{name}_0"] + found[f"{name}_1"], seed) for name in KINDS}, about)

    return kept.trees("all", all_trees)


def _trees(of_kinds: Mapping[str, BoostedTrees], about: dict[str, Any]) -> Relations:
    return Relations(**{name: of_kinds[name] for name in KINDS}, about=about)


def _half(number: int, kinds: Sequence[str], found: Mapping[str, Examples], known: Relations, seed: int) -> Relations:
    """The trees that are known, and those of further kinds for one half of the frames."""
    grown: dict[str, Any] = {name: fit_trees(found[f"{name}_{number}"], seed, TREES_OF_HALF) for name in kinds}
    return replace(known, **grown)


def _examples(
    step: str, frames: Callable[[], Iterable[NumberedFrame]], halves: Sequence[Relations], seed: int
) -> dict[str, Examples]:
    """What a step asks for, of frames of even (_0) and of odd numbers (_1), by the trees of the other half."""
    found = {f"{name}_{half}": Examples() for name in STEPS[step] for half in (0, 1)}
    for number, cut in cut_frames(frames(), WITHOUT_TABLE, WITH_BARS, seed):
        one, other = (found[f"{name}_{number % 2}"] for name in STEPS[step])
        trees = halves[1 - number % 2]
        if step == "pairs":
            add_pairs(cut, one, other)
        elif step == "parts":
            add_pairs_again(cut, trees.near, trees.far, (one, other))
        else:
            add_groups(cut, trees, one, other)
    return found
