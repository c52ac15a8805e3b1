"""A printed checkerboard that stands in front of the camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.targets import Board

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

MARGIN = 0.6  # of white paper around the squares, in squares
INK, PAPER = 34.0, 232.0


@dataclass(frozen=True)
class BoardInScene:
    """A board and where it is.

    Attributes
    ----------
    board
        The checkerboard.
    cam_from_board
        Its pose, in the unit of `Board.points`; it is printed on the side that looks along its own -z.
    """

    board: Board
    cam_from_board: Pose

    @property
    def side(self) -> float:
        """Of a square."""
        return self.board.square or 1.0

    @property
    def distance(self) -> float:
        """From the camera to the board's middle."""
        return float(np.linalg.norm(self.cam_from_board @ self.board.points.mean(0)))

    def corners(self, camera: Camera) -> Array:
        """Give the exact pixels (N, 2) of the inner corners, in the order of `Board.points`; NaN where not valid."""
        return camera.project(self.cam_from_board @ self.board.points)[0]

    def outline(self, per_side: int = 24) -> Array:
        """Give points (N, 3) around the paper's edge, in the camera's frame."""
        t = np.linspace(0, 1, per_side, endpoint=False)[:, None]
        low = np.full(2, -1 - MARGIN)
        high = np.array((self.board.columns, self.board.rows)) + MARGIN
        turns = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
        edge = np.concatenate([turns[i] + t * (turns[i + 1] - turns[i]) for i in range(4)])
        return self.cam_from_board @ (np.pad(edge, ((0, 0), (0, 1))) * self.side)

    def faces_camera(self) -> bool:
        """Say whether the camera sees the printed side."""
        return float(self.cam_from_board.rotation[:, 2] @ self.cam_from_board.translation) > 0

    def trace(self, bearings: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Give the brightness (...) that bearings (..., 3) meet on the board, 0 to 255, and whether they meet it."""
        rotation, position = self.cam_from_board.rotation, self.cam_from_board.translation
        eye = -rotation.T @ position / self.side
        rays = bearings @ rotation.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.float32(-eye[2]) / rays[..., 2]
            x = np.float32(eye[0]) + distance * rays[..., 0]
            y = np.float32(eye[1]) + distance * rays[..., 1]
            columns, rows = self.board.columns, self.board.rows
            hit = (distance > 0) & (np.abs(2 * x - (columns - 1)) < columns + 1 + 2 * MARGIN)
            hit &= np.abs(2 * y - (rows - 1)) < rows + 1 + 2 * MARGIN
            squares = (x > -1) & (x < columns) & (y > -1) & (y < rows)
            black = squares & ((np.floor(x) + np.floor(y)) % 2 == 0) & self.faces_camera()
        # Light falls from above, a little more on one end of the paper.
        shade = 0.86 + 0.14 * float(abs(rotation[:, 2] @ position) / np.linalg.norm(position))
        slope = 1 - 0.12 * np.clip(np.nan_to_num((x / columns + y / rows) / 2), -0.2, 1.2)
        return (np.where(black, INK, PAPER) * shade * slope).astype(np.float32), hit
