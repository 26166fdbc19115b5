"""What a depth camera loses of dark and shiny surfaces: whole regions of them, not single pixels.

On real tables a stapler kept 52 % of its pixels and a can 64 %; most things keep nearly all of theirs.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.special import ndtri

__all__ = ["draw_losses", "lost_regions", "smooth_normal"]


def draw_losses(count: int, rng: np.random.Generator) -> np.ndarray:
    """(count,) float32, of each surface the share that is lost: of one in six about half, of one in four a little."""
    fate = rng.random(count)
    much, little = rng.uniform(0.2, 0.7, count), rng.uniform(0.01, 0.15, count)
    return np.where(fate < 0.16, much, np.where(fate < 0.4, little, 0.0)).astype(np.float32)


def lost_regions(chance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(H, W) bool: regions some ten pixels wide in which pixels are lost, each with its `chance` (H, W), 0 … 1."""
    field = (smooth_normal(chance.shape, rng, 4.0) + 0.5 * smooth_normal(chance.shape, rng, 1.0)) / np.sqrt(1.25)
    return field < ndtri(chance)


def smooth_normal(shape: tuple[int, ...], rng: np.random.Generator, sigma: float) -> np.ndarray:
    """float32, standard normal, correlated as white noise that a Gaussian of `sigma` pixels has smoothed."""
    field = gaussian_filter(rng.standard_normal(shape, np.float32), sigma, mode="wrap", truncate=3.0)
    return field / np.float32(field.std())
