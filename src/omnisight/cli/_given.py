"""Corners that something else found, in place of pictures."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omnisight.targets import Board, BoardSearch


def corner_files(inputs: Sequence[str]) -> list[Path]:
    """Give the files of corners among what may be pictures; none where there is a picture, a clip or a folder."""
    from omnisight.images import CLIPS, EXTENSIONS, expand

    found = [path for item in inputs for path in expand(item)]
    pictures = any(path.suffix.lower() in (*EXTENSIONS, *CLIPS) for path in found)
    return [] if pictures or any(Path(item).expanduser().is_dir() for item in inputs) else list(dict.fromkeys(found))


def given_corners(
    files: Sequence[Path], board: "Board | None", square: str | None, image_size: str | None, which: str | None
) -> "BoardSearch":
    """Read files of corners, with what the options tell beside.

    Raises
    ------
    ValueError
        If an option or a file cannot be read, or the files leave something open.
    """
    from omnisight.cli._size import parse_size
    from omnisight.corners import read_corners
    from omnisight.targets import parse_length

    side = None if square is None else parse_length(square)
    size = None if image_size is None else parse_size(image_size, "--image-size")
    return read_corners(files, board=board, square=side, size=size, which=which)


def must_be_corners(image_size: str | None, which: str | None) -> None:
    """Refuse options that pictures have no use for."""
    if image_size is not None:
        raise ValueError("--image-size is for files of corners; pictures say how large they are: leave it out")
    if which is not None:
        raise ValueError("--which is for files of corners of several cameras: leave it out")
