"""A small first data set: what a network is in training it is when evaluated, or its user is told."""

import pytest
import torch
from torch import nn

from pec.errors import ConfigError
from pec.training.config import read_config
from pec.training.doubts import doubts, witness_doubts
from pec.training.loop import train
from pec.training.running_statistics import without_their_start


def test_statistics_are_the_weighted_means_of_what_was_seen_and_of_nothing_else():
    norm = nn.BatchNorm1d(2).double()
    batches = 0.01 * torch.randn(5, 8, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64) + 0.3
    with without_their_start(norm):
        for batch in batches[:3]:
            norm(batch)
    with without_their_start(norm):  # an interrupted run goes on
        for batch in batches[3:]:
            norm(batch)
    weights = 0.9 ** torch.arange(4, -1, -1, dtype=torch.float64)[:, None] / (0.9 ** torch.arange(5)).sum()
    torch.testing.assert_close(norm.running_mean, (weights * batches.mean(dim=1)).sum(dim=0))
    torch.testing.assert_close(norm.running_var, (weights * batches.var(dim=1)).sum(dim=0))
    assert norm.momentum == 0.1
    assert not norm._forward_pre_hooks


def test_what_is_evaluated_in_between_changes_nothing():
    norm = nn.Sequential(nn.BatchNorm1d(2))
    with without_their_start(norm):
        norm(torch.randn(8, 2))
        mean = norm[0].running_mean.clone()
        norm.eval()(torch.randn(8, 2) + 5)
    assert norm[0].running_mean.equal(mean)


@pytest.mark.parametrize("statistics", ["corrected", "torch"])
def test_few_steps_on_few_clouds_are_evaluated_as_they_were_trained(shapes, tmp_path, statistics):
    settings = {
        "dataset": {"path": str(shapes), "samples_per_instance": 12},
        "output": str(tmp_path),
        "augment": {},
        # A step an epoch.
        "protocol": {
            "epochs": 25,
            "learning_rate": 0.005,
            "running_statistics": statistics,
            "made_strangers": 0.0,
            "precision": "float32",  # auto is what is faster in that minute, and other weights
            "surface_forms": False,  # what the network alone says
        },
        "progress": False,
    }
    results = train(settings)
    in_training, evaluated = results["curves"]["train_accuracy"][-1], results["last"]["train_accuracy"]
    assert results["n_samples"]["train"] < 60
    assert in_training > 0.9
    if statistics == "corrected":
        assert evaluated > in_training - 0.1
        assert results["best"]["test_accuracy"] > 0.9
        assert [w for w in results["warnings"] if "threshold of the unknown" not in w] == []
    else:
        assert evaluated < in_training - 0.2  # as published, which is why there is a choice
        assert "protocol.running_statistics=corrected" in results["warnings"][0]


@pytest.mark.parametrize(
    ("in_training", "train", "unseen", "said"),
    [
        (1.0, 0.5, 0.5, "of its training clouds the best checkpoint answers 50% right, where it was 100% in training"),
        (0.95, 1.0, 0.3, "of clouds that it has not seen the best checkpoint answers 30% right"),
        (0.95, 0.97, 0.8, None),
        (0.3, 0.25, 0.25, None),  # in training, too, it has learnt nothing
    ],
)
def test_chance_where_there_was_learning_is_said(in_training, train, unseen, said):
    config = read_config({"dataset": {"path": "x"}, "output": "y"})
    best = {"epoch": 1, "train_accuracy": train, "selection_accuracy": unseen, "test_accuracy": unseen}
    sentences = doubts(config, torch.arange(4).repeat(10), [0.2, in_training], best)
    assert len(sentences) == (said is not None)
    assert all(sentence.startswith(said) and "protocol.running" not in sentence for sentence in sentences)


def test_a_network_that_is_worth_nothing_beside_the_witness_is_said():
    (sentence,) = witness_doubts({"network_weight": 0.0})
    assert "network_weight 0.00" in sentence
    assert witness_doubts({"network_weight": 0.31}) == witness_doubts({}) == []  # without a witness there is no weight


def test_one_cloud_at_a_time_is_refused():
    with pytest.raises(ConfigError, match=r"protocol\.batch_size must be 2 at least, got 1"):
        read_config({"dataset": {"path": "x"}, "output": "y", "protocol": {"batch_size": 1}})
