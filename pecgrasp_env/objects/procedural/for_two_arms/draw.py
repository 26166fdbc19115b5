"""Draws one of them: the kind by its name, the shape and the weight by a seed."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.model import Draft, ObjectModel, assemble
from pecgrasp_env.objects.procedural.for_two_arms.board import board
from pecgrasp_env.objects.procedural.for_two_arms.crate import crate
from pecgrasp_env.objects.procedural.for_two_arms.long_tool import long_tool

_GENERATORS: dict[str, Callable[[np.random.Generator], Draft]] = {
    "board": board,
    "crate": crate,
    "long_tool": long_tool,
}
KINDS: tuple[str, ...] = tuple(_GENERATORS)


def draw_large(kind: str, seed: int) -> ObjectModel:
    """The instance of a kind that `seed` (>= 0) draws, 1 to 6 kg, of one density: the same shape in every process.

    Raises ObjectError for a kind that there is not, or a negative seed.
    """
    if kind not in _GENERATORS:
        raise ObjectError(f"kind={kind!r}: there are {', '.join(KINDS)}")
    if seed < 0:
        raise ObjectError(f"seed={seed}: must not be negative")
    pieces, mass = _GENERATORS[kind](np.random.default_rng([zlib.crc32(kind.encode()), seed]))
    return assemble(kind, f"{kind}_{seed:04d}", pieces, mass)
