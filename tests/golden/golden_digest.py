"""From a value to its digest."""

from __future__ import annotations

import hashlib
import multiprocessing
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

Values = Iterator[tuple[str, Any]]
"""Names of cases and what came out, of which a digest is taken."""


def digest(value: Any) -> str:
    """SHA-256 of a value's content to the last bit: types by kind, arrays by type, shape and bytes."""
    sha = hashlib.sha256()
    for part in _parts(value):
        sha.update(part)
    return sha.hexdigest()


def in_a_fresh_process(item: Callable[..., Values], *args: Any) -> Values:
    """Each case's digest, made in a process of its own, in which nothing else was simulated before."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        yield from pool.submit(_digests, item, *args).result()


def _digests(item: Callable[..., Values], *args: Any) -> list[tuple[str, str]]:
    return [(case, digest(value)) for case, value in item(*args)]


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.generic):
        value = value.item()
    if hasattr(value, "detach"):  # a tensor
        value = value.detach().cpu().numpy()
    if isinstance(value, np.ndarray) and value.dtype == object:
        value = value.tolist()  # its bytes are addresses
    if isinstance(value, np.ndarray):
        yield f"array {value.dtype.str} {value.shape} ".encode() + np.ascontiguousarray(value).tobytes()
    elif isinstance(value, float):
        yield b"float " + struct.pack("<d", value)
    elif isinstance(value, bytes):
        yield f"bytes {len(value)} ".encode() + value
    elif value is None or isinstance(value, bool | int | str):
        yield f"{type(value).__name__} {value!r} ".encode()
    elif is_dataclass(value):
        yield from _parts({field.name: getattr(value, field.name) for field in fields(value)})
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)} ".encode()
        for key, each in value.items():
            yield from _parts(key)
            yield from _parts(each)
    elif isinstance(value, Sequence):
        yield f"sequence {len(value)} ".encode()
        for each in value:
            yield from _parts(each)
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")
