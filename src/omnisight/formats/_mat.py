"""Read MATLAB's .mat files of version 5: numbers, texts and structs (MATLAB, MAT-File Format, MathWorks).

`scipy.io.loadmat` allocates whatever sizes and nesting a file claims; this reader checks them first. Objects, cells and
sparse matrices are read as None.
"""

import math
import struct
import zlib
from collections.abc import Iterable
from typing import Any

from omnisight.formats._limits import MAX_DEPTH, MAX_ENTRIES, MAX_UNPACKED_BYTES

HEADER_BYTES = 128
MAX_FIELD_NAME_CHARS = 64  # of a struct, by the format
COMPRESSED, MATRIX = 15, 14
STRUCT, CHARACTERS, OBJECT = 2, 4, 17
NUMERIC = range(6, 16)  # double, single, and the integers
FORMATS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 9: "d", 12: "q", 13: "Q", 16: "B", 17: "H", 18: "I"}
SIGNATURE = "MATLAB 5.0 "
HDF5_SIGNATURES = "\x89HDF", "MATLAB 7."  # of version 7.3
SAVE_AS_7 = "s = load('old.mat'); save('new.mat', '-struct', 's', '-v7')"
HDF5_ERROR = f"a .mat of version 7.3 (HDF5) is not read: save it with -v7, in MATLAB: {SAVE_AS_7}"


class Matrix(list[float]):
    """The numbers of a matrix in column-major order, with its shape (rows, columns, ...)."""

    def __init__(self, values: Iterable[float], shape: tuple[int, ...]) -> None:
        super().__init__(values)
        self.shape = shape


def read_mat(data: bytes) -> dict[str, Any]:
    """Return the variables by name: `Matrix`, text, map of a struct, or list of maps of a struct array.

    Raises
    ------
    ValueError
        If the file is truncated, or larger than any calibration.
    """
    if len(data) < HEADER_BYTES or data[126:128] not in (b"IM", b"MI"):
        raise ValueError("a damaged header")
    order = "<" if data[126:128] == b"IM" else ">"
    variables: dict[str, Any] = {}
    budget = MAX_UNPACKED_BYTES
    at = HEADER_BYTES
    while at + 8 <= len(data):
        kind, body, at = _element(data, at, order)
        if kind == COMPRESSED:
            unpack = zlib.decompressobj()
            try:
                inner = unpack.decompress(body, budget)
            except zlib.error as error:
                raise ValueError(f"damaged: {error}") from error
            if unpack.unconsumed_tail:
                raise ValueError(f"more than {MAX_UNPACKED_BYTES} bytes when unpacked")
            budget = max(1, budget - len(inner))
            kind, body, _ = _element(inner, 0, order)
        if kind == MATRIX:
            name, value = _matrix(body, order, 0)
            variables[name] = value
    return variables


def _element(data: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """Return the type and the bytes of the element at an offset, and the offset of the next one."""
    if at + 8 > len(data):
        raise ValueError("truncated")
    kind, size = struct.unpack_from(f"{order}II", data, at)
    if kind >> 16:  # at most four bytes are stored in the tag itself
        kind, size = kind & 0xFFFF, kind >> 16
        if size > 4:
            raise ValueError(f"damaged: a small element of {size} bytes")
        return kind, data[at + 4 : at + 4 + size], at + 8
    if at + 8 + size > len(data):
        raise ValueError("truncated")
    after = at + 8 + size
    return kind, data[at + 8 : after], after if kind == COMPRESSED else after + -size % 8


def _numbers(data: bytes, at: int, order: str) -> tuple[list[float], int]:
    """Return the numbers of the element at an offset, and the offset of the next one."""
    kind, body, after = _element(data, at, order)
    if kind not in FORMATS:
        raise ValueError(f"damaged: numbers of type {kind}")
    count = len(body) // struct.calcsize(f"{order}{FORMATS[kind]}")
    return list(struct.unpack_from(f"{order}{count}{FORMATS[kind]}", body)), after


def _matrix(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    """Return the name and the value of a matrix element."""
    if depth > MAX_DEPTH:
        raise ValueError(f"more than {MAX_DEPTH} nested structs")
    if not data:
        return "", []
    flags, at = _numbers(data, 0, order)
    array_class = int(flags[0]) & 0xFF if flags else 0
    if array_class == OBJECT:  # of a classdef: its name, then data that only MATLAB can read
        return _element(data, at, order)[1].decode("ascii", errors="replace"), None
    sizes, at = _numbers(data, at, order)
    _, name, at = _element(data, at, order)
    variable = name.decode("ascii", errors="replace")
    if any(size < 0 for size in sizes) or math.prod(int(size) for size in sizes) > MAX_ENTRIES:
        raise ValueError(f"{variable[:40]!r} claims {' x '.join(f'{size:g}' for size in sizes[:6])} entries")
    count = math.prod(int(size) for size in sizes)
    if array_class in NUMERIC or array_class == CHARACTERS:
        values, _ = _numbers(data, at, order)
        if len(values) != count:
            raise ValueError(f"{variable[:40]!r} has {len(values)} of {count} numbers")
        if array_class == CHARACTERS:
            return variable, "".join(chr(int(v)) for v in values)
        return variable, Matrix((float(v) for v in values), tuple(int(size) for size in sizes))
    if array_class != STRUCT:
        return variable, None
    length, at = _numbers(data, at, order)
    _, names, at = _element(data, at, order)
    step = int(length[0]) if length else 0
    if not 1 <= step <= MAX_FIELD_NAME_CHARS:
        raise ValueError(f"damaged: names of {step} characters")
    keys = [names[i : i + step].split(b"\0")[0].decode("ascii", errors="replace") for i in range(0, len(names), step)]
    if not keys:
        return variable, None
    structs: list[dict[str, Any]] = []
    for _ in range(count):
        structs.append({})
        for key in keys:
            kind, body, at = _element(data, at, order)
            structs[-1][key] = _matrix(body, order, depth + 1)[1] if kind == MATRIX else None
    return variable, structs[0] if count == 1 else structs
