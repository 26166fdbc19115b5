"""One epoch of pose training: a pass of gradient descent, every draw of which comes from (seed, epoch)."""

from __future__ import annotations

import math

import torch

from pec.pose.clouds import PosedClouds, network_inputs
from pec.pose.config import PoseProtocol, PoseTrainConfig
from pec.pose.distance import PoseDistance
from pec.pose.hypotheses import Hypotheses, hypotheses
from pec.pose.network import PoseNetwork
from pec.training.schedule import warm_cosine
from pec.training.step import take_step

__all__ = ["pose_loss", "run_epoch"]


def run_epoch(
    config: PoseTrainConfig,
    network: PoseNetwork,
    optimizer: torch.optim.Optimizer,
    distance: PoseDistance,
    training: PosedClouds,
    epoch: int,
) -> tuple[float, float]:
    """Train by one pass, the `epoch`-th from 0; returns the mean loss and the last learning rate.

    Raises TrainingError where the loss is not finite.
    """
    protocol = config.protocol
    generator = torch.Generator().manual_seed(config.seed * 1_000_003 + epoch)
    device = training.points.device
    n_steps = math.ceil(len(training) / protocol.batch_size)
    order = torch.randperm(len(training), generator=generator).to(device)
    total, rate = 0.0, protocol.learning_rate
    network.train()
    for step, index in enumerate(order.tensor_split(n_steps)):
        rate = warm_cosine(protocol.learning_rate, (epoch * n_steps + step) / (protocol.epochs * n_steps))
        model, truth = training.model[index], training.T_camera_object[index]
        points = network_inputs(training.points[index], config.augment, config.network.n_points, generator)
        turn = torch.rand(len(index), generator=generator).to(device)
        said = hypotheses(network, distance, points, model, turn)
        loss = pose_loss(said, distance(said.centre, said.rotation, truth, model), protocol)
        total += take_step(optimizer, loss, rate, epoch) * len(index)
    return total / len(training), rate


def pose_loss(said: Hypotheses, gap: torch.Tensor, protocol: PoseProtocol) -> torch.Tensor:
    """Of hypotheses with distances (B, K) from the truth: the nearest one's, and how far off each was expected to be.

    All hypotheses for a small share, as Rupprecht et al., "Learning in an Uncertain World", ICCV 2017.
    """
    surprise = torch.nn.functional.smooth_l1_loss(said.expected, gap.detach(), beta=0.1)
    distance = (1 - protocol.spread) * gap.amin(dim=1).mean() + protocol.spread * gap.mean()
    return distance + protocol.confidence * surprise
