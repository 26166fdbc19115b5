"""Fits the witness of forms (`pec.known.form_witness`) on the training clouds, each in several damaged copies."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import nn

from pec.data.augment import Augment, augment
from pec.data.tensor_dataset import PreparedClouds
from pec.known.form_witness import FormWitness, form_numbers
from pec.training.schedule import warm_cosine

__all__ = ["fit_witness", "network_weight", "numbers_of"]

_MEMBERS = 3
_WIDTH = 160
_DROPOUT = 0.3
_COPIES = 3  # of each cloud, damaged, beside itself
_BATCH, _PASSES, _MOST_STEPS = 128, 40, 6000
_RATE, _DECAY, _SMOOTHING = 0.002, 0.01, 0.1
_NOISE = 0.05  # standard deviation that is added to each standardised number
_TOGETHER = 1024  # clouds that are damaged at once: bounds memory
_MOST_WEIGHT = 4.0
_EQUAL = 1.0  # strength of the belief that both witnesses are worth the same, against the things that are looked at


def numbers_of(candidates: torch.Tensor, valid: torch.Tensor) -> np.ndarray:
    """(B, 115) numbers of clouds of candidates (B, K, 3), of which those count that are `valid` (B, K)."""
    pairs = zip(candidates.cpu().numpy(), valid.cpu().numpy(), strict=True)
    return form_numbers([points[there] for points, there in pairs])


def fit_witness(training: PreparedClouds, n_outputs: int, damage: Augment, seed: int = 0) -> FormWitness:
    """The witness of clouds whose labels are below `n_outputs`; `damage` is what training's clouds go through."""
    generator = torch.Generator().manual_seed(seed)
    parts, labels = [], []
    for copy in range(1 + _COPIES):
        for begin in range(0, len(training), _TOGETHER):
            block = training.subset(torch.arange(begin, min(begin + _TOGETHER, len(training)))).to(torch.device("cpu"))
            points, valid = block.candidates, block.valid
            if copy:
                points, valid = augment(points, valid, damage, generator)
            enough = valid.sum(dim=1) > 1
            parts.append(numbers_of(points[enough], valid[enough]))
            labels.append(block.labels[enough])
    numbers, truth = np.concatenate(parts), torch.cat(labels)
    mean, unit = numbers.mean(axis=0), numbers.std(axis=0) + 1e-3
    inputs = torch.from_numpy(((numbers - mean) / unit).clip(-5, 5).astype(np.float32))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        members = [_trained(inputs, truth, n_outputs, generator) for _ in range(_MEMBERS)]
    layers = {}
    for number in (1, 2, 3):
        linear = [[layer for layer in member if isinstance(layer, nn.Linear)][number - 1] for member in members]
        weights = np.stack([layer.weight.detach().numpy().T for layer in linear])
        layers[f"weights_{number}"] = np.ascontiguousarray(weights)  # as read from a file: sums in the same order
        layers[f"bias_{number}"] = np.stack([layer.bias.detach().numpy()[None] for layer in linear])
    return FormWitness(mean.astype(np.float32), unit.astype(np.float32), **layers)


def network_weight(by_network: np.ndarray, by_form: np.ndarray, labels: np.ndarray, things: np.ndarray) -> float:
    """How much the network's log probabilities (n, O) count beside the witness's (n, O), in [0, 4].

    The weights of both that make the true labels (n,) likeliest, of which only the ratio matters where a temperature
    follows. Each of the things (n,) counts once. One witness may be far behind: a network after few steps.
    """
    from scipy.optimize import minimize  # slow to import, and only training fits

    _, place, counts = np.unique(things, return_inverse=True, return_counts=True)
    share = 1 / counts[place.reshape(-1)]
    said = np.stack([by_network, by_form])
    true = said[:, np.arange(len(labels)), labels]

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        joined = np.tensordot(weights, said, 1)
        joined -= joined.max(axis=1, keepdims=True)
        shares = np.exp(joined)
        total = shares.sum(axis=1, keepdims=True)
        value = (share * (np.log(total[:, 0]) - joined[np.arange(len(labels)), labels])).sum()
        slope = (share * ((said * (shares / total)).sum(axis=2) - true)).sum(axis=1)
        apart = weights[0] - weights[1]
        return value + 0.5 * _EQUAL * apart**2, slope + _EQUAL * apart * np.array([1.0, -1.0])

    network, form = minimize(loss, np.ones(2), jac=True, method="L-BFGS-B", bounds=[(0.0, _MOST_WEIGHT)] * 2).x
    return float(min(network / max(form, 1e-3), _MOST_WEIGHT))


def _trained(inputs: torch.Tensor, labels: torch.Tensor, n_outputs: int, generator: torch.Generator) -> nn.Sequential:
    network = nn.Sequential(
        nn.Linear(inputs.shape[1], _WIDTH),
        nn.ReLU(),
        nn.Dropout(_DROPOUT),
        nn.Linear(_WIDTH, _WIDTH),
        nn.ReLU(),
        nn.Dropout(_DROPOUT),
        nn.Linear(_WIDTH, n_outputs),
    )
    optimizer = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY, fused=True)
    n_steps = min(math.ceil(_PASSES * len(inputs) / _BATCH), _MOST_STEPS)
    for step in range(n_steps):
        for group in optimizer.param_groups:
            group["lr"] = warm_cosine(_RATE, step / n_steps)
        index = torch.randint(len(inputs), (_BATCH,), generator=generator)
        noisy = inputs[index] + _NOISE * torch.randn(_BATCH, inputs.shape[1], generator=generator)
        loss = nn.functional.cross_entropy(network(noisy), labels[index], label_smoothing=_SMOOTHING)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
    return network.eval()
