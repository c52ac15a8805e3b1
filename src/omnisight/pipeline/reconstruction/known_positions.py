"""Known positions of images: from their EXIF tags or from a table."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.geodesy import east_north_up
from omnisight.images import GeodeticPosition, exif_position
from omnisight.images.exif import EXIF_BYTES
from omnisight.pipeline.inputs.image_set import ImageSet

Array = NDArray[np.float64]

EXIF = "exif"
DELIMITERS = (",", ";", "\t")
METRIC = ("x", "y", "z")
GEODETIC = ("latitude", "longitude", "altitude")
# Least and largest angle; longitudes are counted from -180° or from 0°.
DEGREES = {"latitude": (-90.0, 90.0), "longitude": (-180.0, 360.0)}
SHORT = {"lat": "latitude", "lon": "longitude", "lng": "longitude", "alt": "altitude", "image": "name", "file": "name"}


@dataclass(frozen=True, eq=False)
class KnownPositions:
    """Positions of images.

    Attributes
    ----------
    positions
        (I, 3) metres; NaN if unknown. East, north and up of the origin, if there is one.
    origin
        On the ellipsoid WGS 84; None for positions in another frame.
    warnings
        Rows of a table that are not used.
    """

    positions: Array
    origin: GeodeticPosition | None = None
    warnings: tuple[str, ...] = ()

    @classmethod
    def of_geodetic(cls, positions: Array) -> "KnownPositions":
        """Return positions (I, 3) of latitude, longitude and altitude relative to the first of them."""
        altitude = positions[:, 2]
        if np.isnan(altitude).all():
            positions = np.column_stack([positions[:, :2], np.zeros(len(positions))])
        known = np.flatnonzero(np.isfinite(positions).all(axis=1))
        if not len(known):
            return cls(np.full((len(positions), 3), np.nan))
        origin = GeodeticPosition(*positions[known[0]].tolist())
        return cls(east_north_up(positions, origin), origin)


class _Row(NamedTuple):
    """A row of a table: its line, the name of its image, and (3,) numbers, NaN of empty cells."""

    line: int
    name: str
    numbers: Array


def read_positions(source: str | Path, files: ImageSet) -> KnownPositions:
    """Read the positions of images.

    Parameters
    ----------
    source
        "exif" for the tags of the images, or a CSV file with a header: name and x, y, z in metres, or name, latitude,
        longitude and altitude. Its cells are separated by commas; or by semicolons or tabs, where a comma in a number
        separates the decimals.
    files
        The images.

    Raises
    ------
    ValueError
        If no image has a position, the file is damaged, or a latitude or longitude is impossible.
    """
    found = _exif_positions(files) if str(source) == EXIF else _read_table(Path(source), files)
    if not np.isfinite(found.positions).all(axis=1).any():
        where = "its EXIF tags" if str(source) == EXIF else source
        reasons = "".join(f". {warning}" for warning in found.warnings)
        raise ValueError(
            f"{files.paths[0].parent}: none of the {len(files)} images has a valid position in {where}{reasons}"
        )
    return found


def image_named(files: ImageSet, name: str) -> int:
    """Return the index of an image by its path relative to the folder, its file name, or its name without extension.

    Raises
    ------
    ValueError
        If there is no such image, or several.
    """
    for of_image in (lambda path: path.as_posix(), lambda path: path.name, lambda path: path.stem):
        found = [i for i, each in enumerate(files.names) if of_image(PurePosixPath(each)) == name]
        if len(found) == 1:
            return found[0]
        if found:
            raise ValueError(_ambiguous(name, files, found))
    raise ValueError(f"{name}: no such image; the first is {files.names[0]}")


def _ambiguous(name: str, files: ImageSet, found: Sequence[int]) -> str:
    return f"{name}: {len(found)} images have this name, such as {files.names[found[0]]}: add the folder"


def _exif_positions(files: ImageSet) -> KnownPositions:
    positions = np.full((len(files), 3), np.nan)
    for i, path in enumerate(files.paths):
        with path.open("rb") as file:
            position = exif_position(file.read(EXIF_BYTES))
        if position is not None:
            positions[i] = position
    return KnownPositions.of_geodetic(positions)


def _read_table(path: Path, files: ImageSet) -> KnownPositions:
    """Read a CSV file; of several rows of an image, the first of the most complete ones is used."""
    try:
        text = path.read_text(encoding="utf-8-sig", errors="surrogateescape")
        delimiter = max(DELIMITERS, key=text.partition("\n")[0].count)
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except (OSError, csv.Error) as error:
        raise ValueError(f"{path}: cannot be read: {error}") from error
    header = [SHORT.get(cell.strip().lower(), cell.strip().lower()) for cell in rows[0]] if rows else []
    kind = next((kind for kind in (METRIC, GEODETIC) if {"name", *kind} <= set(header)), None)
    if kind is None:
        raise ValueError(
            f"{path}: its first line is {delimiter.join(header)[:80]!r}; expected the columns name,x,y,z or"
            " name,latitude,longitude,altitude"
        )
    name_column, columns = header.index("name"), [header.index(column) for column in kind]
    by_file = dict[str, list[int]]()
    for i, name in enumerate(files.names):
        by_file.setdefault(PurePosixPath(name).name, []).append(i)
    images = by_file | {name: [i] for i, name in enumerate(files.names)}
    rows_of_image, unknown = dict[int, list[_Row]](), list[tuple[int, str]]()
    for line, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        name = row[name_column].strip() if len(row) > name_column else ""
        found = images.get(name, [])
        if len(found) > 1:
            raise ValueError(f"{path}, line {line}: {_ambiguous(name, files, found)}")
        if not found:
            unknown.append((line, name))
            continue
        cells = [row[c] if c < len(row) else "" for c in columns]
        numbers = _position(cells, kind, delimiter, f"{path}, line {line}")
        rows_of_image.setdefault(found[0], []).append(_Row(line, name, numbers))
    used = {i: max(rows, key=lambda row: np.isfinite(row.numbers).sum()) for i, rows in rows_of_image.items()}
    positions = np.full((len(files), 3), np.nan)
    for i, row in used.items():
        positions[i] = row.numbers
    known = KnownPositions(positions) if kind == METRIC else KnownPositions.of_geodetic(positions)
    incomplete = set(np.flatnonzero(~np.isfinite(known.positions).all(axis=1)).tolist())
    warnings = (
        *_rows_of_unknown_images(path, unknown, files),
        *_repeated_rows(path, rows_of_image, used),
        *_unused_rows(path, [row.line for i, row in used.items() if i in incomplete], kind),
    )
    return replace(known, warnings=warnings)


def _position(cells: Sequence[str], kind: Sequence[str], delimiter: str, where: str) -> Array:
    """Return the numbers of cells, NaN of empty ones; raise ValueError with their place for others."""
    if delimiter != ",":  # spreadsheets separate cells by semicolons where the comma separates decimals
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        numbers = np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    for name, number in zip(kind, numbers.tolist(), strict=True):
        least, most = DEGREES.get(name, (-np.inf, np.inf))
        if number < least or number > most:
            raise ValueError(f"{where}: the {name} {number:g} is not from {least:g} to {most:g} degrees")
    return numbers


def _rows_of_unknown_images(path: Path, rows: Sequence[tuple[int, str]], files: ImageSet) -> tuple[str, ...]:
    """Return the warning that rows, lines and names, are of images that are not among those of the reconstruction."""
    if not rows:
        return ()
    line, name = rows[0]
    which = f"line {line} is" if len(rows) == 1 else f"{len(rows)} lines, the first is {line}, are"
    return (f"{path}: {which} not used: there is no image {name!r:.80}; the first image is {files.names[0]!r:.80}",)


def _repeated_rows(path: Path, rows: Mapping[int, Sequence[_Row]], used: Mapping[int, _Row]) -> tuple[str, ...]:
    """Return the warning that images have several rows."""
    repeated = [image for image in rows if len(rows[image]) > 1]
    if not repeated:
        return ()
    name, line = used[repeated[0]].name, used[repeated[0]].line
    which = f"{name} has" if len(repeated) == 1 else f"{len(repeated)} images, the first is {name}, have"
    return (f"{path}: {which} several lines: the first complete one is used, of {name} line {line}",)


def _unused_rows(path: Path, lines: Sequence[int], kind: Sequence[str]) -> tuple[str, ...]:
    """Return the warning that rows of images have no position; none without rows."""
    if not lines:
        return ()
    rows = f"line {lines[0]} is" if len(lines) == 1 else f"{len(lines)} lines of images, the first is {lines[0]}, are"
    return (f"{path}: {rows} not used: without a finite number for each of {', '.join(kind)}",)
