"""Finds the board in many pictures: learns which one it is, skips what cannot be read, and says why."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from omnisight.images import ImageField, UnreadableImage

from .boards import Board
from .boards.checkerboard import Checkerboard
from .detection import Detection
from .grids.grid import Grid
from .look import Look, look_at
from .placing import agreed_pattern, pattern_of, place
from .shown import shown_field, telling

_RIM_PX = 2.0
"""How far outside the image circle a corner may seem to be before that is said."""


@dataclass(frozen=True)
class PictureDetection:
    """What one picture file gave.

    Attributes
    ----------
    path : Path
    size : (int, int) or None
        Width and height in pixels; None if the file could not be read.
    boards : tuple of Detection
        The board, each time it is seen, the one with most points first.
    note : str
        Why there is none, or what else the user should know; may be empty.
    remark : str
        The part of `note` that is not about the boards.
    sharpness : float
        Laplacian energy over contrast energy on the board (on the picture where there is none): higher is
        sharper, to be compared within one set; NaN if the file could not be read.
    exposure : float
        Gray level of the board's white (of the brightest quarter of the picture where there is none): 255 is
        overexposed; NaN if the file could not be read.
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

    def with_remark(self, remark: str) -> PictureDetection:
        """Give it with something more to know."""
        return replace(self, note=_joined(self.note, remark), remark=_joined(self.remark, remark))

    def with_boards(self, boards: Sequence[Detection], board: Board) -> PictureDetection:
        """Give it with other detections of the board."""
        return replace(self, boards=tuple(boards), note=_joined(_boards_note(boards, board), self.remark))

    @property
    def detection(self) -> Detection | None:
        """The board seen best; None if there is none."""
        return self.boards[0] if self.boards else None


@dataclass(frozen=True)
class BoardSearch:
    """What a set of pictures gave.

    Attributes
    ----------
    board : Board or None
        The one that was asked for, or that the pictures agree on; None if they show none.
    pictures : list of PictureDetection
        One for each path, in the order given.
    hint : str or None
        Said where the pictures show another board than the one that was asked for.
    field : ImageField or None
        Where the lens or mirror shows anything.
    """

    board: Board | None
    pictures: list[PictureDetection] = field(default_factory=list[PictureDetection])
    hint: str | None = None
    field: ImageField | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures, px; (0, 0) if none could be read."""
        return next((picture.size for picture in self.pictures if picture.size is not None), (0, 0))

    @property
    def found(self) -> list[PictureDetection]:
        """The pictures that show the board."""
        return [picture for picture in self.pictures if picture.boards]


def find_boards(
    paths: Iterable[str | Path],
    board: Board | None = None,
    *,
    square: float | None = None,
    apply_exif: bool = False,
    cache: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> BoardSearch:
    """Find a board in each picture.

    Parameters
    ----------
    paths : iterable of str or Path
    board : Board, optional
        Without one a checkerboard is looked for, of the size that most pictures agree on.
    square : float, optional
        Side in metres of such a checkerboard's squares.
    apply_exif : bool
        Turn pictures upright by their EXIF orientation first.
    cache : bool
        Take detections from earlier runs, and keep these for later ones.
    progress : callable, optional
        Called with (pictures done, pictures in all) after each.

    Raises
    ------
    ValueError
        If the pictures differ in size.
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
    check_sizes([(path.name, look.size) for path, look in zip(paths, looks, strict=True) if isinstance(look, Look)])
    agreed = agreed_pattern([look.grids for look in looks if isinstance(look, Look)])
    if board is None and agreed is not None:
        board = Checkerboard(*agreed, square=square)
    chosen = [(path, look) for i, (path, look) in enumerate(zip(paths, looks, strict=True)) if i in told]
    readable = {path: look for path, look in chosen if isinstance(look, Look)}
    shown = shown_field(list(readable), list(readable.values()), apply_exif=apply_exif, cache=cache)
    pictures = [_picture(path, look, board) for path, look in zip(paths, looks, strict=True)]
    pictures = [_flagged(picture, shown) for picture in pictures]
    turned = [isinstance(look, Look) and look.orientation != 1 and not apply_exif for look in looks]
    if any(turned):
        first = turned.index(True)
        orientation = next(look.orientation for look in looks[first:] if isinstance(look, Look))
        note = f"EXIF orientation {orientation} ignored, here and in the other pictures: the sensor does not turn"
        pictures[first] = pictures[first].with_remark(note)
    hint = _hint(looks, pictures, board, agreed) if isinstance(board, Checkerboard) else None
    return BoardSearch(board, pictures, hint, shown)


def check_sizes(named: Sequence[tuple[str, tuple[int, int]]]) -> None:
    """Raise ValueError, with the counts, if pictures, each (name, size), differ in size."""
    by_size: dict[tuple[int, int], list[str]] = {}
    for name, size in named:
        by_size.setdefault(size, []).append(name)
    if len(by_size) < 2:
        return
    ordered = sorted(by_size.items(), key=lambda item: -len(item[1]))
    (width, height), _ = ordered[0]
    parts: list[str] = []
    for size, names in ordered:
        part = f"{len(names)} of {size[0]}x{size[1]}"
        if size != (width, height):
            part += f" ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"
        if size == (height, width) != (width, height):
            part += ", rotated 90 degrees?"
        parts.append(part)
    raise ValueError(f"pictures have {len(by_size)} sizes: {'; '.join(parts)}. Calibrate one size at a time.")


def _picture(path: Path, look: Look | UnreadableImage, board: Board | None) -> PictureDetection:
    if isinstance(look, UnreadableImage):
        return PictureDetection(path, note=str(look))
    placed = [replace(detection, board=board) for detection in look.boards]  # remembered without it
    used: list[Grid] = []
    if isinstance(board, Checkerboard):
        for grid in look.grids:
            detection = place(grid, board)
            if detection is not None:
                placed.append(detection)
                used.append(grid)
    return PictureDetection(
        path,
        look.size,
        tuple(placed),
        _note(look, placed, board),
        sharpness=look.sharpness,
        exposure=used[0].white if used else look.exposure,
        blur=used[0].blur if used else float("nan"),
    )


def _flagged(picture: PictureDetection, shown: ImageField | None) -> PictureDetection:
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
    """Say what is unusual about the boards found in a picture."""
    notes = [f"{len(placed)} boards"] if len(placed) > 1 else []
    notes += [f"{len(d)} of {board.size} corners" for d in placed if len(d) < board.size]
    if not all(d.located for d in placed):
        notes.append("which part of the board is not known")
    notes += dict.fromkeys(d.note for d in placed)
    return _joined(*notes)


def _joined(*notes: str) -> str:
    return "; ".join(filter(None, notes))


def _hint(
    looks: Sequence[Look | UnreadableImage],
    pictures: Sequence[PictureDetection],
    board: Checkerboard,
    agreed: tuple[int, int] | None,
) -> str | None:
    """Say that pictures show another board than the given one, if more of them do than not."""
    if agreed is None or sorted(agreed) == sorted((board.columns, board.rows)):
        return None
    readable = [look for look in looks if isinstance(look, Look)]
    count = sum(any(pattern_of(grid) == agreed for grid in look.grids) for look in readable)
    whole = sum(any(len(d) > 0.9 * board.size for d in picture.boards) for picture in pictures)
    if count <= whole:
        return None
    columns, rows = agreed
    squares = sorted((board.columns - 1, board.rows - 1)) == sorted(agreed)
    reason = f"{board} squares have {columns}x{rows} inner corners" if squares else "did you count squares?"
    return (
        f"found a {columns}x{rows} grid of inner corners in {count}/{len(readable)} pictures "
        f"but the board asked for is {board} ({reason}). Use --pattern {columns}x{rows}."
    )
