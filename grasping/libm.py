"""Functions of the C library, elementwise: NumPy's own may differ from them in the last bit.

The compiled kernels call these, and where a value decides between equally good places the last bit matters.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def _each(function: Callable[[float], float], values: FloatArray) -> FloatArray:
    flat = np.fromiter(map(function, values.reshape(-1).tolist()), np.float64, values.size)
    return flat.reshape(values.shape)


def sin(values: FloatArray) -> FloatArray:
    return _each(math.sin, values)


def cos(values: FloatArray) -> FloatArray:
    return _each(math.cos, values)


def arctan(values: FloatArray) -> FloatArray:
    return _each(math.atan, values)


def arccos(values: FloatArray) -> FloatArray:
    return _each(math.acos, values)
