"""Training runs: settings, the loop, and what a finished run leaves."""

from pec.training.loop import train
from pec.training.more_classes import fit

__all__ = ["fit", "train"]
