"""Numbers in lines of text, and the .xyz files that are nothing else. Errors name the line and the column."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from grasping.errors import CloudError

_APART = re.compile(r"[\s,;]+")


def decoded(data: bytes) -> str:
    """Text of a file; a byte that is no ASCII becomes a character that no number contains."""
    return data.decode("ascii", errors="replace")


def header_lines(data: bytes) -> Iterator[tuple[int, list[str], int]]:
    """Of each line of a file its number, from 1, its words, and where in the data the next line begins."""
    begin, number = 0, 0
    while begin < len(data):
        end = data.find(b"\n", begin)
        end = len(data) if end < 0 else end
        words = decoded(data[begin:end]).split()
        begin, number = end + 1, number + 1
        yield number, words, begin


def table_lines(body: bytes) -> list[str]:
    """The lines of a body of text, without blank ones at its end."""
    lines = decoded(body).splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    return lines


def read_columns(
    lines: Sequence[str], columns: Sequence[int], names: Sequence[str], first_line: int
) -> NDArray[np.float64]:
    """The numbers (N, C) in these columns, apart by blanks, of lines that all hold a row.

    names: of the columns, and first_line: number of the first line in its file, for errors. Raises CloudError.
    """
    if not lines:
        return np.empty((0, len(columns)))
    try:
        numbers = np.loadtxt(lines, usecols=columns, dtype=np.float64, comments=None, ndmin=2)
    except ValueError as error:
        _blame(lines, columns, names, first_line)
        raise CloudError(f"from line {first_line}: {error}") from error
    if len(numbers) < len(lines):  # a blank line is passed over
        _blame(lines, columns, names, first_line)
    return numbers


def _blame(lines: Sequence[str], columns: Sequence[int], names: Sequence[str], first_line: int) -> None:
    """Raises CloudError for the first field that is missing or no number."""
    for number, line in enumerate(lines, first_line):
        words = line.split()
        for column, name in zip(columns, names, strict=True):
            if column >= len(words):
                raise CloudError(f"line {number}: field {name} is missing")
            try:
                float(words[column])
            except ValueError as error:
                raise CloudError(f"line {number}: field {name}: {words[column][:40]!r} is not a number") from error


def read_xyz(data: bytes) -> NDArray[np.float64]:
    """The first three columns (N, 3) of a text; see `grasping.cloud_files.read_cloud`. Raises CloudError."""
    rows: list[str] = []
    numbers: list[int] = []
    count: int | None = None
    first = True
    for number, line in enumerate(decoded(data).splitlines(), 1):
        words = _APART.split(line.split("#", 1)[0].split("//", 1)[0].strip(" \t,;"))
        if words == [""]:
            continue
        if first and len(words) == 1 and words[0].isdecimal():
            count = int(words[0])
        elif not (first and not any(_is_number(word) for word in words)):
            rows.append(" ".join(words[:3]))
            numbers.append(number)
        first = False
    try:
        points = read_columns(rows, (0, 1, 2), "xyz", 1)
    except CloudError:
        for row, number in zip(rows, numbers, strict=True):
            _blame([row], (0, 1, 2), "xyz", number)
        raise
    if count is not None and count != len(points):
        raise CloudError(f"line 1: promises {count} points, and {len(points)} follow")
    return points


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
