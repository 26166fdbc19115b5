"""What a finished run should make its user doubt: answers near chance from a network that had learnt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from pec.training.config import TrainConfig

__all__ = ["doubts", "threshold_doubts", "witness_doubts"]

_LEARNT = 0.3  # of the way from chance to all right
_COUNTS = 0.05  # as log probabilities beside the other witness's
_EVALUATED, _UNSEEN = (
    0.67,
    0.25,
)  # of what was learnt, that must be left on the clouds it was learnt from, and on others


def doubts(
    config: TrainConfig, labels: torch.Tensor, in_training: Sequence[float], best: Mapping[str, Any]
) -> list[str]:
    """Sentences that say what is doubtful and the way out; none where nothing is.

    labels: (n,) of the training clouds. in_training: accuracy in training, an epoch each. best: the checkpoint's part
    of results.json, with `epoch`, `train_accuracy`, `selection_accuracy` and `test_accuracy` in [0, 1].
    """
    chance = labels.bincount().max().item() / len(labels)
    learnt = max(in_training[-1], in_training[best["epoch"] - 1])
    evaluated = best["train_accuracy"]
    if learnt - chance > _LEARNT * (1 - chance) and evaluated - chance < _EVALUATED * (learnt - chance):
        way_out = "a smaller protocol.batch_size or more protocol.epochs: it needs more steps"
        if config.protocol.running_statistics == "torch":
            way_out = f"protocol.running_statistics=corrected (not as published), or {way_out}"
        return [
            f"of its training clouds the best checkpoint answers {evaluated:.0%} right, where it was {learnt:.0%} in "
            f"training and guessing gives {chance:.0%}: batch norm's running statistics do not fit the weights. "
            f"Way out: {way_out}"
        ]
    unseen = max(best["selection_accuracy"], best["test_accuracy"])
    if evaluated - chance > _LEARNT * (1 - chance) and unseen - chance < _UNSEEN * (evaluated - chance):
        return [
            f"of clouds that it has not seen the best checkpoint answers {unseen:.0%} right, of its training clouds "
            f"{evaluated:.0%}, and guessing gives {chance:.0%}: it knows those by heart, or the others are unlike "
            "them. Way out: more objects a class (instances_per_class) and more clouds of each, augment=tabletop"
        ]
    return []


def witness_doubts(best: Mapping[str, Any]) -> list[str]:
    """A sentence where the witness of forms answers nearly alone. best: the checkpoint's part of results.json."""
    weight = best.get("network_weight", 1.0)
    if weight >= _COUNTS:
        return []
    return [
        "what the network says of things that it has not seen is worth nothing beside the witness of forms "
        f"(network_weight {weight:.2f}), which answers nearly alone: it learnt nothing, or needs more steps. Way out: "
        "another seed, a larger protocol.batch_size, more protocol.epochs"
    ]


def threshold_doubts(seen: Sequence[str]) -> list[str]:
    """A sentence where the threshold of the unknown rests, for the classes `seen`, on instances that training sees."""
    if not seen:
        return []
    return [
        f"the threshold of the unknown rests on instances that training sees, of {', '.join(seen)}: others may be "
        "refused more often than one time in twenty. Way out: four instances a class, or more"
    ]
