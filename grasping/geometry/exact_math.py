"""Arithmetic that the compiled kernels repeat to the last bit: it decides between places that are equally good.

The functions of the C library, elementwise, as NumPy's own may differ from them in the last bit; and sums from the
first number to the last, as NumPy's order depends on their count.
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


def exp(values: FloatArray) -> FloatArray:
    return _each(math.exp, values)


def total(values: FloatArray) -> float:
    """Sum of (N,) numbers, one after the other; 0 where there are none."""
    return 0.0 + float(np.add.accumulate(values)[-1]) if len(values) else 0.0  # of negative zeros, too, it is 0


def project(cloud: FloatArray, axis: FloatArray) -> FloatArray:
    """Coordinates (N,) of points (3, N) along an axis (3,)."""
    return (axis[0] * cloud[0] + axis[1] * cloud[1]) + axis[2] * cloud[2]
