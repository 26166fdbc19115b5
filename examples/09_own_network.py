"""Your own network in one file: any torch module made by Class(n_points, n_classes), trained beside the others.

    python examples/09_own_network.py DATASET OUTPUT

trains it for three epochs. The same by the command, for which a network goes by its dotted name:

    export PYTHONPATH=examples            # the folder of your file
    pecgrasp train dataset.path=DATASET model.name=09_own_network.TinyNet preprocess=none output=tiny
    pecgrasp classify cloud=FILE checkpoint=tiny/best
"""

import sys

import torch
from torch import nn


class TinyNet(nn.Module):
    """The same small layers for each point, and the greatest answer over all points: no order is needed."""

    def __init__(self, n_points: int, n_classes: int) -> None:
        super().__init__()
        self.each_point = nn.Sequential(nn.Linear(3, 64), nn.ReLU(), nn.Linear(64, 128), nn.ReLU())
        self.head = nn.Linear(128, n_classes)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) centred points, m → (B, n_classes) logits."""
        return self.head(self.each_point(10 * points).amax(dim=1))


if __name__ == "__main__":
    from pec import Classifier
    from pec.training import train

    dataset, output = sys.argv[1:]
    settings = {
        "dataset": {"path": dataset},
        "output": output,
        "model": {"name": "09_own_network.TinyNet"},
        "preprocess": {"ordering": "none"},
        "protocol": {"epochs": 3},
        "progress": False,
    }
    results = train(settings)
    print(f"{results['parameters']} parameters, test accuracy {100 * results['best']['test_accuracy']:.0f} %")
    print(f"a classifier of {', '.join(Classifier.load(results['checkpoint']).classes)}: {results['checkpoint']}")
