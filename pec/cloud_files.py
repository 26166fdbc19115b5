"""Read a cloud from a file: .npy, .ply and .pcd, as depth cameras' tools write them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from pec.errors import CloudError

__all__ = ["read_cloud"]

_PLY_TYPES = {
    **{
        "char": "i1",
        "uchar": "u1",
        "short": "i2",
        "ushort": "u2",
        "int": "i4",
        "uint": "u4",
        "float": "f4",
        "double": "f8",
    },
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float32": "f4", "float64": "f8"},
}


def read_cloud(path: str | os.PathLike[str]) -> np.ndarray:
    """The finite points (N, 3) float32 of a file, in its own units and frame.

    .npy holds (N, 3) or organised (H, W, 3); .ply its vertices (ASCII or binary); .pcd x, y, z (ASCII or binary, not
    compressed). Points with a coordinate that is not finite are what a depth camera missed, and are left out.
    Raises FileNotFoundError, or CloudError where the file is of another kind or broken.
    """
    path = Path(path)
    readers = {".npy": _read_npy, ".ply": _read_ply, ".pcd": _read_pcd}
    if path.suffix.lower() not in readers:
        raise CloudError(
            f"{path}: a cloud is read from {', '.join(readers)}, not {path.suffix or 'a file without suffix'}"
        )
    if not path.is_file():
        raise FileNotFoundError(f"cloud {path} does not exist")
    try:
        points = readers[path.suffix.lower()](path)
    except (ValueError, IndexError, KeyError, UnicodeDecodeError) as error:
        raise CloudError(f"{path} is not a readable {path.suffix} cloud: {error}") from error
    return points[np.isfinite(points).all(axis=1)]


def _read_npy(path: Path) -> np.ndarray:
    array = np.load(path, allow_pickle=False)
    if array.ndim not in (2, 3) or array.shape[-1] != 3:
        raise ValueError(f"expected shape (N, 3) or (H, W, 3), found {array.shape}")
    return array.reshape(-1, 3).astype(np.float32)


def _read_ply(path: Path) -> np.ndarray:
    header, body = _split_header(path.read_bytes(), b"end_header")
    if header[0] != ["ply"]:
        raise ValueError("it does not begin with 'ply'")
    kind, n, element = "", 0, ""
    fields: list[tuple[str, str]] = []
    for words in header:
        if words[0] == "format":
            kind = words[1]
        elif words[0] == "element":
            if words[1] == "vertex":
                n = int(words[2])
            elif not fields:
                raise ValueError(f"element {words[1]!r} comes before the vertices")
            element = words[1]
        elif words[0] == "property" and element == "vertex":
            fields.append((words[2], _PLY_TYPES[words[1]]))
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    return _xyz(body, n, [(name, order + code) for name, code in fields], ascii_text=kind == "ascii")


def _read_pcd(path: Path) -> np.ndarray:
    header, body = _split_header(path.read_bytes(), b"DATA")
    values = {words[0]: words[1:] for words in header if words}
    kind = values["DATA"][0]
    if kind not in ("ascii", "binary"):
        raise ValueError(f"DATA {kind} is not supported; convert it to binary")
    counts = values.get("COUNT", ["1"] * len(values["FIELDS"]))
    code = {"F": "f", "I": "i", "U": "u"}
    fields: list[tuple[str, str]] = []
    for name, letter, size, count in zip(values["FIELDS"], values["TYPE"], values["SIZE"], counts, strict=True):
        # Padding fields repeat a name or hold several values: every column needs a name of its own.
        fields += [
            (name if name in "xyz" and count == "1" else f"{name}_{len(fields) + i}", f"<{code[letter]}{size}")
            for i in range(int(count))
        ]
    return _xyz(body, int(values["POINTS"][0]), fields, ascii_text=kind == "ascii")


def _split_header(data: bytes, last: bytes) -> tuple[list[list[str]], bytes]:
    """The words of each header line up to the one that begins with `last`, and the bytes after it."""
    header: list[list[str]] = []
    begin = 0
    while begin < len(data):
        end = data.index(b"\n", begin)
        line = data[begin:end].strip()
        begin = end + 1
        if line:
            header.append(line.decode("ascii").split())
        if line.startswith(last):
            return header, data[begin:]
    raise ValueError(f"its header has no {last.decode()}")


def _xyz(body: bytes, n: int, fields: list[tuple[str, str]], *, ascii_text: bool) -> np.ndarray:
    if ascii_text:
        names = [name for name, _ in fields]
        rows = [line.split() for line in body.decode("ascii").splitlines() if line.strip()][:n]
        if len(rows) < n:
            raise ValueError(f"it promises {n} points and holds {len(rows)}")
        return np.array([[row[names.index(axis)] for axis in "xyz"] for row in rows], np.float32).reshape(-1, 3)
    points = np.frombuffer(body, np.dtype(fields), count=n)
    return np.stack([points[axis].astype(np.float32) for axis in "xyz"], axis=1)
