"""The progress bar of a training."""

from __future__ import annotations

from tqdm import tqdm

__all__ = ["epoch_bar"]


def epoch_bar(done: int, epochs: int, *, shown: bool) -> tqdm:
    """Over the epochs that are left, numbered from `done` on."""
    left = range(done, epochs)
    return tqdm(left, desc="training", unit="epoch", initial=done, total=epochs, disable=not shown)
