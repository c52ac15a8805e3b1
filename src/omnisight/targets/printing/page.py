"""Lay out a board on paper: centred, with its quiet zone, a ruler and a description."""

import json
import math
import textwrap
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from omnisight.targets.length import format_length
from omnisight.targets.printing.drawing import Page, Shape, Text, rectangle, translated
from omnisight.targets.printing.paper import MAX_SIDE, local_series, millimetres, paper_sizes

if TYPE_CHECKING:
    from omnisight.targets.boards import Board

# Lengths in metres. No printer reaches the edge of the paper.
PAGE_MARGIN = 0.005
LINE_HEIGHT, FONT_SIZE = 0.003, 0.0023
# Mean width of a letter of Helvetica over its size, with a tenth to spare: a program may take another font.
LETTER_WIDTH = 0.56
# Width beside the ruler from which text fits there.
MIN_TEXT_WIDTH = 0.06
RULER_LENGTHS = (0.1, 0.05, 0.02)
STROKE_WIDTH = 0.0002
# No printer renders a smaller square or disc faithfully.
MIN_PRINTABLE = 0.001
MAX_POINTS = 10_000
# Tolerance of comparisons of lengths.
ROUNDING = 1e-9


@dataclass(frozen=True)
class _Footer:
    """Ruler and text under the board, relative to their own top left corner."""

    ruler: tuple[Shape, ...]
    texts: tuple[Text, ...]
    height: float


def lay_out(board: "Board", paper: str) -> Page:
    """Lay out a board on paper, upright or across as it has more room.

    The board is centred above the footer. The white margin around it is at least half of `board.quiet_zone`, and more
    where there is room.

    Raises
    ------
    ValueError
        If there is no such paper, the board does not fit on it (with what would), or it cannot be printed.
    """
    check_printable(board)
    scale, width, height = max((_max_scale(board, *size), *size) for size in paper_sizes(paper))
    if scale < 1 - ROUNDING:
        raise ValueError(_does_not_fit(board, paper, scale))
    footer = _footer(board, width - 2 * PAGE_MARGIN)
    left, top, right, bottom = board.extent
    board_height = height - footer.height - PAGE_MARGIN
    x, y = (width - right - left) / 2, (board_height - bottom - top) / 2
    return Page(
        title=f"omnisight {board.kind} {board}",
        width=width,
        height=height,
        board=tuple(translated(shape, x, y) for shape in board.drawing()),
        origin=(x, y),
        ruler=tuple(translated(shape, PAGE_MARGIN, board_height) for shape in footer.ruler),
        texts=tuple(replace(t, at=(t.at[0] + PAGE_MARGIN, t.at[1] + board_height)) for t in footer.texts),
    )


def smallest_paper(board: "Board") -> str | None:
    """Return the smallest paper that a board fits on: of the user's territory or, beyond A0, its size; None if none."""
    if named := next((name for name in local_series() if _fits(board, name)), None):
        return named
    # Rounded up to a centimetre.
    width, height = (math.ceil(side * 100) / 100 for side in _required_size(board))
    return f"{width * 1e3:.0f}x{height * 1e3:.0f}mm" if max(width, height) <= MAX_SIDE else None


def check_printable(board: "Board") -> None:
    """Raise ValueError if a board has parts too small to print, or too many of them."""
    for name, length in board.lengths().items():
        if length < MIN_PRINTABLE - ROUNDING:
            raise ValueError(
                f"the {name} of the {board} {board.kind} is {format_length(length)}: less than"
                f" {format_length(MIN_PRINTABLE)} cannot be printed"
            )
    if board.size > MAX_POINTS:
        raise ValueError(
            f"the {board} {board.kind} has {board.size} points: more than {MAX_POINTS} are not printed on one sheet"
        )


def _fits(board: "Board", paper: str) -> bool:
    return any(_max_scale(board, *size) >= 1 - ROUNDING for size in paper_sizes(paper))


def _max_scale(board: "Board", width: float, height: float) -> float:
    """Return the largest scale of the board on this paper; it fits if this is 1 or more."""
    left, top, right, bottom = board.extent
    board_height = height - _footer(board, width - 2 * PAGE_MARGIN).height - PAGE_MARGIN
    sides = ((width, right - left), (board_height, bottom - top))
    return min(min(room / (side + board.quiet_zone), (room - 2 * PAGE_MARGIN) / side) for room, side in sides)


def _required_size(board: "Board") -> tuple[float, float]:
    """Return the width and height in metres of the smallest paper for the board in its orientation."""
    left, top, right, bottom = board.extent
    white = max(board.quiet_zone, 2 * PAGE_MARGIN)
    width = right - left + white
    return width, bottom - top + white + _footer(board, width - 2 * PAGE_MARGIN).height + PAGE_MARGIN


def _does_not_fit(board: "Board", paper: str, scale: float) -> str:
    left, top, right, bottom = board.extent
    lengths = " with" + ",".join(f" {name} {format_length(value)}" for name, value in board.lengths().items())
    message = (
        f"the {board} {board.kind}{lengths} is {millimetres(right - left, bottom - top)} and needs"
        f" {millimetres(*_required_size(board))} of paper with its white margin and the ruler; {paper} offers"
        f" {millimetres(*max(paper_sizes(paper)))}"
    )
    solutions: list[str] = []
    # Rounded down to a tenth of a millimetre.
    if smaller := {name: math.floor(value * scale * 1e4) / 1e4 for name, value in board.lengths().items()}:
        name, value = next(iter(smaller.items()))
        if value > 0:
            solutions.append(f"the largest {name} that fits is {format_length(value)}")
    if larger := smallest_paper(board):
        solutions.append(f"use --paper {larger}")
    return f"{message}: {', or '.join(solutions)}" if solutions else f"{message}."


def _footer(board: "Board", width: float) -> _Footer:
    """Lay out ruler and text in a width, the text beside the ruler if there is room."""
    # Half the width of a number exceeds the ruler at both ends.
    length = next((r for r in RULER_LENGTHS if r + 2 * FONT_SIZE <= width), RULER_LENGTHS[-1])
    shapes, texts = _ruler(FONT_SIZE, LINE_HEIGHT, length)
    ruler_height = LINE_HEIGHT + LINE_HEIGHT + FONT_SIZE / 2
    beside = length + 4 * FONT_SIZE
    paragraphs = [
        f"Print at 100 %, do not fit to page: this ruler must measure {length * 1e3:g} mm.",
        f"omnisight {board.kind} {board}: {', '.join(f'{k} {v}' for k, v in _parameters(board))}",
    ]
    if width - beside >= MIN_TEXT_WIDTH:
        lines = [(beside, line) for text in paragraphs for line in _wrapped(text, width - beside)]
        top, bottom = 0.0, max(ruler_height, len(lines) * LINE_HEIGHT + FONT_SIZE / 2)
    else:
        lines = [(0.0, line) for text in paragraphs for line in _wrapped(text, width)]
        top, bottom = ruler_height, ruler_height + len(lines) * LINE_HEIGHT
    texts += [Text((x, top + i * LINE_HEIGHT + FONT_SIZE), FONT_SIZE, line) for i, (x, line) in enumerate(lines)]
    for line in _wrapped(json.dumps(board.to_dict()), width):
        texts.append(Text((0.0, bottom + FONT_SIZE), FONT_SIZE, line))
        bottom += LINE_HEIGHT
    return _Footer(tuple(shapes), tuple(texts), bottom)


def _ruler(left: float, top: float, length: float) -> tuple[list[Shape], list[Text]]:
    """Return a ruler with a tick per millimetre; its length is between the centres of the first and last tick."""
    shapes: list[Shape] = [rectangle(left, top - STROKE_WIDTH / 2, length, STROKE_WIDTH)]
    texts: list[Text] = []
    for mm in range(round(length * 1e3) + 1):
        x = left + mm / 1e3
        height = LINE_HEIGHT * (1 if mm % 10 == 0 else 0.75 if mm % 5 == 0 else 0.5)
        shapes.append(rectangle(x - STROKE_WIDTH / 2, top - height, STROKE_WIDTH, height))
        if mm % 10 == 0:
            # A digit of Helvetica is 0.556 of its size wide.
            at = x - 0.278 * FONT_SIZE * len(str(mm)), top + LINE_HEIGHT - STROKE_WIDTH
            texts.append(Text(at, FONT_SIZE, str(mm)))
    return shapes, texts


def _parameters(board: "Board") -> list[tuple[str, object]]:
    return [(k, v) for k, v in board.to_dict().items() if k not in ("target", "columns", "rows") and v is not False]


def _wrapped(text: str, width: float) -> list[str]:
    return textwrap.wrap(text, max(10, int(width / (LETTER_WIDTH * FONT_SIZE))))
