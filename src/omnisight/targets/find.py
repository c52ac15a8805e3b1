"""Finds the board in many images: learns which one it is, skips what cannot be read, and says why."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from omnisight.images import ImageField, UnreadableImage

from .alike import repetition_note, repetitions, repetitions_note
from .boards import Board
from .boards.checkerboard import Checkerboard
from .detection import Detection
from .given import PointTarget
from .grids.grid import Grid
from .handed import is_mirrored
from .look import Look, look_at
from .placing import agreed_pattern, pattern_of, place
from .shown import shown_field, telling
from .sizes import misfit, sizes_note, used_size

_RIM_PX = 2.0
"""How far outside the image circle a corner may seem to be before that is said."""


@dataclass(frozen=True)
class ImageDetection:
    """What one image file gave.

    Attributes
    ----------
    path : Path
    size : (int, int) or None
        Width and height in pixels; None if the file could not be read, or was left out for its size.
    boards : tuple of Detection
        The board, each time it is seen, the one with most points first.
    note : str
        Why there is none, or what else the user should know; may be empty.
    remark : str
        The part of `note` that is not about the boards.
    sharpness : float
        Laplacian energy over contrast energy on the board (on the image where there is none): higher is
        sharper, to be compared within one set; NaN where `size` is None.
    exposure : float
        Gray level of the board's white (of the brightest quarter of the image where there is none): 255 is
        overexposed; NaN where `size` is None.
    blur : float
        Standard deviation in px of the blur across the board's edges; NaN where it was not measured.
    """

    path: Path
    size: tuple[int, int] | None = None
    boards: tuple[Detection, ...] = ()
    note: str = ""
    remark: str = ""
    sharpness: float = float("nan")
    exposure: float = float("nan")
    blur: float = float("nan")

    def with_remark(self, remark: str) -> ImageDetection:
        """Give it with something more to know."""
        return replace(self, note=_joined(self.note, remark), remark=_joined(self.remark, remark))

    def with_boards(self, boards: Sequence[Detection], board: Board) -> ImageDetection:
        """Give it with other detections of the board."""
        return replace(self, boards=tuple(boards), note=_joined(_boards_note(boards, board), self.remark))

    @property
    def detection(self) -> Detection | None:
        """The board seen best; None if there is none."""
        return self.boards[0] if self.boards else None


@dataclass(frozen=True)
class Detections:
    """What a set of images gave.

    Attributes
    ----------
    board : Board, PointTarget or None
        The one that was asked for, or that the images agree on; None if they show none. A target that is only given
        came with its corners.
    images : list of ImageDetection
        One for each path, in the order given.
    hint : str or None
        Said where the images show another board than the one that was asked for.
    field : ImageField or None
        Where the lens or mirror shows anything.
    notes : tuple of str
        What the user should know of the set: sizes that differ, images that repeat others, a mirror.
    """

    board: Board | PointTarget | None
    images: list[ImageDetection] = field(default_factory=list[ImageDetection])
    hint: str | None = None
    field: ImageField | None = None
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images that are used, px; (0, 0) if none could be read."""
        return next((picture.size for picture in self.images if picture.size is not None), (0, 0))

    @property
    def found(self) -> list[ImageDetection]:
        """The images that show the board."""
        return [picture for picture in self.images if picture.boards]


def detect_boards(
    paths: Iterable[str | Path],
    board: Board | None = None,
    *,
    square: float | None = None,
    apply_exif: bool = False,
    cache: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Detections:
    """Find a board in each image.

    Images of another size than most of those with a board are another camera's: they are left out, with a note.

    Parameters
    ----------
    paths : iterable of str or Path
    board : Board, optional
        Without one a checkerboard is looked for, of the size that most images agree on.
    square : float, optional
        Side in metres of such a checkerboard's squares.
    apply_exif : bool
        Turn images upright by their EXIF orientation first.
    cache : bool
        Take detections from earlier runs, and keep these for later ones.
    progress : callable, optional
        Called with (images done, images in all) after each.
    """
    paths = [Path(path) for path in paths]

    told = set(telling(len(paths)).tolist())

    def see(index: int) -> Look | UnreadableImage:
        try:
            return look_at(paths[index], board, apply_exif=apply_exif, cache=cache, keep=index in told)
        except UnreadableImage as error:
            return error

    looks: list[Look | UnreadableImage] = []
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        for look in pool.map(see, range(len(paths))):
            looks.append(look)
            if progress is not None:
                progress(len(looks), len(paths))
    seen = [(path, look) for path, look in zip(paths, looks, strict=True) if isinstance(look, Look)]
    size = used_size([(look.size, bool(look.grids or look.boards)) for _, look in seen])
    kept = [(path, look) for path, look in seen if look.size == size]
    agreed = agreed_pattern([look.grids for _, look in kept])
    if board is None and agreed is not None:
        board = Checkerboard(*agreed, square=square)
    chosen = [kept[i] for i in telling(len(kept))] if kept else []
    shown = shown_field([p for p, _ in chosen], [look for _, look in chosen], apply_exif=apply_exif, cache=cache)
    pictures = [_picture(path, look, board, size) for path, look in zip(paths, looks, strict=True)]
    pictures = [_flagged(picture, shown) for picture in pictures]
    notes: list[str] = []
    if size is not None and (note := sizes_note([(path.name, look.size) for path, look in seen], size)):
        notes.append(note)
    if not apply_exif and (turned := [path for path, look in seen if look.orientation != 1]):
        orientation = next(look.orientation for path, look in seen if path == turned[0])
        note = f"EXIF orientation {orientation} ignored, here and in the other images: the sensor does not turn"
        first = paths.index(turned[0])
        pictures[first] = pictures[first].with_remark(note)
    if size is not None:
        pictures, note = _repeating(pictures, size)
        notes += note
    if board is not None:
        notes += _mirrored(pictures, board)
    hint = _hint([look for _, look in kept], pictures, board, agreed) if isinstance(board, Checkerboard) else None
    return Detections(board, pictures, hint, shown, tuple(notes))


def _repeating(pictures: list[ImageDetection], size: tuple[int, int]) -> tuple[list[ImageDetection], list[str]]:
    """Say it where images show what another one showed; also what to say of the set."""
    repeated = repetitions([picture.boards for picture in pictures], size)
    if not repeated:
        return pictures, []
    said = list(pictures)
    for i, (other, moved) in repeated.items():
        said[i] = pictures[i].with_remark(repetition_note(pictures[other].path.name, moved))
    found = sum(bool(picture.boards) for picture in pictures)
    return said, [repetitions_note(len(repeated), found, max(moved for _, moved in repeated.values()))]


def _mirrored(pictures: Sequence[ImageDetection], board: Board) -> list[str]:
    """Say it where markers are read in a mirror image."""
    names = [p.path.name for p in pictures if any(is_mirrored(d, board) for d in p.boards)]
    if not names:
        return []
    found = sum(bool(picture.boards) for picture in pictures)
    which = "all" if len(names) == found else f"{len(names)} of {found}"
    return [
        f"the markers match only when mirrored in {which} images with a board ({', '.join(names[:3])}"
        f"{', ...' if len(names) > 3 else ''}): a webcam's mirror mode? Turn it off; a camera that looks into a mirror"
        " does see it so"
    ]


def _picture(
    path: Path, look: Look | UnreadableImage, board: Board | None, size: tuple[int, int] | None
) -> ImageDetection:
    if isinstance(look, UnreadableImage):
        return ImageDetection(path, note=str(look))
    if size is not None and look.size != size:
        return ImageDetection(path, note=misfit(look.size, size))
    placed = [replace(detection, board=board) for detection in look.boards]  # remembered without it
    used: list[Grid] = []
    if isinstance(board, Checkerboard):
        for grid in look.grids:
            detection = place(grid, board)
            if detection is not None:
                placed.append(detection)
                used.append(grid)
    return ImageDetection(
        path,
        look.size,
        tuple(placed),
        _note(look, placed, board),
        sharpness=look.sharpness,
        exposure=used[0].white if used else look.exposure,
        blur=used[0].blur if used else float("nan"),
    )


def _flagged(picture: ImageDetection, shown: ImageField | None) -> ImageDetection:
    """Say it where corners lie outside of what the lens shows."""
    if shown is None or not picture.boards:
        return picture
    outside = sum(int((~shown.contains(d.pixels, -_RIM_PX)).sum()) for d in picture.boards)
    return picture.with_remark(f"{outside} corners outside of what the lens shows") if outside else picture


def _note(look: Look, placed: Sequence[Detection], board: Board | None) -> str:
    if board is None:
        return "no checkerboard found"
    if not placed:
        other = [pattern_of(grid) for grid in look.grids]
        seen = f", but one of {other[0][0]}x{other[0][1]}" if other else ""
        return f"no {board} board found{seen}"
    return _boards_note(placed, board)


def _boards_note(placed: Sequence[Detection], board: Board) -> str:
    """Say what is unusual about the boards found in an image."""
    notes = [f"{len(placed)} boards"] if len(placed) > 1 else []
    notes += [f"{len(d)} of {board.size} corners" for d in placed if len(d) < board.size]
    if not all(d.located for d in placed):
        notes.append("which part of the board is not known")
    notes += dict.fromkeys(d.note for d in placed)
    return _joined(*notes)


def _joined(*notes: str) -> str:
    return "; ".join(filter(None, notes))


def _hint(
    looks: Sequence[Look],
    pictures: Sequence[ImageDetection],
    board: Checkerboard,
    agreed: tuple[int, int] | None,
) -> str | None:
    """Say that images show another board than the given one, if more of them do than not."""
    if agreed is None or sorted(agreed) == sorted((board.columns, board.rows)):
        return None
    count = sum(any(pattern_of(grid) == agreed for grid in look.grids) for look in looks)
    whole = sum(any(len(d) > 0.9 * board.size for d in picture.boards) for picture in pictures)
    if count <= whole:
        return None
    columns, rows = agreed
    squares = sorted((board.columns - 1, board.rows - 1)) == sorted(agreed)
    reason = f"{board} squares have {columns}x{rows} inner corners" if squares else "did you count squares?"
    return (
        f"found a {columns}x{rows} grid of inner corners in {count}/{len(looks)} images "
        f"but the board asked for is {board} ({reason}). Use --pattern {columns}x{rows}."
    )
