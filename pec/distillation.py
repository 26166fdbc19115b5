"""Learning from another network's answers: what it makes of an augmented cloud, not the cloud's label, is the target.

A label says "table" of every table; a teacher says which tables could pass for desks. Both see the same points in the
same pose, drawn anew each epoch, so that the student learns the teacher's function and not its answers to a few clouds.

Source: Hinton, Vinyals & Dean, "Distilling the knowledge in a neural network", 2015; the same view for both and no
labels: Beyer et al., "Knowledge distillation: a good teacher is patient and consistent", CVPR 2022.
"""

from __future__ import annotations

import torch

from pec.checkpoint import Checkpoint
from pec.models import fast_forward

__all__ = ["Teacher"]


class Teacher:
    """A trained network with its own way of arranging the points. temperature divides the logits of both."""

    def __init__(self, checkpoint: Checkpoint, temperature: float) -> None:
        self.preprocess, self.temperature = checkpoint.preprocess, temperature
        self._forward = fast_forward(checkpoint.model)

    @torch.no_grad()
    def answers(self, points: torch.Tensor, valid: torch.Tensor, view: torch.Tensor) -> torch.Tensor:
        """(B, n_classes) softened probabilities of candidates (B, K, 3), valid (B, K), in the poses `view` (B,)."""
        inputs = self.preprocess.arrange(points, valid, view)
        return (self._forward(inputs) / self.temperature).softmax(dim=1)

    def loss(self, logits: torch.Tensor, answers: torch.Tensor) -> torch.Tensor:
        """Cross-entropy of softened (B, n_classes) logits against `answers`, times the temperature squared: so the
        gradients keep their size."""
        return torch.nn.functional.cross_entropy(logits / self.temperature, answers) * self.temperature**2
