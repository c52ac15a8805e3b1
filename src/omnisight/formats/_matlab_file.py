"""Reading MATLAB's .mat of version 5: numbers, texts and structs.

Not by `scipy.io.loadmat`, which follows whatever sizes and nesting a file claims, through memory and the stack; the
files come from anywhere, and what is needed of them is small. Objects, cells and sparse matrices are passed over: None.
MATLAB, MAT-File Format (MathWorks).
"""

import math
import struct
import zlib
from collections.abc import Iterable
from typing import Any

LARGEST = 20_000_000  # bytes, unpacked
MOST = 1_000_000  # numbers of one matrix
DEEPEST = 8
HEADER = 128
COMPRESSED, MATRIX = 15, 14
STRUCT, CHARACTERS, OBJECT = 2, 4, 17
NUMERIC = range(6, 16)  # double, single, and the integers
FORMATS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 9: "d", 12: "q", 13: "Q", 16: "B", 17: "H", 18: "I"}
HDF5 = "\x89HDF", "MATLAB 7."  # how files begin that are none of version 5
SAVE_AS_7 = "s = load('old.mat'); save('new.mat', '-struct', 's', '-v7')"
NO_HDF5 = f"a .mat of version 7.3 (HDF5) is not read: save it with -v7, in MATLAB: {SAVE_AS_7}"


class Matrix(list[float]):
    """The numbers of a matrix, column by column.

    Attributes
    ----------
    sizes
        Its rows, columns and so on.
    """

    def __init__(self, values: Iterable[float], sizes: tuple[int, ...]) -> None:
        super().__init__(values)
        self.sizes = sizes


def read_mat(data: bytes) -> dict[str, Any]:
    """Give the variables by name: numbers as `Matrix`, texts, structs as maps, and several structs as a list of maps.

    Raises
    ------
    ValueError
        If the file is cut off, or larger than any calibration.
    """
    if len(data) < HEADER or data[126:128] not in (b"IM", b"MI"):
        raise ValueError("a damaged header")
    order = "<" if data[126:128] == b"IM" else ">"
    found: dict[str, Any] = {}
    left = LARGEST
    at = HEADER
    while at + 8 <= len(data):
        kind, body, at = _element(data, at, order)
        if kind == COMPRESSED:
            unpack = zlib.decompressobj()
            try:
                inner = unpack.decompress(body, left)
            except zlib.error as error:
                raise ValueError(f"damaged: {error}") from error
            if unpack.unconsumed_tail:
                raise ValueError(f"more than {LARGEST} bytes when unpacked; a calibration has less")
            left = max(1, left - len(inner))
            kind, body, _ = _element(inner, 0, order)
        if kind == MATRIX:
            name, value = _matrix(body, order, 0)
            found[name] = value
    return found


def _element(data: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """Give type and bytes of the element that begins there, and where the next one begins."""
    if at + 8 > len(data):
        raise ValueError("cut off")
    kind, size = struct.unpack_from(f"{order}II", data, at)
    if kind >> 16:  # four bytes or fewer stand in the tag itself
        kind, size = kind & 0xFFFF, kind >> 16
        if size > 4:
            raise ValueError(f"damaged: a small element of {size} bytes")
        return kind, data[at + 4 : at + 4 + size], at + 8
    if at + 8 + size > len(data):
        raise ValueError("cut off")
    after = at + 8 + size
    return kind, data[at + 8 : after], after if kind == COMPRESSED else after + -size % 8


def _numbers(data: bytes, at: int, order: str) -> tuple[list[float], int]:
    kind, body, after = _element(data, at, order)
    if kind not in FORMATS:
        raise ValueError(f"damaged: numbers of type {kind}")
    count = len(body) // struct.calcsize(f"{order}{FORMATS[kind]}")
    return list(struct.unpack_from(f"{order}{count}{FORMATS[kind]}", body)), after


def _matrix(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    if depth > DEEPEST:
        raise ValueError(f"more than {DEEPEST} structs inside each other")
    if not data:
        return "", []
    flags, at = _numbers(data, 0, order)
    what = int(flags[0]) & 0xFF if flags else 0
    if what == OBJECT:  # of a classdef: its name comes first, and then what is not read
        return _element(data, at, order)[1].decode("ascii", errors="replace"), None
    sizes, at = _numbers(data, at, order)
    _, name, at = _element(data, at, order)
    named = name.decode("ascii", errors="replace")
    if any(size < 0 for size in sizes) or math.prod(int(size) for size in sizes) > MOST:
        raise ValueError(f"{named[:40]!r} claims {' x '.join(f'{size:g}' for size in sizes[:6])} entries")
    count = math.prod(int(size) for size in sizes)
    if what in NUMERIC or what == CHARACTERS:
        values, _ = _numbers(data, at, order)
        if len(values) != count:
            raise ValueError(f"{named[:40]!r} has {len(values)} of {count} numbers")
        if what == CHARACTERS:
            return named, "".join(chr(int(v)) for v in values)
        return named, Matrix((float(v) for v in values), tuple(int(size) for size in sizes))
    if what != STRUCT:
        return named, None
    length, at = _numbers(data, at, order)
    _, names, at = _element(data, at, order)
    step = int(length[0]) if length else 0
    if not 1 <= step <= 64:
        raise ValueError(f"damaged: names of {step} characters")
    keys = [names[i : i + step].split(b"\0")[0].decode("ascii", errors="replace") for i in range(0, len(names), step)]
    if not keys:
        return named, None
    structs: list[dict[str, Any]] = []
    for _ in range(count):
        structs.append({})
        for key in keys:
            kind, body, at = _element(data, at, order)
            structs[-1][key] = _matrix(body, order, depth + 1)[1] if kind == MATRIX else None
    return named, structs[0] if count == 1 else structs
