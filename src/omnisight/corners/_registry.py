"""Find the format of corner files and convert their corners to detections."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

from omnisight.corners._detections import make_detections
from omnisight.corners._protocol import CornerFile, CornerFormat, ImageCorners, ReadOptions
from omnisight.extensions import module_in, names_in
from omnisight.formats import FormatError
from omnisight.formats._files import read_file
from omnisight.formats._limits import MAX_NAME_CHARS
from omnisight.formats._mat import HDF5_ERROR, HDF5_SIGNATURES
from omnisight.formats._registry import PARSE_ERRORS, parse_error_message
from omnisight.targets import Board, Detections

PACKAGE = "omnisight.corners"


def corner_format_names() -> tuple[str, ...]:
    """Return the names of all formats, sorted: the names of the files in this folder."""
    return names_in(PACKAGE)


def get_corner_format(name: str) -> CornerFormat:
    """Return the format of this name; raise ValueError with the known names if there is none."""
    return cast(CornerFormat, module_in(PACKAGE, name, "corner format"))


def read_corners(
    paths: Sequence[str | Path],
    *,
    board: Board | None = None,
    square: float | None = None,
    size: tuple[int, int] | None = None,
    which: str | None = None,
) -> Detections:
    """Read corner files of other programs and return what `detect_boards` returns for images.

    Unusable data is left out and listed in `notes`: corners that are not finite or outside the image, duplicates,
    images with fewer than six corners, and images whose size differs from the others.

    Parameters
    ----------
    paths
        Corner files of any formats, all of one camera; the content determines the format.
    board
        The board, for files that do not hold one.
    square
        The distance of neighbouring points, metres. Without it, points are in metres if the file specifies that, and
        in units of this distance otherwise.
    size
        (width, height) of the images, px, if neither the file nor an image beside it specifies it.
    which
        The name of the camera in a file that holds several.

    Raises
    ------
    FormatError
        If a file holds no corners or is damaged, or a parameter is missing.
    """
    files = [Path(path) for path in paths]
    read = [_read(path, ReadOptions(board, which, _sibling_reader(path))) for path in files]
    if len({corners.in_metres for corners in read}) > 1 and square is None:
        raise FormatError(f"{files[0]}: points in metres in some files only: specify --square, such as 30mm")
    images: list[tuple[Path, ImageCorners]] = []
    for path, corners in zip(files, read, strict=True):
        for k, image in enumerate(corners.images, 1):
            default = f"{path.stem}-{k}" if len(corners.images) > 1 else path.stem
            name = _printable(image.name) or default
            images.append((_image_path(path.parent, name), dataclasses.replace(image, name=name)))
    try:
        return make_detections(images, in_metres=read[0].in_metres, square=square, size=size)
    except ValueError as error:
        raise FormatError(f"{files[0]}{', ...' if len(files) > 1 else ''}: {error}") from error


def _read(path: Path, options: ReadOptions) -> CornerFile:
    """Read a corner file of any format."""
    text = read_file(path)
    for name in corner_format_names():
        candidate = get_corner_format(name)
        if not candidate.matches(text):
            continue
        try:
            return candidate.parse(text, options)
        except PARSE_ERRORS as error:
            raise FormatError(f"{path}: {candidate.TITLE}: {parse_error_message(error)}") from error
    if text.startswith(HDF5_SIGNATURES):
        raise FormatError(f"{path}: {HDF5_ERROR}")
    raise FormatError(
        f"{path}: neither an image nor a corner file of a known format (begins with {text.strip()[:40]!r}); known"
        f" formats: {', '.join(corner_format_names())}"
    )


def _sibling_reader(path: Path) -> Callable[[str], str]:
    """Return a function that reads the only file with an ending in the folder of this file."""

    def read_sibling(suffix: str) -> str:
        siblings = sorted(path.parent.glob(f"*{suffix}"))
        if len(siblings) != 1:
            raise ValueError(f"needs one {suffix} beside it, {path.parent} has {len(siblings) or 'none'}")
        return read_file(siblings[0])

    return read_sibling


def _image_path(folder: Path, name: str) -> Path:
    """Return the path of an image beside a corner file; a name never leads out of the folder."""
    path = Path(name.replace("\\", "/"))
    inside = not path.is_absolute() and ".." not in path.parts
    if inside and (folder / path).is_file():
        return folder / path
    return folder / path.name


def _printable(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name.strip())[-MAX_NAME_CHARS:]
