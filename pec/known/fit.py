"""Fits what tells the known from strangers, at the end of training: on clouds of things that were not trained on."""

from __future__ import annotations

import numpy as np

from pec.known.evidence import SCORES, Answers, Prototypes, log_size, scores
from pec.known.knowing import logistic

__all__ = ["find_prototypes", "fit_known", "known_of_unseen"]

_PROTOTYPES = 32  # of a class
_ROUNDS = 20
_FOLDS = 5
_SHRINKAGE = 0.1  # of a covariance, towards a multiple of the identity
_SIZE_FLOOR = 0.05  # standard deviation of a log spread that even instances all alike are granted
# Strength of the ridge on each weight. What the network says of strangers is judged on the kinds that it learnt from,
# and better there than on others: it is to convince more. With 10, strangers of other kinds and what is cut wrongly out
# of heaps are told less well.
_RIDGE = np.array([3.0 if name == "none of these" else 1.0 for name in SCORES])


def find_prototypes(answers: Answers, labels: np.ndarray, seed: int = 0) -> Prototypes:
    """Of the training clouds (n,) of the known classes; every class has one at least."""
    rng = np.random.default_rng(seed)
    of_class = [labels == label for label in range(answers.n_classes)]
    centres = np.stack([answers.features[mine].mean(axis=0) for mine in of_class])
    metric = _whitening(answers.features - centres[labels])
    features = answers.features @ metric
    mean = answers.descriptors.mean(axis=0)
    deviation = answers.descriptors.std(axis=0) + 1e-6
    shapes = (answers.descriptors - mean) / deviation
    sizes = log_size(answers.descriptors)
    floor = _SIZE_FLOOR**2 * np.eye(sizes.shape[1])
    return Prototypes(
        metric,
        np.stack([_clustered(features[mine], rng) for mine in of_class]),
        mean,
        deviation,
        np.stack([_clustered(shapes[mine], rng) for mine in of_class]),
        np.stack([sizes[mine].mean(axis=0) for mine in of_class]),
        np.stack([np.linalg.inv(_covariance(sizes[mine]) + floor) for mine in of_class]),
    )


def fit_known(
    prototypes: Prototypes, answers: Answers, stranger: np.ndarray, instances: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Centre, unit, weights and bias of the logistic model (`Knowing`).

    Of clouds (n,) of which `stranger` (n,) bool are none of the classes, some and not all. instances (n,): each counts
    once, however many clouds it has, and strangers as much as known things.
    """
    from scipy.optimize import minimize  # slow to import, and only training fits

    values = scores(answers, prototypes)
    centre, unit = values[~stranger].mean(axis=0), values[~stranger].std(axis=0) + 1e-3
    standard = (values - centre) / unit
    _, place, counts = np.unique(instances, return_inverse=True, return_counts=True)
    share = 1 / counts[place.reshape(-1)]
    share = np.where(stranger, share / share[stranger].sum(), share / share[~stranger].sum()) * len(counts) / 2
    sign = np.where(stranger, -1.0, 1.0)

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        weights, bias = parameters[:-1], parameters[-1]
        margin = sign * (standard @ weights + bias)
        slope = -share * sign / (1 + np.exp(np.clip(margin, -50, 50)))
        value = (share * np.logaddexp(0, -margin)).sum() + 0.5 * (_RIDGE * weights**2).sum()
        return value, np.append(standard.T @ slope + _RIDGE * weights, slope.sum())

    bounds = [(None, 0.0)] * len(SCORES) + [(None, None)]
    found = minimize(loss, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=bounds).x
    return centre, unit, found[:-1], float(found[-1])


def known_of_unseen(
    prototypes: Prototypes, answers: Answers, stranger: np.ndarray, things: np.ndarray, seed: int = 0
) -> np.ndarray:
    """(k,) probabilities of the known of clouds (n,), in their order, each by a model fitted without its thing.

    A model is surer of the things that it was fitted on than of others: a threshold on these refuses too many. stranger
    as in `fit_known`; things (n,): what is on one side of a fold. Of a single known thing, or a single stranger, there
    are no folds, and the model has seen it.
    """
    rng = np.random.default_rng(seed)
    fold = np.empty(len(stranger), np.int64)
    n_folds = _FOLDS
    for side in (stranger, ~stranger):
        names, place = np.unique(things[side], return_inverse=True)
        n_folds = min(n_folds, len(names))
        fold[side] = rng.permutation(len(names))[place.reshape(-1)]
    fold %= n_folds
    known = np.empty(len(stranger))
    for number in range(n_folds):
        left_out = fold == number
        rest = np.flatnonzero(~left_out if n_folds > 1 else left_out)
        model = fit_known(prototypes, answers[rest], stranger[rest], things[rest])
        known[left_out] = logistic(scores(answers[left_out], prototypes), *model)
    return known[~stranger]


def _whitening(residuals: np.ndarray) -> np.ndarray:
    """(F, F) W such that residuals (n, F) times W have covariance 1, but for the shrinkage; √F makes it of any F."""
    covariance = _covariance(residuals)
    n = len(covariance)
    level = np.trace(covariance) / n + 1e-12
    values, vectors = np.linalg.eigh((1 - _SHRINKAGE) * covariance + _SHRINKAGE * level * np.eye(n))
    return vectors / np.sqrt(values * n)


def _covariance(values: np.ndarray) -> np.ndarray:
    centred = values - values.mean(axis=0)
    return centred.T @ centred / max(len(values) - 1, 1)


def _clustered(vectors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(32, D) means of clusters of vectors (n, D); where there are fewer, the vectors, some of them twice."""
    if len(vectors) <= _PROTOTYPES:
        return np.resize(vectors, (_PROTOTYPES, vectors.shape[1]))
    means = vectors[rng.choice(len(vectors), _PROTOTYPES, replace=False)]
    for _ in range(_ROUNDS):  # Lloyd's algorithm; a cluster that is left empty stays where it was
        away = np.square(means).sum(axis=1) - 2 * vectors @ means.T
        member = np.eye(_PROTOTYPES)[away.argmin(axis=1)]
        counts = member.sum(axis=0)[:, None]
        means = np.where(counts > 0, member.T @ vectors / np.maximum(counts, 1), means)
    return means
