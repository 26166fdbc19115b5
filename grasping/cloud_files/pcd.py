"""The Point Cloud Library's .pcd, version 0.7: ascii, binary and binary_compressed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.cloud_files.text import check_whole, header_lines, line_count, numbers, unmarked, word_lines
from grasping.errors import CloudError

_CODES = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"F": (2, 4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}


def read_pcd(data: bytes) -> NDArray:
    """Fields x, y, z as (N, 3), or (H, W, 3) where HEIGHT is above 1. Raises CloudError."""
    data = unmarked(data)
    header, begin, first_line = _header(data)
    fields = [name.lower() if name in ("X", "Y", "Z") else name for name in header.get("FIELDS", [])]
    if not fields:
        raise CloudError("the header has no FIELDS")
    sizes = _whole_numbers(header, "SIZE", len(fields))
    counts = _whole_numbers(header, "COUNT", len(fields)) if "COUNT" in header else [1] * len(fields)
    types = [letter.upper() for letter in header.get("TYPE", [])]
    if len(types) != len(fields):
        raise CloudError(f"TYPE {' '.join(types)}: {len(fields)} fields need as many types")
    for name, letter, size in zip(fields, types, sizes, strict=True):
        if letter not in _CODES or size not in _SIZES[letter]:
            raise CloudError(f"field {name}: there is no TYPE {letter} of SIZE {size}")
    width = _whole_numbers(header, "WIDTH", 1)[0]
    height = _whole_numbers(header, "HEIGHT", 1)[0] if "HEIGHT" in header else 1
    n = _whole_numbers(header, "POINTS", 1)[0] if "POINTS" in header else width * height
    if n != width * height:
        raise CloudError(f"POINTS {n} is not WIDTH {width} × HEIGHT {height}")
    axes = []
    for axis in "xyz":
        if axis not in fields:
            raise CloudError(f"FIELDS {' '.join(fields)}: there is no field {axis}")
        axes.append(fields.index(axis))
        if counts[axes[-1]] != 1:
            raise CloudError(f"field {axis}: COUNT {counts[axes[-1]]} must be 1")

    kind, body = [word.lower() for word in header["DATA"]], data[begin:]
    formats = ["<" + _CODES[types[k]] + str(sizes[k]) for k in axes]
    widths = [size * count for size, count in zip(sizes, counts, strict=True)]
    if kind == ["ascii"]:
        table = _table(body, n, sum(counts), " ".join(header["FIELDS"]), first_line)
        points = table[:, [sum(counts[:k]) for k in axes]]
        if line_count(body) != n:
            for k, (letter, size) in enumerate(zip(types, sizes, strict=True)):
                if letter != "F" and counts[k] == 1:
                    check_whole(table[:, sum(counts[:k])], fields[k], _CODES[letter] + str(size))
    elif kind == ["binary"]:
        _check_length(body, n * sum(widths))
        # Older versions of the library stretched their files by a page of zeros.
        if body[n * sum(widths) :].strip(b"\0 \r\n"):
            left = len(body) - n * sum(widths)
            raise CloudError(f"{left} bytes are left behind its {n} points: does the header lack a field?")
        record = np.dtype(
            {
                "names": list("xyz"),
                "formats": formats,
                "offsets": [sum(widths[:k]) for k in axes],
                "itemsize": sum(widths),
            }
        )
        rows = np.frombuffer(body, record, count=n)
        points = np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)
    elif kind == ["binary_compressed"]:
        unpacked = _decompressed(body, n * sum(widths))
        # One field after the other, each for all points.
        starts = [n * sum(widths[:k]) for k in axes]
        points = np.stack(
            [
                np.frombuffer(unpacked, code, count=n, offset=start).astype(np.float64)
                for code, start in zip(formats, starts, strict=True)
            ],
            axis=1,
        )
    else:
        raise CloudError(f"line {first_line - 1}: DATA {' '.join(kind)} is not ascii, binary or binary_compressed")
    return points.reshape(height, width, 3) if height > 1 else points


def _header(data: bytes) -> tuple[dict[str, list[str]], int, int]:
    """The words after each key, where the body begins, and the number of its first line."""
    header: dict[str, list[str]] = {}
    for number, words, begin in header_lines(data):
        if not words or words[0].startswith("#"):
            continue
        key = words[0].upper()
        header["FIELDS" if key == "COLUMNS" else key] = words[1:]  # before version 0.6
        if key == "DATA":
            return header, begin, number + 1
        if number > 100:
            break
    raise CloudError("no .pcd: there is no DATA line in its header")


def _whole_numbers(header: dict[str, list[str]], key: str, count: int) -> list[int]:
    words = header.get(key)
    if words is None:
        raise CloudError(f"the header has no {key}")
    if len(words) != count or not all(word.isdecimal() and len(word) < 16 for word in words):
        raise CloudError(f"{key} {' '.join(words)[:80]}: expected {count} whole number{'s' if count > 1 else ''}")
    return [int(word) for word in words]


def _table(body: bytes, n: int, width: int, fields: str, first_line: int) -> NDArray[np.float64]:
    """(n, width) of a text whose rows may go on over several lines."""
    values = numbers(body, first_line)
    if len(values) == n * width:
        return values.reshape(n, width)
    lines = list(word_lines(body, first_line))
    for number, words in lines:
        if len(words) != width:
            raise CloudError(
                f"line {number} holds {len(words)} number{'s' * (len(words) != 1)}, and a point has {width} by the "
                f"header: FIELDS {fields[:120]}"
            )
    raise CloudError(f"promises {n} points and holds {len(lines)}")


def _check_length(body: bytes, needed: int) -> None:
    if len(body) < needed:
        raise CloudError(f"its points need {needed} bytes, and {len(body)} are there")


def _decompressed(body: bytes, needed: int) -> bytes:
    _check_length(body, 8)
    packed, size = (int(value) for value in np.frombuffer(body, "<u4", count=2))
    if size != needed:
        raise CloudError(f"its points need {needed} bytes, and {size} are compressed")
    _check_length(body[8:], packed)
    return lzf_decompressed(body[8 : 8 + packed], size)


def lzf_decompressed(data: bytes, size: int) -> bytes:
    """Marc Lehmann's LZF: runs of up to 32 bytes as they are, and copies from the last 8 KiB. Raises CloudError."""
    out = bytearray()
    i, end = 0, len(data)
    try:
        while i < end:
            control = data[i]
            i += 1
            if control < 32:
                out += data[i : i + control + 1]
                i += control + 1
            else:
                length = control >> 5
                if length == 7:
                    length += data[i]
                    i += 1
                start = len(out) - ((control & 31) << 8) - data[i] - 1
                i += 1
                if start < 0:
                    raise CloudError("the compressed points are damaged: a copy from before their beginning")
                length += 2
                piece = out[start : start + length]
                # A copy may overlap itself: then it repeats.
                out += (piece * (length // len(piece) + 1))[:length]
            if len(out) > size:
                break
    except IndexError as error:
        raise CloudError("the compressed points are damaged: they end within a copy") from error
    if len(out) != size:
        raise CloudError(f"the compressed points are damaged: {len(out)} bytes instead of {size}")
    return bytes(out)
