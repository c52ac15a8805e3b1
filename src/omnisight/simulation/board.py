"""Calibration boards as solids of a scene."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.simulation.camera_protocol import RenderableCamera
from omnisight.simulation.solids import Solid, box
from omnisight.simulation.texture import Texture
from omnisight.targets import Board, Checkerboard
from omnisight.targets.printing.drawing import Disc, Shape

Array = NDArray[np.float64]

# White margin around the pattern and thickness of the board, in squares.
MARGIN_SQUARES, THICKNESS_SQUARES = 0.6, 0.08
# Gray values of the print.
INK, PAPER = 56, 232
# Texels and subsamples per texel along the side of a square; the texture is antialiased by the subsamples.
TEXELS_PER_SQUARE, SUBSAMPLES = 40, 4
# Limit of the texture's memory.
MAX_TEXELS_PER_SIDE = 8192


@dataclass(frozen=True)
class BoardInScene:
    """A board with its pose relative to the camera.

    Attributes
    ----------
    board
        Any board with known lengths; a checkerboard without a square size has squares of 1.
    cam_from_board
        Pose, in the unit of `Board.points`. The printed side faces -z of the board frame.
    """

    board: Board
    cam_from_board: Pose

    def corners(self, camera: RenderableCamera) -> Array:
        """Project its points; return exact pixels (N, 2) in the order of `board.points`, NaN where not valid."""
        return camera.project(self.cam_from_board @ self.board.points)[0]

    def outline(self, per_side: int = 24) -> Array:
        """Return points (N, 3) along the edges of front and back, in the camera frame."""
        t = np.linspace(0, 1, per_side, endpoint=False)[:, None]
        low, high = _paper(self.board)
        turns = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
        edge = np.concatenate([turns[i] + t * (turns[i + 1] - turns[i]) for i in range(4)])
        thickness = THICKNESS_SQUARES * _with_square_size(self.board).quiet_zone
        return self.cam_from_board @ np.concatenate(
            [np.pad(edge, ((0, 0), (0, 1)), constant_values=z) for z in (0, thickness)]
        )

    def faces_camera(self) -> bool:
        """Return whether the printed side faces the camera."""
        return float(self.cam_from_board.rotation[:, 2] @ self.cam_from_board.translation) > 0

    def solid(self, world_from_cam: Pose, name: str) -> Solid:
        """Return the board as a solid of a scene."""
        return board_solid(self.board, world_from_cam @ self.cam_from_board, name)


def board_solid(board: Board, world_from_board: Pose, name: str) -> Solid:
    """Make a board at a pose in a scene: a thin box with the pattern on its front and a white back."""
    low, high = _paper(board)
    thickness = THICKNESS_SQUARES * _with_square_size(board).quiet_zone
    textures = {"near": printed(board), "other": Texture.plain((PAPER, PAPER, PAPER))}
    return box((*low, 0.0), (*high, thickness), textures, name).moved(world_from_board)


@cache
def printed(board: Board) -> Texture:
    """Return the texture of a board, antialiased by ink coverage.

    Raises
    ------
    ValueError
        If the board has too many squares.
    """
    known = _with_square_size(board)
    low, high = _paper(board)
    columns, rows = (round(float(side) * TEXELS_PER_SQUARE / known.quiet_zone) * SUBSAMPLES for side in high - low)
    if max(columns, rows) > MAX_TEXELS_PER_SIDE * SUBSAMPLES:
        raise ValueError(f"the {board} board has too many squares to be rendered")
    ink = np.zeros((rows, columns), np.bool_)
    for shape in known.drawing():
        _fill(ink, shape, low, np.array((columns, rows)) / (high - low))
    coverage = ink.reshape(rows // SUBSAMPLES, SUBSAMPLES, columns // SUBSAMPLES, SUBSAMPLES).mean((1, 3))
    gray = np.rint(PAPER + (INK - PAPER) * coverage).astype(np.uint8)
    return Texture(np.repeat(gray[..., None], 3, -1))


def _fill(ink: NDArray[np.bool_], shape: Shape, low: Array, scale: Array) -> None:
    """Set the samples whose centres are inside a shape to black, or white for a white shape."""
    if isinstance(shape, Disc):
        corners = np.array(shape.centre) + shape.radius * np.array([(-1, -1), (1, 1)])
    else:
        corners = np.array(shape.corners)
    corners = (corners - low) * scale - 0.5
    left, top = np.maximum(np.floor(corners.min(0)).astype(int), 0)
    right, bottom = np.ceil(corners.max(0)).astype(int) + 1
    window = ink[top:bottom, left:right]
    v, u = np.mgrid[top : top + window.shape[0], left : left + window.shape[1]]
    if isinstance(shape, Disc):
        x, y = (np.array(shape.centre) - low) * scale - 0.5
        inside = ((u - x) / scale[0]) ** 2 + ((v - y) / scale[1]) ** 2 < shape.radius**2
    else:
        inside = np.zeros(window.shape, np.bool_)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, 0), strict=True):
            if y0 != y1:  # even-odd rule: does the ray to the right cross this edge
                inside ^= ((y0 > v) != (y1 > v)) & (u < x0 + (v - y0) * (x1 - x0) / (y1 - y0))
    window[inside] = not shape.white


def _with_square_size(board: Board) -> Board:
    """Return the board, with a square size of 1 if it has none."""
    return replace(board, square=1.0) if isinstance(board, Checkerboard) and board.square is None else board


def _paper(board: Board) -> tuple[Array, Array]:
    """Return the top left and the bottom right corner of the paper in the board frame."""
    known = _with_square_size(board)
    left, top, right, bottom = known.extent
    margin = MARGIN_SQUARES * known.quiet_zone
    return np.array((left - margin, top - margin)), np.array((right + margin, bottom + margin))
