"""Kinds of boards: each file of this folder without a leading underscore holds one, as data.

Adding a file adds the board to `omnisight target`, to `--target` and to the tests.
"""

from omnisight.extensions import class_in, names_in
from omnisight.targets.boards._protocol import Board

__all__ = ["Board", "board_class", "board_kinds"]


def board_kinds() -> tuple[str, ...]:
    """Return the names of all kinds, sorted: the names of the files in this folder."""
    return names_in(__name__)


def board_class(kind: str) -> type[Board]:
    """Return the class of a kind of board; raise ValueError, with the known kinds, if there is none."""
    return class_in(__name__, kind, Board, "kind of target")
