"""MATLAB's imagePoints and worldPoints in a .mat, as `detectCheckerboardPoints` and similar functions return them.

`imagePoints` is M x 2 x images, x then y, px from ONE, NaN for a point that was not detected; `worldPoints` is M x 2 or
M x 3. The points of a checkerboard are listed column by column, as `generateCheckerboardPoints` returns them. The
optional `imageSize` is rows, columns (documentation of the Computer Vision Toolbox).
"""

import numpy as np

from omnisight.corners._matlab import has_variables, matrix_of, read_variables, size_from_rows_columns
from omnisight.corners._protocol import Array, CornerFile, ImageCorners, ReadOptions, as_rows, to_3d
from omnisight.formats._values import FIRST_PIXEL
from omnisight.targets import Board, Checkerboard

TITLE = "MATLAB imagePoints"
SUFFIX = ".mat"
CONVENTION = "imagePoints M x 2 x images: x, y from ONE; worldPoints M x 2; imageSize as rows, columns"


def matches(text: str) -> bool:
    """Return whether this is a .mat with imagePoints."""
    return has_variables(text, "imagePoints")


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the images."""
    variables = read_variables(text)
    pixels = matrix_of(variables["imagePoints"], "imagePoints")
    pixels = pixels[:, :, None] if pixels.ndim == 2 else pixels
    if pixels.ndim != 3 or pixels.shape[1] != 2:
        raise ValueError(f"imagePoints must be M x 2 x images, got {' x '.join(map(str, pixels.shape))}")
    if variables.get("worldPoints") is not None:
        points = to_3d(as_rows(matrix_of(variables["worldPoints"], "worldPoints"), (2, 3), "worldPoints"))
    elif options.board is not None:
        points = _board_points(options.board)
    else:
        raise ValueError("no worldPoints in it: save them too, or specify --pattern, such as 9x6")
    if len(points) != len(pixels):
        raise ValueError(f"{len(pixels)} imagePoints of each image, but {len(points)} points of the board")
    size = size_from_rows_columns(variables.get("imageSize"), "imageSize")
    images = [ImageCorners("", points, pixels[:, :, k] - FIRST_PIXEL, size=size) for k in range(pixels.shape[2])]
    return CornerFile(images)


def _board_points(board: Board) -> Array:
    """Return the points (N, 3) of a board in MATLAB's order: those of a checkerboard column by column."""
    x, y, _ = board.points.T
    return board.points[np.lexsort([y, x])] if isinstance(board, Checkerboard) else board.points
