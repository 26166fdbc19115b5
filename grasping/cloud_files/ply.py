"""The vertices of a .ply: ASCII or binary of either byte order, with whatever else the file holds before or beside."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasping.cloud_files.text import header_lines, read_columns, table_lines
from grasping.errors import CloudError

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Property:
    """A number, or a list of numbers that begins with its length (of the type `counted_by`)."""

    name: str
    code: np.dtype
    counted_by: np.dtype | None = None


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        return any(each.counted_by is not None for each in self.properties)

    @property
    def width(self) -> int:
        """Bytes of a row that holds no list."""
        return sum(each.code.itemsize for each in self.properties)


def read_ply(data: bytes) -> NDArray:
    """The vertices' x, y, z (N, 3). Raises CloudError."""
    order, elements, begin, first_line = _header(data)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise CloudError("the header has no element vertex")
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    own = [each.name for each in vertex.properties]
    for axis in "xyz":
        if axis not in own or vertex.properties[own.index(axis)].counted_by is not None:
            raise CloudError(f"element vertex has no number {axis}")
    if not order:
        return _from_text(data[begin:], before, vertex, first_line)
    body = data[begin:]
    offset = 0
    for element in before:
        offset = _end_of(body, offset, element)
    return _from_bytes(body, offset, vertex)


def _header(data: bytes) -> tuple[str, list[_Element], int, int]:
    """Byte order ("" for text), the elements, where the body begins, and the number of its first line."""
    if not data.startswith(b"ply"):
        raise CloudError("it does not begin with 'ply'")
    order: str | None = None
    elements: list[_Element] = []
    for number, words, begin in header_lines(data):
        if not words or words[0] in ("ply", "comment", "obj_info"):
            continue
        if words[0] == "end_header":
            if order is None:
                raise CloudError("the header has no format")
            return order, elements, begin, number + 1
        if words[0] == "format" and len(words) >= 2 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdecimal() and len(words[2]) < 16:
            elements.append(_Element(words[1], int(words[2])))
        elif words[0] == "property" and elements and (found := _property(words[1:], order or "")):
            elements[-1].properties.append(found)
        else:
            raise CloudError(f"line {number}: {' '.join(words)[:60]!r} is not understood")
    raise CloudError("its header has no end_header")


def _property(words: list[str], order: str) -> _Property | None:
    if len(words) == 2 and words[0] in _TYPES:
        return _Property(words[1], np.dtype(order + _TYPES[words[0]]))
    if len(words) == 4 and words[0] == "list" and words[1] in _TYPES and words[2] in _TYPES:
        count = np.dtype(order + _TYPES[words[1]])
        return _Property(words[3], np.dtype(order + _TYPES[words[2]]), count) if count.kind != "f" else None
    return None


def _from_text(body: bytes, before: list[_Element], vertex: _Element, first_line: int) -> NDArray:
    lines = table_lines(body)
    skipped = sum(element.count for element in before)
    rows = lines[skipped : skipped + vertex.count]
    if len(rows) < vertex.count:
        raise CloudError(f"promises {vertex.count} points and holds {len(rows)}")
    first_line += skipped
    names = [each.name for each in vertex.properties]
    if not vertex.has_lists:
        return read_columns(rows, [names.index(axis) for axis in "xyz"], "xyz", first_line)
    # A list moves what stands after it: each line has columns of its own.
    points = [
        read_columns([row], _columns(row, vertex, number), "xyz", number) for number, row in enumerate(rows, first_line)
    ]
    return np.concatenate(points) if points else np.empty((0, 3))


def _columns(row: str, vertex: _Element, number: int) -> list[int]:
    """In which column of this line x, y and z stand."""
    words, places, at = row.split(), dict[str, int](), 0
    for each in vertex.properties:
        places.setdefault(each.name, at)
        if each.counted_by is not None:
            if at >= len(words) or not words[at].isdecimal() or len(words[at]) > 9:
                raise CloudError(f"line {number}: field {each.name} does not begin with the length of a list")
            at += int(words[at])
        at += 1
    return [places[axis] for axis in "xyz"]


def _from_bytes(body: bytes, offset: int, vertex: _Element) -> NDArray:
    names = [each.name for each in vertex.properties]
    axes = [names.index(axis) for axis in "xyz"]
    if vertex.has_lists:
        points = np.empty((min(vertex.count, len(body)), 3))
        for row in range(vertex.count):
            starts, offset = _row(body, offset, vertex, row)
            points[row] = [_number(body, starts[k], vertex.properties[k].code) for k in axes]
        return points
    _end_of(body, offset, vertex)
    codes = [each.code for each in vertex.properties]
    starts = [sum(code.itemsize for code in codes[:k]) for k in axes]
    record = np.dtype(
        {"names": list("xyz"), "formats": [codes[k] for k in axes], "offsets": starts, "itemsize": vertex.width}
    )
    rows = np.frombuffer(body, record, count=vertex.count, offset=offset)
    return np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _end_of(body: bytes, offset: int, element: _Element) -> int:
    """Where the rows of an element end that begin here."""
    if not element.has_lists:
        needed = element.count * element.width
        if len(body) - offset < needed:
            raise CloudError(
                f"its {element.count} of {element.name} need {needed} bytes, and {len(body) - offset} are there"
            )
        return offset + needed
    for row in range(element.count):
        _, offset = _row(body, offset, element, row)
    return offset


def _row(body: bytes, offset: int, element: _Element, row: int) -> tuple[list[int], int]:
    """Where each property of a row with lists begins, and where the row ends."""
    starts = []
    for each in element.properties:
        starts.append(offset)
        size = each.code.itemsize
        if each.counted_by is not None:
            if offset + each.counted_by.itemsize > len(body):
                raise CloudError(f"it ends in {element.name} {row}, before the length of {each.name}")
            length = int(_number(body, offset, each.counted_by))
            if length < 0:
                raise CloudError(f"{element.name} {row}: the list {each.name} has the length {length}")
            size = each.counted_by.itemsize + length * size
        offset += size
        if offset > len(body):
            raise CloudError(f"it ends in {element.name} {row}, within {each.name}")
    return starts, offset


def _number(body: bytes, offset: int, code: np.dtype) -> float:
    return float(np.frombuffer(body, code, count=1, offset=offset)[0])
