"""A depth image in colours, for people."""

from __future__ import annotations

import numpy as np

# Near is bright: dark blue, teal, yellow.
_RAMP = np.array([[252, 231, 96], [74, 193, 150], [38, 120, 142], [48, 54, 110], [30, 18, 52]], float)


def depth_picture(depth: np.ndarray) -> np.ndarray:
    """(h, w) metres → (h, w, 3) uint8; near is bright, no measurement is black."""
    seen = depth > 0
    if not seen.any():
        return np.zeros((*depth.shape, 3), np.uint8)
    near, far = np.percentile(depth[seen], [1, 99])
    share = np.clip((depth - near) / max(far - near, 1e-6), 0, 1)
    steps = np.linspace(0, 1, len(_RAMP))
    colours = np.stack([np.interp(share, steps, _RAMP[:, k]) for k in range(3)], axis=-1)
    return np.where(seen[..., None], colours, 0).astype(np.uint8)
