"""Errors that a caller can act on: each message names the argument and the value that is wrong."""

import lzma
import math
import zipfile
import zlib

DAMAGED_ZIP = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError, RuntimeError, ValueError)
"""What reading a .zip raises where it is gone, cut short or overwritten in places."""
DAMAGED_NPZ = (*DAMAGED_ZIP, KeyError, IndexError, TypeError, SyntaxError, AttributeError)
"""Likewise a .npz, whose headers NumPy evaluates as Python literals, or one that holds other arrays, or is an .npy."""


class CloudError(ValueError):
    """A point cloud that cannot be used: wrong shape, not finite, too few points, not in metres."""


class ModelError(ValueError):
    """A mesh that cannot be the model of an object: not readable, no volume, another unit, there twice."""


class ConfigError(ValueError):
    """A parameter that makes no sense: names it and its value."""


def require_between(name: str, value: float, least: float, most: float) -> None:
    """Raises ConfigError where the parameter is not a finite number from `least` to `most`, both included."""
    if not (math.isfinite(value) and least <= value <= most):
        raise ConfigError(f"{name} = {value!r} must be between {least:g} and {most:g}")
