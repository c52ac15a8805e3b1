"""Kinds of boards: each file of this folder that does not begin with an underscore holds one.

A kind is found by its file. Adding a file adds it to `omnisight target make`, to `--target` and to the tests.
"""

import importlib
import pkgutil
from functools import cache

from omnisight.targets.boards._protocol import Board

__all__ = ["Board", "board_class", "board_kinds"]


@cache
def board_kinds() -> tuple[str, ...]:
    """Give the names of all kinds, sorted: the names of the files here."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


def board_class(kind: str) -> type[Board]:
    """Give the board of that kind; ValueError, with the kinds there are, if there is none."""
    if kind not in board_kinds():
        raise ValueError(f"unknown kind of target {kind!r}; there are: {', '.join(board_kinds())}")
    module = importlib.import_module(f"{__name__}.{kind}")
    return next(
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Board) and value.__module__ == module.__name__
    )
