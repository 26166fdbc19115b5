"""Numbers in a body of text, apart by blanks and line ends alike. Errors name the line and the word."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from grasping.errors import CloudError

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_GROUPED = re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?|[+-]?\d{1,3}(,\d{3}){2,}")
_FORTRAN = re.compile(rb"(?<=[0-9.])[dD](?=[+-]?[0-9])")
_WINDOWS_NAN = re.compile(rb"[+-]?1\.#(IND|QNAN|SNAN|INF)[0-9]*|[+-]?nan\((ind|snan)\)", re.IGNORECASE)


def unmarked(data: bytes) -> bytes:
    """The data without the mark that some programs put before a text in UTF-8. Raises CloudError for UTF-16."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise CloudError("a text in UTF-16: save it as UTF-8")
    return data.removeprefix(b"\xef\xbb\xbf")


def decoded(data: bytes) -> str:
    """Text of a file; a byte that is no ASCII becomes a character that no number contains."""
    return data.decode("ascii", errors="replace")


def header_lines(data: bytes) -> Iterator[tuple[int, list[str], int]]:
    """Of each line of a file its number, from 1, its words, and where in the data the next line begins.

    Lines end as the first one does: in \\n, also after \\r, or in \\r alone.
    """
    first = re.search(rb"[\r\n]\n?", data)
    mark = b"\r" if first is not None and first.group() == b"\r" else b"\n"
    begin, number = 0, 0
    while begin < len(data):
        end = data.find(mark, begin)
        end = len(data) if end < 0 else end
        words = decoded(data[begin:end]).split()
        begin, number = end + 1, number + 1
        yield number, words, begin


def numbers(body: bytes, first_line: int) -> NDArray[np.float64]:
    """All numbers of a text, in order; first_line: the number of its first line in its file. Raises CloudError."""
    body = plain_numbers(body)
    if not body.strip():  # which NumPy reads as -1
        return np.empty(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # NumPy 1 only warns
            return np.fromstring(body, dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        pass
    for number, words in word_lines(body, first_line):
        for word in words:
            check_number(word, f"line {number}")
    raise CloudError("its text holds bytes that are no numbers")


def plain_numbers(body: bytes) -> bytes:
    """The text with what Fortran and Windows write for exponents and NaN as everyone else does."""
    body = _FORTRAN.sub(b"e", body)
    return _WINDOWS_NAN.sub(b"nan", body) if b"#" in body or b"(" in body else body


def word_lines(body: bytes, first_line: int) -> Iterator[tuple[int, list[str]]]:
    """The number and the words of each line that is not blank."""
    for number, line in enumerate(decoded(body).splitlines(), first_line):
        if words := line.split():
            yield number, words


def check_number(word: str, where: str) -> None:
    """Raises CloudError with the way out where a word is no number."""
    if "_" not in word:
        try:
            float(word)
        except ValueError:
            pass
        else:
            return
    raise CloudError(f"{where}: {word[:40]!r} is not a number{way_out(word)}")


def check_whole(column: NDArray[np.float64], name: str, code: str) -> None:
    """Raises CloudError where a field of this whole type holds something else: rows are not what the header says."""
    limits = np.iinfo(code)
    wrong = np.flatnonzero((column != np.floor(column)) | (column < limits.min) | (column > limits.max))
    if len(wrong):
        raise CloudError(
            f"point {wrong[0]} would have {name} = {column[wrong[0]]:g}, which is no {limits.dtype}: the numbers are "
            "not those that the header promises"
        )


def line_count(body: bytes) -> int:
    """How many lines are not blank."""
    return sum(1 for line in body.splitlines() if line.strip())


def has_comma(word: str) -> bool:
    """Whether a word is a number with a decimal comma, or with commas between its thousands."""
    return bool(_DECIMAL_COMMA.fullmatch(word) or _GROUPED.fullmatch(word))


def way_out(word: str) -> str:
    """What to write instead of a word that should be a number, where its form says what was meant."""
    if _DECIMAL_COMMA.fullmatch(word):
        return f": a decimal comma? Write decimal points, {word.replace(',', '.')[:40]}"
    if _GROUPED.fullmatch(word):
        return f": commas between thousands? Leave them out, {word.replace(',', '')[:40]}"
    if ";" in word or "," in word:
        return ": numbers stand apart by blanks in this format, not by commas or semicolons"
    return ": write nan for what was not measured" if word.lower() in ("null", "none", "na", "n/a", "-", "--") else ""
