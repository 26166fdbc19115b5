"""A small picture of a cloud for a page."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from pecgrasp_env.common.html_report import data_uri

__all__ = ["cloud_image"]

_SIDE = 112  # pixels of an image
_NEAR, _FAR = np.array([8, 126, 164]), np.array([168, 196, 206])  # to be seen on white and on black


def cloud_image(points: np.ndarray) -> str:
    """A cloud (N, 3) of the camera frame in perspective, shaded by depth, as the address of a transparent PNG."""
    flat = points[:, :2] / points[:, 2:]
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = max(float((high - low).max()), 1e-9)
    at = ((flat - (low + high) / 2) / size * (_SIDE - 12) + _SIDE / 2).astype(int)
    depth = points[:, 2]
    far = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
    image = np.zeros((_SIDE, _SIDE, 4), np.uint8)
    reach = int(np.clip(np.ceil(0.5 * _SIDE / np.sqrt(len(points))), 1, 6))  # few points are drawn larger
    for index in np.argsort(-depth):  # near ones over far ones
        column, row = at[index]
        area = image[max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach]
        area[...] = (*(_NEAR + far[index] * (_FAR - _NEAR)).astype(int), 255)
    buffer = io.BytesIO()
    Image.fromarray(image).quantize(32).save(buffer, "PNG", optimize=True)
    return data_uri(buffer.getvalue(), "png")
