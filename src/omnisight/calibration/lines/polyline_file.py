"""Reader of lines drawn by a user: polylines of pixels in a JSON or CSV file."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.lines.pixel_chains import MIN_CHAIN_PIXELS

Array = NDArray[np.float64]

# Larger files are not drawn manually; reading them could exhaust the memory.
MAX_FILE_BYTES = 50_000_000
# Larger coordinates are errors of the file.
MAX_PIXEL = 1e6
EXPECTED = (
    "a JSON list of lines, each a list of [u, v]; a JSON object with such a list for each image name; or CSV rows"
    " line,u,v or image,line,u,v"
)


def read_polylines(path: Path) -> dict[str, list[Array]]:
    """Read the lines (n, 2) of each image.

    Parameters
    ----------
    path
        JSON: a list of lines, each a list of pixels [u, v], or an object with such a list for each image name. CSV:
        rows `line,u,v` or `image,line,u,v`, the rows of one line in order, with or without a header.

    Returns
    -------
    Lines by image name; the name is empty if the file contains no image names.

    Raises
    ------
    ValueError
        If the file is larger than 50 MB or has other content; the message states the file and the place.
    OSError
        If the file cannot be read.
    """
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(f"{path}: has {path.stat().st_size} bytes, more than the limit of {MAX_FILE_BYTES}")
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: is not a text file; expected {EXPECTED}") from None
    try:
        return _parse_json(text) if text.lstrip()[:1] in ("[", "{") else _parse_csv(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: {error}") from None


def _parse_json(text: str) -> dict[str, list[Array]]:
    data: Any = json.loads(text)
    lines_of_image: Mapping[str, Any] = data if isinstance(data, dict) else {"": data}
    result: dict[str, list[Array]] = {}
    for image, lines in lines_of_image.items():
        if not isinstance(lines, list):
            raise ValueError(f"{image!r} is of type {type(lines).__name__}; expected {EXPECTED}")
        result[image] = [_parse_line(line, str(i + 1), image) for i, line in enumerate(lines)]
    return result


def _parse_csv(text: str) -> dict[str, list[Array]]:
    rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    if rows and not _is_number(rows[0][-1]):
        rows = rows[1:]
    cells: dict[tuple[str, str], list[list[str]]] = {}
    for number, row in enumerate(rows, 1):
        if len(row) not in (3, 4):
            raise ValueError(f"row {number} has {len(row)} columns; expected line,u,v or image,line,u,v")
        image = row[0].strip() if len(row) == 4 else ""
        cells.setdefault((image, row[-3].strip()), []).append(row[-2:])
    result: dict[str, list[Array]] = {}
    for (image, line), values in cells.items():
        result.setdefault(image, []).append(_parse_line(values, line, image))
    return result


def _parse_line(values: Any, line: str, image: str) -> Array:
    """Return the pixels (n, 2) of a line, or raise `ValueError` with its name."""
    name = f"line {line} of {image}" if image else f"line {line}"
    try:
        pixels = np.array(values, float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} is not a list of pixels [u, v]; expected {EXPECTED}") from None
    if pixels.ndim != 2 or pixels.shape[1] != 2 or len(pixels) < MIN_CHAIN_PIXELS:
        raise ValueError(f"{name} has shape {pixels.shape}; expected {MIN_CHAIN_PIXELS} or more pixels [u, v]")
    if not np.isfinite(pixels).all() or np.abs(pixels).max() > MAX_PIXEL:
        raise ValueError(f"{name} has a coordinate that is not a valid pixel")
    return pixels


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
