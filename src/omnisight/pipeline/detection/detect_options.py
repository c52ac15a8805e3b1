"""Options of the detection of boards.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omnisight.pipeline.detection.image_options import ImageOptions

if TYPE_CHECKING:
    from omnisight.targets import Board


@dataclass(frozen=True, kw_only=True)
class DetectOptions(ImageOptions):
    """Options that describe the board and how images are read.

    Attributes
    ----------
    target
        File that describes the board, instead of pattern and square: written by `omnisight target`, or a target
        file of Kalibr (YAML).
    """

    target: Path | None = None

    @property
    def board(self) -> "Board | None":
        """The specified board; None if it is to be determined from the images.

        Raises
        ------
        ValueError
            If it cannot be read, or is specified twice.
        """
        from omnisight.targets.target_file import load_board

        if self.target is None:
            return self.checkerboard
        self.check_one_board()
        return load_board(self.target)


@dataclass(frozen=True, kw_only=True)
class SourceOptions(DetectOptions):
    """Options that describe the board, and how images or corner files are read.

    Attributes
    ----------
    image_size
        Width and height of the images of a corner file, such as 1280x800, if the file does not contain them.
    which
        Name of the camera, if a corner file holds several.
    """

    image_size: str | None = None
    which: str | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of the images that corners are from, px."""
        if self.image_size is None:
            return None
        sides = [side.strip() for side in self.image_size.lower().split("x")]
        if len(sides) != 2 or not all(side.isdigit() and int(side) > 0 for side in sides):
            raise ValueError(f"--image-size must be WIDTHxHEIGHT in px, such as 1280x720, got {self.image_size!r}")
        return int(sides[0]), int(sides[1])
