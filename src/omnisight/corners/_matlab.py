"""What MATLAB's files of corners have in common."""

from typing import Any

import numpy as np

from omnisight.corners._protocol import Array
from omnisight.formats._matlab_file import Matrix, read_mat

FIRST = 1.0  # of the top-left pixel, and of anything else that is counted


def is_mat(text: str, *names: str) -> bool:
    """Say whether this is a .mat of version 5 that holds those variables."""
    if not text.startswith("MATLAB 5.0 "):
        return False
    try:
        return set(names) <= set(read_mat(text.encode("latin-1")))
    except ValueError:
        return False


def array_of(value: Any, name: str) -> Array:
    """Give a matrix as it was."""
    if not isinstance(value, Matrix):
        raise ValueError(f"{name} is {'missing' if value is None else 'no matrix of numbers'}")
    return np.array(value, float).reshape(value.sizes, order="F")


def structs_of(value: Any, name: str) -> list[dict[str, Any]]:
    """Give one or several structs."""
    found = [value] if isinstance(value, dict) else value
    if not isinstance(found, list) or isinstance(found, Matrix) or not found:
        raise ValueError(f"{name} is no struct")
    return found
