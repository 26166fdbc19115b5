"""Text with a point a line, as spreadsheets, scanners and scripts write it: .xyz, .csv, .txt, .asc, .pts."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasping.cloud_files.text import check_number, decoded, has_comma, numbers, plain_numbers, unmarked, way_out
from grasping.errors import CloudError

_UNIT = re.compile(r"\s*[\[(][^\])]*[\])]")
_NAMES = {
    **{f"{axis}{unit}": axis for axis in "xyz" for unit in ("", "_m", "_mm")},
    **{f"points{mark}{k}": axis for k, axis in enumerate("xyz") for mark in ":_"},  # ParaView's
}
_INNER_COMMA = re.compile(r"\d,\d")
_WHOLE = re.compile(r"[+-]?\d{1,2}")
_FRACTION = re.compile(r"\d+([eE][+-]?\d+)?")
_COMMAS = ": decimal commas? Write decimal points, and commas or semicolons between the numbers only"


class _Row(NamedTuple):
    number: int
    fields: list[str]


def read_columns(data: bytes) -> NDArray[np.float64]:
    """x, y and z (N, 3) of a text; see `grasping.cloud_files.read_cloud`. Raises CloudError."""
    text = decoded(plain_numbers(unmarked(data))).replace('"', "")
    if '"' in (raw := decoded(data)):
        _refuse_quoted_commas(raw)
    rows: list[_Row] = []
    count: int | None = None
    names: _Row | None = None
    comment: _Row | None = None
    for number, line in enumerate(text.splitlines(), 1):
        content, remark = _without_comment(line)
        fields = _fields(content, number)
        if not fields:
            comment = _Row(number, _fields(_UNIT.sub("", remark), number)) if remark and not rows else comment
        elif rows:
            rows.append(_Row(number, fields))
        elif (count, names) == (None, None) and len(fields) == 1 and fields[0].isdecimal() and len(content) < 16:
            count = int(fields[0])
        elif names is None and not any(_is_number(word) for word in fields) and re.search("[A-Za-z]", content):
            names = _Row(number, _fields(_UNIT.sub("", content), number))
        else:
            rows.append(_Row(number, fields))
    if not rows:
        return np.empty((0, 3))
    rows = _without_empty_ends(rows)
    _check_lengths(rows)
    _refuse_commas_as_points(rows)
    columns = _named(names, comment, rows[0])
    if columns is None:
        _refuse_counted_rows(rows)
        columns = [0, 1, 2]
    points = _numbers(rows, columns)
    if count is not None and count != len(points):
        raise CloudError(f"line 1: promises {count} points, and {len(points)} follow")
    return points


def _without_comment(line: str) -> tuple[str, str]:
    """What stands before a #, a // or a % that begins a line, and what behind it."""
    if line.startswith("%"):
        return "", line.strip("% \t")
    if "#" not in line and "//" not in line:
        return line.strip(), ""
    content, _, remark = line.replace("//", "#", 1).partition("#")
    return content.strip(), remark.strip("#/ \t")


def _fields(content: str, number: int) -> list[str]:
    """The fields of a line; an empty one between two commas or semicolons stays, as ""."""
    bare = content.rstrip(",; \t")
    if ";" in bare:
        return [field.strip() for field in content.split(";")]
    if "," not in bare:
        return bare.split()
    if " " not in content and "\t" not in content:
        return content.split(",")
    # Blanks, too: with a comma at their side they are its own, otherwise a comma without blanks is in a number.
    for word in re.split(r"\s*,\s+|\s+,\s*|\s+", bare) if _INNER_COMMA.search(bare) else ():
        if has_comma(word):
            raise CloudError(f"line {number}: {word[:40]!r} is not a number{way_out(word)}")
    return [field.strip() for field in content.split(",")]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _without_empty_ends(rows: list[_Row]) -> list[_Row]:
    """Without the empty last field that a separator at the end of every row makes."""
    if all(len(row.fields) > 1 and not row.fields[-1] for row in rows):
        return _without_empty_ends([_Row(row.number, row.fields[:-1]) for row in rows])
    return rows


def _check_lengths(rows: list[_Row]) -> None:
    first = rows[0]
    for row in rows:
        if (found := len(row.fields)) != len(first.fields):
            raise CloudError(
                f"line {row.number} has {found} column{'s' * (found != 1)}, line {first.number} has "
                f"{len(first.fields)}; every row needs as many{_COMMAS * _only_whole([first, row])}"
            )
    if len(first.fields) < 3:
        raise CloudError(f"line {first.number}: field {'xyz'[len(first.fields)]} is missing")


def _only_whole(rows: list[_Row]) -> bool:
    return all(re.fullmatch(r"[+-]?\d+", word) for row in rows for word in row.fields)


def _named(names: _Row | None, comment: _Row | None, first: _Row) -> list[int] | None:
    """In which columns x, y and z stand as a line of names or a comment above says. Raises CloudError."""
    width = len(first.fields)
    for line in (names, comment):
        if line is None:
            continue
        axes = [_NAMES.get(name.lower(), "") for name in line.fields]
        complete = set("xyz") <= set(axes)
        if complete and len(axes) == width:
            return [axes.index(axis) for axis in "xyz"]
        listed = ", ".join(line.fields)[:120]
        if line is names and complete:
            hint = _COMMAS * _only_whole([first])
            raise CloudError(
                f"line {line.number} names {len(axes)} columns, {listed}; line {first.number} has {width}{hint}"
            )
        if line is names and len(axes) == width:
            raise CloudError(f"line {line.number} names the columns {listed}: call those of the points x, y and z")
    return None


def _refuse_quoted_commas(raw: str) -> None:
    if found := re.search(r'"([+-]?\d*,\d+)"', raw):
        number = raw.count("\n", 0, found.start()) + 1
        raise CloudError(f"line {number}: {found[1][:40]!r} is not a number{way_out(found[1])}")


def _refuse_commas_as_points(rows: list[_Row]) -> None:
    """Raises CloudError for 0,12,0,05,0,30: decimal commas in a file whose columns stand apart by commas, too."""
    if len(rows[0].fields) < 6:
        return
    for row in rows:
        whole, behind = row.fields[:6:2], row.fields[1:6:2]
        if not (all(map(_WHOLE.fullmatch, whole)) and all(map(_FRACTION.fullmatch, behind))):
            return
    raise CloudError(f"line {rows[0].number}: {','.join(rows[0].fields)[:60]!r}{_COMMAS}")


def _refuse_counted_rows(rows: list[_Row]) -> None:
    """Raises CloudError for a first column 0, 1, 2, … beside three others: x would count the rows."""
    words = [row.fields[0] for row in rows if row.fields[0]]  # pandas leaves that of its columns' numbers empty
    if len(words) < 5 or len(rows[0].fields) < 4 or words[0] not in ("0", "1"):
        return
    if words == [str(int(words[0]) + k) for k in range(len(words))]:
        raise CloudError(
            f"line {rows[0].number}: the first column counts the rows; leave it out or name the columns in a first line"
        )


def _numbers(rows: list[_Row], columns: list[int]) -> NDArray[np.float64]:
    """Of an empty field NaN: it was not measured."""
    words = [row.fields[column] or "nan" for row in rows for column in columns]
    try:
        values = numbers(" ".join(words).encode(), 1)
        if len(values) == len(words):
            return values.reshape(-1, 3)
    except CloudError:
        pass
    for row in rows:
        for column, axis in zip(columns, "xyz", strict=True):
            check_number(row.fields[column] or "nan", f"line {row.number}: field {axis}")
    raise CloudError("its columns x, y and z hold something else than numbers")
