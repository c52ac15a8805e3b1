"""Lays a board on paper: in the middle, with its white margin, and under it a ruler and what the board is."""

from __future__ import annotations

import json
import math
import textwrap
from dataclasses import dataclass, replace

from omnisight.targets.boards import Board
from omnisight.targets.length import format_length
from omnisight.targets.printing.drawing import Page, Shape, Text, moved, rectangle
from omnisight.targets.printing.paper import millimetres, paper_sizes

MARGIN = 0.005
"""No printer reaches the edge of the paper."""
LINE, LETTER = 0.003, 0.0023
"""From line to line, and the size of letters, in metres."""
WIDTH = 0.56
"""A letter's width over its size, as of lines of Helvetica with a tenth to spare: a program may take another font."""
BESIDE = 0.06
"""Where less is left beside the ruler, the words go under it."""
RULERS = 0.1, 0.05, 0.02
TICK, STROKE = 0.003, 0.0002
FINEST = 0.001
"""No printer makes a sound square or disc of less, in metres."""
MOST_POINTS = 10_000
SERIES = "A4", "A3", "A2", "A1", "A0"


@dataclass(frozen=True)
class _Strip:
    """What stands under the board, from its own top left corner."""

    ruler: tuple[Shape, ...]
    texts: tuple[Text, ...]
    height: float


def lay_out(board: Board, paper: str) -> Page:
    """Lay a board on paper, upright or across as it has more room.

    The board is in the middle of what the strip under it leaves. Around it stays white at least half of `board.quiet`,
    a square of a checkerboard, and more where there is room.

    Raises
    ------
    ValueError
        If there is no such paper, or the board does not fit on it: tells what would. If it cannot be printed.
    """
    check_printable(board)
    room, width, height = max((_room(board, *size), *size) for size in paper_sizes(paper))
    if room < 1 - 1e-9:
        raise ValueError(_does_not_fit(board, paper, room))
    strip = _strip(board, width - 2 * MARGIN)
    left, top, right, bottom = board.extent
    free = height - strip.height - MARGIN
    x, y = (width - right - left) / 2, (free - bottom - top) / 2
    return Page(
        title=f"omnisight {board.kind} {board}",
        width=width,
        height=height,
        board=tuple(moved(shape, x, y) for shape in board.drawing()),
        origin=(x, y),
        ruler=tuple(moved(shape, MARGIN, free) for shape in strip.ruler),
        texts=tuple(replace(t, at=(t.at[0] + MARGIN, t.at[1] + free)) for t in strip.texts),
    )


def smallest_paper(board: Board) -> str:
    """Give the smallest of A4, A3, A2, A1, A0 that the board fits on; ValueError if there is none."""
    check_printable(board)
    for paper in SERIES:
        if _fits(board, paper):
            return paper
    width, height = _needs(board)
    raise ValueError(
        f"the {board} {board.kind} needs {millimetres(width, height)} of paper, more than A0: give --paper, such as"
        f" {math.ceil(width * 100) * 10}x{math.ceil(height * 100) * 10}mm"
    )


def check_printable(board: Board) -> None:
    """Refuse a board with parts too small to print, or too many of them: ValueError."""
    for name, length in board.lengths().items():
        if length < FINEST - 1e-9:
            raise ValueError(
                f"the {name} of the {board} {board.kind} is {format_length(length)}: less than"
                f" {format_length(FINEST)} cannot be printed"
            )
    if board.size > MOST_POINTS:
        raise ValueError(
            f"the {board} {board.kind} has {board.size} points: more than {MOST_POINTS} are not printed on one sheet"
        )


def _fits(board: Board, paper: str) -> bool:
    return any(_room(board, *size) >= 1 - 1e-9 for size in paper_sizes(paper))


def _room(board: Board, width: float, height: float) -> float:
    """Give how many times as large the board could be on this paper; it fits if this is 1 or more."""
    left, top, right, bottom = board.extent
    free = height - _strip(board, width - 2 * MARGIN).height - MARGIN
    sides = ((width, right - left), (free, bottom - top))
    return min(min(there / (side + board.quiet), (there - 2 * MARGIN) / side) for there, side in sides)


def _needs(board: Board) -> tuple[float, float]:
    """Give the width and height in metres of the least paper for the board as it lies."""
    left, top, right, bottom = board.extent
    white = max(board.quiet, 2 * MARGIN)
    width = right - left + white
    return width, bottom - top + white + _strip(board, width - 2 * MARGIN).height + MARGIN


def _does_not_fit(board: Board, paper: str, room: float) -> str:
    left, top, right, bottom = board.extent
    has = " with" + ",".join(f" {name} {format_length(value)}" for name, value in board.lengths().items())
    said = (
        f"the {board} {board.kind}{has} is {millimetres(right - left, bottom - top)} and needs"
        f" {millimetres(*_needs(board))} of paper with its white margin and the ruler; {paper} offers"
        f" {millimetres(*max(paper_sizes(paper)))}."
    )
    offers: list[str] = []
    # Rounded down to a tenth of a millimetre.
    if smaller := {name: math.floor(value * room * 1e4) / 1e4 for name, value in board.lengths().items()}:
        first, value = next(iter(smaller.items()))
        if value > 0:
            offers.append(f"the largest {first} that fits is {format_length(value)}")
    if larger := next((name for name in SERIES if _fits(board, name)), None):
        offers.append(f"use {larger}")
    return f"{said[:-1]}: {', or '.join(offers)}" if offers else said


def _strip(board: Board, width: float) -> _Strip:
    """Lay ruler and words into that width, the words beside the ruler where there is room for them."""
    # Half the width of a number stands out at the ruler's ends.
    length = next((r for r in RULERS if r + 2 * LETTER <= width), RULERS[-1])
    shapes, texts = _ruler(LETTER, TICK, length)
    ruler_height = TICK + LINE + LETTER / 2
    beside = length + 4 * LETTER
    words = [
        f"Print at 100 %, do not fit to page: this ruler must measure {length * 1e3:g} mm.",
        f"omnisight {board.kind} {board}: {', '.join(f'{k} {v}' for k, v in _parameters(board))}",
    ]
    if width - beside >= BESIDE:
        lines = [(beside, line) for text in words for line in _wrapped(text, width - beside)]
        top, under = 0.0, max(ruler_height, len(lines) * LINE + LETTER / 2)
    else:
        lines = [(0.0, line) for text in words for line in _wrapped(text, width)]
        top, under = ruler_height, ruler_height + len(lines) * LINE
    texts += [Text((x, top + i * LINE + LETTER), LETTER, line) for i, (x, line) in enumerate(lines)]
    for line in _wrapped(json.dumps(board.to_dict()), width):
        texts.append(Text((0.0, under + LETTER), LETTER, line))
        under += LINE
    return _Strip(tuple(shapes), tuple(texts), under)


def _ruler(left: float, top: float, length: float) -> tuple[list[Shape], list[Text]]:
    """Give a ruler with a tick at each millimetre; its length is from the middle of the first to that of the last."""
    shapes: list[Shape] = [rectangle(left, top - STROKE / 2, length, STROKE)]
    texts: list[Text] = []
    for mm in range(round(length * 1e3) + 1):
        x = left + mm / 1e3
        tall = TICK * (1 if mm % 10 == 0 else 0.75 if mm % 5 == 0 else 0.5)
        shapes.append(rectangle(x - STROKE / 2, top - tall, STROKE, tall))
        if mm % 10 == 0:
            # A digit of Helvetica is 0.556 of its size wide.
            texts.append(Text((x - 0.278 * LETTER * len(str(mm)), top + LINE - STROKE), LETTER, str(mm)))
    return shapes, texts


def _parameters(board: Board) -> list[tuple[str, object]]:
    return [(k, v) for k, v in board.to_dict().items() if k not in ("target", "columns", "rows") and v is not False]


def _wrapped(text: str, width: float) -> list[str]:
    return textwrap.wrap(text, max(10, int(width / (WIDTH * LETTER))))
