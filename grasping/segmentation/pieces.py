"""What of an image hangs together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grasping.segmentation import kernels


def label_pieces(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Labels (h, w) from 1 up of what is connected along rows and columns, in the order of first pixels; their number.

    SciPy's `ndimage.label` gives the same.
    """
    labels = np.empty(mask.shape, dtype=np.int32)
    if kernels.compiled is not None:
        return labels, kernels.compiled.label_pieces(np.ascontiguousarray(mask), labels)
    return labels, ndimage.label(mask, output=labels)
