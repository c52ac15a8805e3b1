"""Read variables of MATLAB's corner files."""

from typing import Any

import numpy as np

from omnisight.corners._protocol import Array
from omnisight.formats._files import encode
from omnisight.formats._mat import SIGNATURE, Matrix, read_mat
from omnisight.formats._values import image_size


def read_variables(text: str) -> dict[str, Any]:
    """Return the variables of a .mat of version 5."""
    return read_mat(encode(text))


def variables_or_none(text: str) -> dict[str, Any] | None:
    """Return the variables of a .mat of version 5, or None if the text is not one."""
    if not text.startswith(SIGNATURE):
        return None
    try:
        return read_variables(text)
    except ValueError:
        return None


def has_variables(text: str, *names: str) -> bool:
    """Return whether a text is a .mat of version 5 with these variables."""
    return set(names) <= set(variables_or_none(text) or ())


def matrix_of(value: Any, name: str) -> Array:
    """Return a variable as an array in its original shape."""
    if not isinstance(value, Matrix):
        raise ValueError(f"{name} is {'missing' if value is None else 'not a matrix of numbers'}")
    return np.array(value, float).reshape(value.shape, order="F")


def structs_of(value: Any, name: str) -> list[dict[str, Any]]:
    """Return a struct or an array of structs as a list."""
    structs = [value] if isinstance(value, dict) else value
    if not isinstance(structs, list) or isinstance(structs, Matrix) or not structs:
        raise ValueError(f"{name} is not a struct")
    return structs


def size_from_rows_columns(value: Any, name: str) -> tuple[int, int]:
    """Return the image size of a variable that holds rows and columns; (0, 0) if it is None."""
    if value is None:
        return (0, 0)
    sides = np.ravel(matrix_of(value, name))
    if len(sides) < 2:
        raise ValueError(f"{name} must be rows and columns, got {len(sides)} numbers")
    return image_size(sides[1], sides[0])
