"""Lines that a user has drawn: polylines of pixels in a JSON or CSV file."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_BYTES = 50_000_000
SHAPES = (
    "a JSON list of lines, each a list of [u, v]; a JSON object with such a list for each image by name; or CSV rows"
    " line,u,v or image,line,u,v"
)


def read_polylines(path: Path) -> dict[str, list[Array]]:
    """Read the lines (n, 2) of each image by its file name; the name is empty where the file names no images.

    Parameters
    ----------
    path
        JSON: a list of lines, each a list of pixels [u, v], or an object with such a list for each image's name. CSV:
        rows `line,u,v` or `image,line,u,v`, the rows of one line in order, with or without a heading.

    Raises
    ------
    ValueError
        If the file is larger than 50 MB or holds something else; the text names the file and the place.
    OSError
        If it cannot be read.
    """
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"{path}: {path.stat().st_size} bytes are more than the {MOST_BYTES} that are read")
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: is no text; lines are {SHAPES}") from None
    try:
        return _of_json(text) if text.lstrip()[:1] in ("[", "{") else _of_csv(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: {error}") from None


def _of_json(text: str) -> dict[str, list[Array]]:
    data: Any = json.loads(text)
    named: Mapping[str, Any] = data if isinstance(data, dict) else {"": data}
    found: dict[str, list[Array]] = {}
    for name, lines in named.items():
        if not isinstance(lines, list):
            raise ValueError(f"{name!r} holds {type(lines).__name__}; wanted {SHAPES}")
        found[name] = [_pixels(line, f"line {i + 1}" + (f" of {name}" if name else "")) for i, line in enumerate(lines)]
    return found


def _of_csv(text: str) -> dict[str, list[Array]]:
    rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    if rows and not _is_number(rows[0][-1]):
        rows = rows[1:]
    drawn: dict[tuple[str, str], list[list[str]]] = {}
    for number, row in enumerate(rows, 1):
        if len(row) not in (3, 4):
            raise ValueError(f"row {number} has {len(row)} columns; wanted line,u,v or image,line,u,v")
        picture = row[0].strip() if len(row) == 4 else ""
        drawn.setdefault((picture, row[-3].strip()), []).append(row[-2:])
    found: dict[str, list[Array]] = {}
    for (picture, line), cells in drawn.items():
        found.setdefault(picture, []).append(_pixels(cells, f"line {line}" + (f" of {picture}" if picture else "")))
    return found


def _pixels(values: Any, what: str) -> Array:
    try:
        pixels = np.array(values, float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{what} is not a list of pixels [u, v]; wanted {SHAPES}") from None
    if pixels.ndim != 2 or pixels.shape[1] != 2 or len(pixels) < 3:
        raise ValueError(f"{what} has the shape {pixels.shape}; wanted three or more pixels [u, v]")
    if not np.isfinite(pixels).all() or np.abs(pixels).max() > 1e6:
        raise ValueError(f"{what} holds a number that is no pixel")
    return pixels


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
