"""MATLAB's imagePoints and worldPoints in a .mat, as `detectCheckerboardPoints` and its like give them.

`imagePoints` is M x 2 x images, x then y, px from ONE, NaN where a point was not found; `worldPoints` M x 2 or x 3.
The size may stand beside as `imageSize`: rows, columns (documentation of the Computer Vision Toolbox).
"""

import numpy as np

from omnisight.corners._matlab import FIRST, array_of, is_mat
from omnisight.corners._protocol import Corners, Seen, Told, in_space, rows
from omnisight.formats._checks import picture_size
from omnisight.formats._matlab_file import read_mat

TITLE = "MATLAB imagePoints"
SUFFIX = ".mat"
CONVENTION = "imagePoints M x 2 x images: x, y from ONE; worldPoints M x 2; imageSize as rows, columns"


def matches(text: str) -> bool:
    """Say whether this is a .mat with imagePoints."""
    return is_mat(text, "imagePoints")


def parse(text: str, told: Told) -> Corners:
    """Read the images."""
    held = read_mat(text.encode("latin-1"))
    seen = array_of(held["imagePoints"], "imagePoints")
    seen = seen[:, :, None] if seen.ndim == 2 else seen
    if seen.ndim != 3 or seen.shape[1] != 2:
        raise ValueError(f"imagePoints must be M x 2 x images, got {' x '.join(map(str, seen.shape))}")
    if held.get("worldPoints") is not None:
        points = in_space(rows(array_of(held["worldPoints"], "worldPoints"), (2, 3), "worldPoints"))
    elif told.board is not None:
        points = told.board.points
    else:
        raise ValueError("no worldPoints in it: save them too, or give --pattern, such as 9x6")
    if len(points) != len(seen):
        raise ValueError(f"{len(seen)} imagePoints of each image, but {len(points)} points of the board")
    size = (0, 0)
    if held.get("imageSize") is not None:
        sides = np.ravel(array_of(held["imageSize"], "imageSize"))
        if len(sides) < 2:
            raise ValueError("imageSize must be rows and columns")
        size = picture_size(sides[1], sides[0])
    return Corners([Seen("", points, seen[:, :, k] - FIRST, size=size) for k in range(seen.shape[2])])
