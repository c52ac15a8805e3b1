"""A printed board that is held up before a camera, or stands in a scene."""

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

MARGIN = 0.6  # of white paper around the ink, in squares
THICK = 0.08  # in squares
INK, PAPER = 56, 232
TEXELS, FINER = 40, 4  # of a square's side, and parts of a texel that are looked at
LARGEST = 8192  # texels along a side


@dataclass(frozen=True)
class BoardInScene:
    """A board and where it is.

    Attributes
    ----------
    board
        Of any kind whose lengths are known; a checkerboard without has squares of 1.
    cam_from_board
        Its pose, in the unit of `Board.points`; it is printed on the side that looks along its own -z.
    """

    board: Board
    cam_from_board: Pose

    def corners(self, camera: RenderableCamera) -> Array:
        """Give the exact pixels (N, 2) of its points, in the order of `board.points`; NaN where not valid."""
        return camera.project(self.cam_from_board @ self.board.points)[0]

    def outline(self, per_side: int = 24) -> Array:
        """Give points (N, 3) around the edges of the front and the back, in the camera's frame."""
        t = np.linspace(0, 1, per_side, endpoint=False)[:, None]
        low, high = _paper(self.board)
        turns = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
        edge = np.concatenate([turns[i] + t * (turns[i + 1] - turns[i]) for i in range(4)])
        thick = THICK * _measured(self.board).quiet_zone
        return self.cam_from_board @ np.concatenate(
            [np.pad(edge, ((0, 0), (0, 1)), constant_values=z) for z in (0, thick)]
        )

    def faces_camera(self) -> bool:
        """Say whether a camera in the origin sees the printed side."""
        return float(self.cam_from_board.rotation[:, 2] @ self.cam_from_board.translation) > 0

    def solid(self, world_from_cam: Pose, name: str) -> Solid:
        """Give it as a part of a scene."""
        return board_solid(self.board, world_from_cam @ self.cam_from_board, name)


def board_solid(board: Board, world_from_board: Pose, name: str) -> Solid:
    """Give a board at a place in a scene, printed on a sheet that its points lie on; its back is white."""
    low, high = _paper(board)
    thick = THICK * _measured(board).quiet_zone
    textures = {"near": printed(board), "other": Texture.plain((PAPER, PAPER, PAPER))}
    return box((*low, 0.0), (*high, thick), textures, name).moved(world_from_board)


@cache
def printed(board: Board) -> Texture:
    """Give a board's print: each texel as dark as ink covers it.

    Raises
    ------
    ValueError
        If the board has too many squares for an image of it.
    """
    known = _measured(board)
    low, high = _paper(board)
    columns, rows = (round(float(side) * TEXELS / known.quiet_zone) * FINER for side in high - low)
    if max(columns, rows) > LARGEST * FINER:
        raise ValueError(f"the {board} board is too fine to be drawn")
    ink = np.zeros((rows, columns), np.bool_)
    for shape in known.drawing():
        _fill(ink, shape, low, np.array((columns, rows)) / (high - low))
    cover = ink.reshape(rows // FINER, FINER, columns // FINER, FINER).mean((1, 3))
    gray = np.rint(PAPER + (INK - PAPER) * cover).astype(np.uint8)
    return Texture(np.repeat(gray[..., None], 3, -1))


def _fill(ink: NDArray[np.bool_], shape: Shape, low: Array, scale: Array) -> None:
    """Blacken, or whiten, the samples whose middles lie in a shape."""
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
            if y0 != y1:  # a line to the right from the sample crosses this edge
                inside ^= ((y0 > v) != (y1 > v)) & (u < x0 + (v - y0) * (x1 - x0) / (y1 - y0))
    window[inside] = not shape.white


def _measured(board: Board) -> Board:
    """Give the board with a side of 1 for its squares where none is known."""
    return replace(board, square=1.0) if isinstance(board, Checkerboard) and board.square is None else board


def _paper(board: Board) -> tuple[Array, Array]:
    """Give the top left and the bottom right corner of the paper, in the frame of the board's points."""
    known = _measured(board)
    left, top, right, bottom = known.extent
    margin = MARGIN * known.quiet_zone
    return np.array((left - margin, top - margin)), np.array((right + margin, bottom + margin))
