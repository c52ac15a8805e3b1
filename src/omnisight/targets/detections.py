"""Results of detection: a board in an image, an image file, and a set of image files."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.images import ImageField
from omnisight.targets.boards import Board
from omnisight.targets.point_target import PointTarget


@dataclass(frozen=True, eq=False)
class Detection(Displayed):
    """Board points detected in one image; a part of a board is a detection too.

    Attributes
    ----------
    ids : (N,) array of int
        Rows of `Board.points`, ascending.
    pixels : (N, 2) array of float64
        (u, v); integers are pixel centres, the top-left pixel is (0, 0).
    covariance : (N, 2, 2) array of float64
        Of `pixels`, px^2.
    located : bool
        Whether the position on the board is unique. If not, `ids` are those of one of several positions that look the
        same: the steps between the points are right, which is all that calibrating a camera needs, but the origin may
        not be.
    note : str
        What the user should know, such as that the print differs from the requested board; may be empty.
    board : Board or None
        The board whose points `ids` number; None if unknown.
    """

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]
    covariance: NDArray[np.float64]
    located: bool = True
    note: str = ""
    board: Board | None = None

    def __post_init__(self) -> None:
        count = len(self.ids)
        if self.ids.ndim != 1 or self.pixels.shape != (count, 2) or self.covariance.shape != (count, 2, 2):
            raise ValueError(
                f"expected ids (N,), pixels (N, 2) and covariance (N, 2, 2), got shapes {self.ids.shape},"
                f" {self.pixels.shape} and {self.covariance.shape}"
            )

    def __len__(self) -> int:
        return len(self.ids)

    def resized(self, scale: NDArray[np.float64]) -> "Detection":
        """Return the detection in the image enlarged by `scale` (2,) along u and v."""
        return replace(
            self, pixels=(self.pixels + 0.5) * scale - 0.5, covariance=self.covariance * np.outer(scale, scale)
        )


@dataclass(frozen=True)
class ImageDetection(Displayed):
    """Detections in one image file.

    Attributes
    ----------
    path : Path
    size : (int, int) or None
        Width and height in pixels; None if the file cannot be read or is left out.
    boards : tuple of Detection
        One per time that the board is seen, the one with most points first.
    note : str
        Why there is no detection, or what else the user should know, without the file name; may be empty.
    remark : str
        The part of `note` that is not about the boards.
    sharpness : float
        Laplacian energy over contrast energy on the board (on the image if there is none): higher is sharper, to be
        compared within one set; NaN if `size` is None.
    exposure : float
        Gray level of the board's white (of the brightest quarter of the image if there is none): 255 is overexposed;
        NaN if `size` is None.
    blur : float
        Standard deviation in px of the blur across the board's edges; NaN if not measured.
    """

    path: Path
    size: tuple[int, int] | None = None
    boards: tuple[Detection, ...] = ()
    note: str = ""
    remark: str = ""
    sharpness: float = float("nan")
    exposure: float = float("nan")
    blur: float = float("nan")

    def with_remark(self, remark: str) -> "ImageDetection":
        """Return a copy with a further remark."""
        return replace(self, note=joined(self.note, remark), remark=joined(self.remark, remark))

    def with_boards(self, boards: Sequence[Detection], board: Board) -> "ImageDetection":
        """Return a copy with other detections of the board."""
        return replace(self, boards=tuple(boards), note=joined(boards_note(boards, board), self.remark))

    @property
    def detection(self) -> Detection | None:
        """The detection with most points; None if there is none."""
        return self.boards[0] if self.boards else None


@dataclass(frozen=True)
class Detections(Displayed):
    """Detections in a set of images.

    Attributes
    ----------
    board : Board, PointTarget or None
        The requested board, or the one that most images show; None if they show none. A `PointTarget` comes with
        corners from a file.
    images : list of ImageDetection
        One per path, in the order given.
    hint : str or None
        What to change if the images show another board than the requested one.
    field : ImageField or None
        The part of the images that the lens or mirror covers.
    notes : tuple of str
        What the user should know of the set: several sizes, duplicates, mirrored images.
    assumption : str
        What was recognized and assumed of a board that was not specified; empty for a checkerboard.
    """

    board: Board | PointTarget | None
    images: list[ImageDetection] = field(default_factory=list[ImageDetection])
    hint: str | None = None
    field: ImageField | None = None
    notes: tuple[str, ...] = ()
    assumption: str = ""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images that are used, px; (0, 0) if none could be read."""
        return next((image.size for image in self.images if image.size is not None), (0, 0))

    @property
    def found(self) -> list[ImageDetection]:
        """Images that show the board."""
        return [image for image in self.images if image.boards]


def boards_note(boards: Sequence[Detection], board: Board) -> str:
    """Return what is unusual about the boards in an image."""
    notes = [f"{len(boards)} boards"] if len(boards) > 1 else []
    notes += [f"{len(d)} of {board.size} corners" for d in boards if len(d) < board.size]
    if not all(d.located for d in boards):
        notes.append("position on the board is ambiguous")
    notes += dict.fromkeys(d.note for d in boards)
    return joined(*notes)


def joined(*notes: str) -> str:
    """Join notes that are not empty."""
    return "; ".join(filter(None, notes))
