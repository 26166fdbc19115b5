"""The end of a training run: what tells the known from strangers, fitted on things that were not trained on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from pec.checkpoint import Checkpoint
from pec.data.tensor_dataset import PreparedClouds
from pec.known.enrolled import fit_nearness
from pec.known.evidence import SCORES, Answers, answers_of, described
from pec.known.fit import find_prototypes, fit_known, known_of_unseen
from pec.known.form_witness import form_numbers
from pec.known.knowing import Knowing
from pec.metrics.predictions import arrange_views
from pec.metrics.rejection import UNSEEN_REJECTED, area_under_roc, rejection_threshold
from pec.networks.registry import fast_embed
from pec.training.run_data import RunData

__all__ = ["answers_on", "figures_on_test", "with_knowing"]

_BATCH = 512  # clouds at once: bounds memory, changes no result


def with_knowing(checkpoint: Checkpoint, data: RunData) -> Checkpoint:
    """The checkpoint with `knowing` and the threshold that 95 in 100 clouds of the calibration split's known things
    pass, judged by models that were fitted without them; of fewer than 19 such clouds all do, and an even chance is
    enough."""
    n_known = len(checkpoint.classes)
    trained = data.training.of_known(n_known)
    seen, unseen = answers_on(checkpoint, trained), answers_on(checkpoint, data.calibration)
    prototypes = find_prototypes(seen, trained.labels.cpu().numpy())
    stranger = (data.calibration.labels >= n_known).cpu().numpy()
    instances = data.calibration.instances.cpu().numpy()
    model = fit_known(prototypes, unseen, stranger, instances)
    of_known = known_of_unseen(prototypes, unseen, stranger, data.calibration.things.cpu().numpy())
    threshold = rejection_threshold(torch.from_numpy(of_known), UNSEEN_REJECTED) or min(0.5, of_known.min().item())
    # Rather things that training has not seen; of things that are there once only, whole classes.
    descriptors, things = next(
        (each.descriptors, of_each)
        for each, of_each in (
            (unseen, instances),
            (seen, trained.instances.cpu().numpy()),
            (seen, trained.labels.cpu().numpy()),
        )
        if (np.unique(of_each, return_counts=True)[1] > 1).sum() > 1
    )
    knowing = Knowing(prototypes, *model, fit_nearness(descriptors, things, threshold))
    return replace(checkpoint, knowing=knowing, unknown_below=threshold)


def answers_on(checkpoint: Checkpoint, clouds: PreparedClouds) -> Answers:
    """What the checkpoint's network, on the device of the clouds, says of them as they are."""
    embed = fast_embed(checkpoint.model)
    weight = 1.0 if checkpoint.forms is None else float(checkpoint.forms.network_weight[0])
    parts = []
    for begin in range(0, len(clouds), _BATCH):
        block = clouds.subset(torch.arange(begin, min(begin + _BATCH, len(clouds))))
        views = arrange_views(checkpoint.preprocess, block.candidates, block.valid)
        logits, features = embed(views.flatten(0, 1))
        samples = [
            points[valid]
            for points, valid in zip(block.candidates.cpu().numpy(), block.valid.cpu().numpy(), strict=True)
        ]
        descriptors, n_classes, forms = described(samples), len(checkpoint.classes), checkpoint.forms
        by_form = None if forms is None else forms.log_probabilities(form_numbers(samples, descriptors))
        parts.append(answers_of(logits.cpu(), features.cpu(), descriptors, n_classes, views.shape[1], by_form, weight))
    by_forms = [part.by_form for part in parts if part.by_form is not None]
    return Answers(
        np.concatenate([part.logits for part in parts]),
        np.concatenate([part.features for part in parts]),
        np.concatenate([part.descriptors for part in parts]),
        len(checkpoint.classes),
        np.concatenate(by_forms) if by_forms else None,
        weight,
    )


def figures_on_test(checkpoint: Checkpoint, data: RunData) -> dict[str, Any]:
    """What results.json says of knowing on the test split, once; shares in [0, 1].

    known_weights: of each score, in deviations of the known calibration clouds. test_called_unknown: of the known
    classes. Where the test split has strangers, test_strangers_refused and test_known_auc, the area under the ROC curve
    of known clouds against those.
    """
    assert checkpoint.knowing is not None
    answers = answers_on(checkpoint, data.test)
    known = checkpoint.knowing.known(answers)
    stranger = (data.test.labels >= len(checkpoint.classes)).cpu().numpy()
    below = known < checkpoint.unknown_below
    figures: dict[str, Any] = {
        "unknown_below": checkpoint.unknown_below,
        "known_weights": dict(zip(SCORES, checkpoint.knowing.weights.tolist(), strict=True)),
        "test_called_unknown": float(below[~stranger].mean()),
    }
    if stranger.any():
        figures["test_strangers_refused"] = float(below[stranger].mean())
        figures["test_known_auc"] = area_under_roc(known[~stranger], known[stranger])
    return figures
