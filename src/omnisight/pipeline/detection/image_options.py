"""Options that describe a checkerboard and how images are read.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from omnisight.choices import Options

if TYPE_CHECKING:
    from omnisight.targets import Board


@dataclass(frozen=True, kw_only=True)
class ImageOptions(Options):
    """Options that describe a checkerboard and how images are read.

    Attributes
    ----------
    pattern
        Inner corners of the checkerboard, columns x rows: a board of 9x7 squares has 8x6. By default the size that is
        detected in most images.
    squares
        Squares of the checkerboard, columns x rows, in place of pattern: 9x7.
    square
        Side of a square with its unit: 32.5mm. Without it lengths are in squares, which does not change the camera.
    apply_exif
        Rotate images by their EXIF orientation; a calibration needs them as the sensor recorded them.
    cache
        Reuse detections of earlier runs for unchanged images.
    """

    pattern: str | None = None
    squares: str | None = None
    square: str | None = None
    apply_exif: bool = False
    cache: bool = True

    @property
    def checkerboard(self) -> "Board | None":
        """The specified checkerboard; None if it is to be determined from the images."""
        from omnisight.targets import Checkerboard, parse_length

        if self.pattern is not None and self.squares is not None:
            raise ValueError("specify either --pattern, the inner corners, or --squares, one more each way")
        if self.square is not None:
            parse_length(self.square, "--square")
        if self.squares is not None:
            return Checkerboard.of_squares(self.squares, square=self.square)
        return None if self.pattern is None else Checkerboard.parse(self.pattern, square=self.square)

    @property
    def square_m(self) -> float | None:
        """Side of a square, metres."""
        from omnisight.targets import parse_length

        return None if self.square is None else parse_length(self.square, "--square")

    def check_one_board(self) -> None:
        """Raise `ValueError` if a pattern or square is specified besides a target."""
        if any(value is not None for value in (self.pattern, self.squares, self.square)):
            raise ValueError("specify either --target or --pattern and --square: the file holds both")
