"""Kinds of boards: each file of this folder that does not begin with an underscore holds one.

A kind is found by its file. Adding a file adds it to `omnisight target make`, to `--target` and to the tests.
"""

from omnisight.extensions import class_in, names_in
from omnisight.targets.boards._protocol import Board

__all__ = ["Board", "board_class", "board_kinds"]


def board_kinds() -> tuple[str, ...]:
    """Give the names of all kinds, sorted: the names of the files here."""
    return names_in(__name__)


def board_class(kind: str) -> type[Board]:
    """Give the board of that kind; ValueError, with the kinds there are, if there is none."""
    return class_in(__name__, kind, Board, "kind of target")
