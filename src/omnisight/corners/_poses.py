"""Check the board poses of a corner file."""

import numpy as np

from omnisight.corners._protocol import Array

MAX_ROTATION_ERROR = 1e-3  # of an entry of R R^T; text files round to few digits


def check_rotation(matrix: Array, name: str) -> None:
    """Raise ValueError if a matrix (3, 3) is not orthogonal."""
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > MAX_ROTATION_ERROR:
        raise ValueError(f"{name} is not a rotation")
