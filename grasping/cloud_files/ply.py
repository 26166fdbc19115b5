"""The vertices of a .ply: ASCII or binary of either byte order, with whatever else the file holds before or beside."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasping.cloud_files.text import check_whole, header_lines, line_count, numbers, unmarked, word_lines
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
    "int64": "i8",
    "uint64": "u8",
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
    data = unmarked(data)
    order, elements, begin, first_line = _header(data)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise CloudError("the header has no element vertex")
    at = names.index("vertex")
    vertex = elements[at]
    own = [each.name for each in vertex.properties]
    for axis in "xyz":
        if axis not in own or vertex.properties[own.index(axis)].counted_by is not None:
            raise CloudError(f"element vertex has no number {axis}; it has {', '.join(own)[:120] or 'no properties'}")
    if not order:
        return _from_text(data[begin:], elements, at, first_line)
    body = data[begin:]
    offset = 0
    for element in elements[:at]:
        offset = _end_of(body, offset, element)
    points, offset = _from_bytes(body, offset, vertex)
    if at == len(elements) - 1 and body[offset:].strip(b"\0 \r\n"):
        raise CloudError(
            f"{len(body) - offset} bytes are left behind its {vertex.count} points: does the header lack a property?"
        )
    return points


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
    if not words:
        return None
    types, name = [word.lower() for word in words[:-1]], words[-1]
    name = name.lower() if name in ("X", "Y", "Z") else name
    if len(types) == 1 and types[0] in _TYPES:
        return _Property(name, np.dtype(order + _TYPES[types[0]]))
    if len(types) == 3 and types[0] == "list" and types[1] in _TYPES and types[2] in _TYPES:
        count = np.dtype(order + _TYPES[types[1]])
        return _Property(name, np.dtype(order + _TYPES[types[2]]), count) if count.kind != "f" else None
    return None


def _from_text(body: bytes, elements: list[_Element], at: int, first_line: int) -> NDArray:
    """A row may go on over several lines, as those of some viewers do: numbers are counted, and all must be there."""
    values = numbers(body, first_line)
    line_a_row = line_count(body) == sum(element.count for element in elements)
    if line_a_row and any(element.has_lists for element in elements):
        # One that is too short shall not borrow from the lists behind.
        _blame_line(body, elements, first_line)
    offset = 0
    points = np.empty((0, 3))
    for number, element in enumerate(elements):
        if number == at:
            start = offset
            points, offset = _text_rows(values, offset, element)
        else:
            offset = _text_end(values, offset, element)
        if offset > len(values):
            break
    if offset != len(values):
        _blame_line(body, elements, first_line)
        raise CloudError(f"its header promises {offset} numbers or more, and {len(values)} follow")
    vertex = elements[at]
    if not line_a_row and not vertex.has_lists:
        width = len(vertex.properties)
        for k, each in enumerate(vertex.properties):
            if each.code.kind != "f":
                check_whole(values[start + k : start + vertex.count * width : width], each.name, each.code.str)
    return points


def _text_rows(values: NDArray, offset: int, vertex: _Element) -> tuple[NDArray, int]:
    """The points, and where their element ends: beyond the values where these are too few."""
    names = [each.name for each in vertex.properties]
    axes = [names.index(axis) for axis in "xyz"]
    if not vertex.has_lists:
        end = offset + vertex.count * len(names)
        table = values[offset:end] if end <= len(values) else values[:0]
        return table.reshape(-1, len(names))[:, axes], end
    points = np.empty((min(vertex.count, len(values)), 3))
    for row in range(vertex.count):
        starts, offset = _text_row(values, offset, vertex)
        if offset > len(values):
            break
        points[row] = values[[starts[k] for k in axes]]
    return points, offset


def _text_end(values: NDArray, offset: int, element: _Element) -> int:
    """Where an element ends that begins here; beyond the values where these are too few."""
    if not element.has_lists:
        return offset + element.count * len(element.properties)
    if len(element.properties) == 1 and element.count and offset < len(values):  # most faces are all triangles
        width = 1 + int(max(np.nan_to_num(values[offset]), 0))
        end = offset + element.count * width
        if end <= len(values) and (values[offset:end:width] == width - 1).all():
            return end
    for _ in range(element.count):
        _, offset = _text_row(values, offset, element)
        if offset > len(values):
            break
    return offset


def _text_row(values: NDArray, offset: int, element: _Element) -> tuple[list[int], int]:
    """Where each property of a row with lists begins, and where the row ends."""
    starts = []
    for each in element.properties:
        starts.append(offset)
        if each.counted_by is not None:
            length = values[offset] if offset < len(values) else 0
            if not (length >= 0 and length == int(min(length, 1e9))):
                raise CloudError(f"a list {each.name} of {element.name} does not begin with its length: {length:g}")
            offset += int(length)
        offset += 1
    return starts, offset


def _blame_line(body: bytes, elements: list[_Element], first_line: int) -> None:
    """Raises CloudError for the first line that is no row as the header says, if each line is to be one."""
    lines = word_lines(body, first_line)
    for element in elements:
        names, found = [each.name for each in element.properties], 0
        while found < element.count and (line := next(lines, None)):
            number, words = line
            if not element.has_lists and len(words) != len(names):
                raise CloudError(
                    f"line {number} holds {len(words)} number{'s' * (len(words) != 1)}, and a {element.name} has "
                    f"{len(names)} by the header: {', '.join(names)[:120]}"
                )
            found += 1
        if found < element.count:
            raise CloudError(f"promises {element.count} rows of {element.name} and holds {found}")
    if line := next(lines, None):
        raise CloudError(f"line {line[0]}: more follows than the header promises")


def _from_bytes(body: bytes, offset: int, vertex: _Element) -> tuple[NDArray, int]:
    """The points, and where their element ends."""
    names = [each.name for each in vertex.properties]
    axes = [names.index(axis) for axis in "xyz"]
    if vertex.has_lists:
        points = np.empty((min(vertex.count, len(body)), 3))
        for row in range(vertex.count):
            starts, offset = _row(body, offset, vertex, row)
            points[row] = [_number(body, starts[k], vertex.properties[k].code) for k in axes]
        return points, offset
    end = _end_of(body, offset, vertex)
    codes = [each.code for each in vertex.properties]
    starts = [sum(code.itemsize for code in codes[:k]) for k in axes]
    record = np.dtype(
        {"names": list("xyz"), "formats": [codes[k] for k in axes], "offsets": starts, "itemsize": vertex.width}
    )
    rows = np.frombuffer(body, record, count=vertex.count, offset=offset)
    return np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1), end


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
