"""The board that a command is told about."""

from pathlib import Path

from omnisight.targets import Board, Checkerboard, parse_length
from omnisight.targets.target_file import load_board


def asked_board(pattern: str | None, square: str | None, target: Path | None) -> Board | None:
    """Give the board of --pattern and --square, or of --target; None if nothing but a square was told.

    Raises
    ------
    ValueError
        If one cannot be read, or both were given.
    """
    if target is not None:
        if pattern is not None or square is not None:
            raise ValueError("give --target, or --pattern and --square, not both: the file says it all")
        return load_board(target)
    if square is not None:
        parse_length(square)
    return None if pattern is None else Checkerboard.parse(pattern, square=square)
