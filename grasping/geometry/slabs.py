"""An object's own axes, and the slabs and clusters into which it is cut along the long one."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Rest = Literal["both ends", "lower end", "last slab"]


def slab_of(y: FloatArray, height: float, rest: Rest) -> IntArray:
    """Cut along y (N,) downward into int(H / height) slabs of this height: the slab (N,) of each point, -1 for none.

    rest: where what is left of H lies: at "both ends", half at each, or at the "lower end", in no slab; or as the
    "last slab", which is less high.
    """
    extent = y.max() - y.min()
    whole = int(extent / height)
    above = 0.5 * (extent - whole * height) if rest == "both ends" else 0.0
    order = np.floor((y.max() - above - y) / height).astype(np.int64)
    return np.where(order < whole + (rest == "last slab"), np.maximum(order, -1), -1)
