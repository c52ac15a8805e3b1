"""Cube maps: the directions of the faces and their layout in one image."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.rotation import look

# (yaw, pitch) of each face, degrees.
CUBE_FACES = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (-90.0, 0.0),
    "up": (0.0, 90.0),
    "down": (0.0, -90.0),
}
# (row, column) of each face in the cross.
CROSS_LAYOUT = {"up": (0, 1), "left": (1, 0), "front": (1, 1), "right": (1, 2), "back": (1, 3), "down": (2, 1)}


def cube_rotation(face: str, view_from_source: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return face_from_source (3, 3) of a named face, for a cube whose front face has the view direction."""
    yaw, pitch = CUBE_FACES[face]
    return look(yaw, pitch) @ view_from_source


def cube_cross(faces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Join six faces, in the order of `CUBE_FACES`, into a cross; return a single image unchanged."""
    if len(faces) == 1:
        return faces[0]
    side = faces[0].shape[0]
    cross = np.zeros((3 * side, 4 * side, *faces[0].shape[2:]), faces[0].dtype)
    for name, image in zip(CUBE_FACES, faces, strict=True):
        row, column = CROSS_LAYOUT[name]
        cross[row * side : (row + 1) * side, column * side : (column + 1) * side] = image
    return cross
