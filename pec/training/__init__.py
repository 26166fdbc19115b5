"""Training runs: settings, the loop, and what a finished run leaves."""

from pec.training.loop import train

__all__ = ["train"]
