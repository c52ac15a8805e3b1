"""Finding the format of files of corners, and making of them what a search in images gives."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

from omnisight.corners._clean import found_in
from omnisight.corners._protocol import CornerFormat, Corners, Seen, Told
from omnisight.extensions import module_in, names_in
from omnisight.formats import FormatError
from omnisight.formats._binary import read_file
from omnisight.formats._matlab_file import HDF5, NO_HDF5
from omnisight.formats._registry import DAMAGED
from omnisight.targets import Board, Detections

PACKAGE = "omnisight.corners"
LONGEST = 100  # characters of an image's name


def corner_format_names() -> tuple[str, ...]:
    """Give the names of all formats, sorted: the names of the files here."""
    return names_in(PACKAGE)


def corner_format_named(name: str) -> CornerFormat:
    """Give the format of that name, or say which there are."""
    return cast(CornerFormat, module_in(PACKAGE, name, "format of corners"))


def read_corners(
    paths: Sequence[str | Path],
    *,
    board: Board | None = None,
    square: float | None = None,
    size: tuple[int, int] | None = None,
    which: str | None = None,
) -> Detections:
    """Read files of corners that something else found: what `detect_boards` gives of images, without the images.

    What cannot be used is left out, and `notes` say so: corners that are no numbers or lie outside of the image,
    repeated ones, images with fewer than six, or of another size than the others.

    Parameters
    ----------
    paths
        Files of any formats, told by what they hold; all of one camera.
    board
        The board, where a file does not say.
    square
        The step between neighbouring points, metres. Without it points are in metres where a file says so, and in such
        steps where it does not.
    size
        (width, height) of the images, px, where neither a file nor an image beside it says.
    which
        Which camera, where a file holds several: its name there.

    Raises
    ------
    FormatError
        If a file holds no corners, is damaged, or leaves open what was not told.
    """
    files = [Path(path) for path in paths]
    read = [_corners(path, Told(board, which, _beside(path))) for path in files]
    if len({corners.metres for corners in read}) > 1 and square is None:
        raise FormatError(f"{files[0]}: in metres or not, as the other files are not: give --square, such as 30mm")
    seen: list[tuple[Path, Seen]] = []
    for path, corners in zip(files, read, strict=True):
        several = len(corners.views) > 1
        for k, view in enumerate(corners.views, 1):
            called = _printable(view.picture) or (f"{path.stem}-{k}" if several else path.stem)
            seen.append((_picture(path.parent, called), dataclasses.replace(view, picture=called)))
    try:
        return found_in(seen, metres=read[0].metres, square=square, size=size)
    except ValueError as error:
        raise FormatError(f"{files[0]}{', ...' if len(files) > 1 else ''}: {error}") from error


def _corners(path: Path, told: Told) -> Corners:
    text = read_file(path)
    for name in corner_format_names():
        candidate = corner_format_named(name)
        if not candidate.matches(text):
            continue
        try:
            return candidate.parse(text, told)
        except DAMAGED as error:
            said = str(error) if type(error) is ValueError else f"damaged ({type(error).__name__}: {error})"
            raise FormatError(f"{path}: {candidate.TITLE}: {said}") from error
    if text.startswith(HDF5):
        raise FormatError(f"{path}: {NO_HDF5}")
    raise FormatError(
        f"{path}: neither an image nor corners of a known format (begins with {text.strip()[:40]!r}); known are:"
        f" {', '.join(corner_format_names())}"
    )


def _beside(path: Path) -> Callable[[str], str]:
    """Give what reads the only file of an ending beside this one."""

    def text(suffix: str) -> str:
        found = sorted(path.parent.glob(f"*{suffix}"))
        if len(found) != 1:
            raise ValueError(f"needs one {suffix} beside it, {path.parent} has {len(found) or 'none'}")
        return read_file(found[0])

    return text


def _picture(folder: Path, name: str) -> Path:
    """Give the image of that name where it lies beside the corners; else what it would be called."""
    path = Path(name.replace("\\", "/"))
    inside = not path.is_absolute() and ".." not in path.parts
    if inside and (folder / path).is_file():
        return folder / path
    return folder / path.name


def _printable(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name.strip())[-LONGEST:]
