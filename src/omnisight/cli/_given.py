"""What a command is given to look at: images, or corners that something else found."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from omnisight.cli._progress import Report
    from omnisight.targets import Board, Detections


@dataclass(frozen=True)
class Given:
    """Images to find a board in, or files of corners, with what the options say beside.

    Attributes
    ----------
    paths
        The images and videos, or the files of corners.
    corners
        Whether they are files of corners.
    board
        The board, where it was told.
    square
        Side of its squares as the user wrote it.
    size
        (width, height) of the images that corners are from, px.
    which
        Which camera, where a file of corners holds several.
    """

    paths: list[Path]
    corners: bool
    board: "Board | None"
    square: str | None
    size: tuple[int, int] | None
    which: str | None

    @classmethod
    def of(
        cls,
        inputs: Sequence[str],
        board: "Board | None",
        *,
        square: str | None,
        image_size: str | None,
        which: str | None,
    ) -> Self:
        """Tell images from files of corners: what has no image, clip or folder among it is corners.

        Raises
        ------
        ValueError
            If there is nothing, or an option cannot be read or is of no use for images.
        """
        from omnisight.cli._size import parse_size
        from omnisight.images import IMAGE_EXTENSIONS, VIDEO_EXTENSIONS, collect_images, expand_path

        found = [path for item in inputs for path in expand_path(item)]
        seen = any(path.suffix.lower() in (*IMAGE_EXTENSIONS, *VIDEO_EXTENSIONS) for path in found)
        if found and not seen and not any(Path(item).expanduser().is_dir() for item in inputs):
            size = None if image_size is None else parse_size(image_size, "--image-size")
            return cls(list(dict.fromkeys(found)), True, board, square, size, which)
        if image_size is not None:
            raise ValueError("--image-size is for files of corners; images say how large they are: leave it out")
        if which is not None:
            raise ValueError("--which is for files of corners of several cameras: leave it out")
        return cls(collect_images(inputs, videos=True), False, board, square, None, None)

    def search(self, report: "Report", *, apply_exif: bool, cache: bool) -> "Detections":
        """Find the board in the images, or read the corners.

        Raises
        ------
        ValueError
            If a file of corners cannot be read, or the files leave something open.
        """
        from omnisight.calibration.warm_up import start_warm_up
        from omnisight.cli._board import search_boards
        from omnisight.corners import read_corners
        from omnisight.targets import parse_length

        if not self.corners:
            # Boards, once found, are not to wait for code to be loaded or compiled.
            start_warm_up()
            return search_boards(self.paths, self.board, self.square, report, apply_exif=apply_exif, cache=cache)
        side = None if self.square is None else parse_length(self.square)
        return read_corners(self.paths, board=self.board, square=side, size=self.size, which=self.which)
