"""A printed checkerboard that stands in front of the camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.targets import Checkerboard

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
        Its pose, in the unit of `Checkerboard.points`; it is printed on the side that looks along its own -z.
    """

    board: Checkerboard
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
        """Give the exact pixels (N, 2) of the inner corners, in the order of `board.points`; NaN where not valid."""
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
        """Give the brightness (rows, columns) that bearings (rows, columns, 3) meet, and which of them meet paper.

        Edges between squares are averaged over the spacing of the grid: exact corners need more than sampling.
        """
        rotation, position = self.cam_from_board.rotation, self.cam_from_board.translation
        eye = (-rotation.T @ position / self.side).astype(np.float32)
        rays = bearings @ rotation.astype(np.float32)
        with np.errstate(all="ignore"):
            distance = -eye[2] / rays[..., 2]
            x, y = eye[0] + distance * rays[..., 0], eye[1] + distance * rays[..., 1]
            across, inside_x = _wave(x, self.board.columns)
            down, inside_y = _wave(y, self.board.rows)
            squares = np.minimum(inside_x, inside_y)
            hit = (distance > 0) & (_beyond(x, self.board.columns) < MARGIN) & (_beyond(y, self.board.rows) < MARGIN)
        black = squares * (1 + across * down) / 2 * self.faces_camera()
        # Light falls from above, a little more on one end of the paper.
        shade = 0.86 + 0.14 * float(abs(rotation[:, 2] @ position) / np.linalg.norm(position))
        slope = 1 - 0.06 * np.clip(x / self.board.columns + y / self.board.rows, -0.4, 2.4)
        return ((PAPER + (INK - PAPER) * black) * shade * slope).astype(np.float32), hit


def _wave(x: Floats, count: int) -> tuple[Floats, Floats]:
    """Give +1 on even squares and -1 on odd ones along one axis, and 1 on squares and 0 beside them; both averaged."""
    span = np.sum([np.abs(np.gradient(x, axis=i)) for i in (0, 1) if x.shape[i] > 1], axis=0) + np.float32(1e-6)
    edge = np.clip(np.rint(x), 0, count - 1)
    sign = np.where(edge % 2 == 0, 1, -1)
    return sign * np.clip(2 * (x - edge) / span, -1, 1), np.clip(0.5 - _beyond(x, count) / span, 0, 1)


def _beyond(x: Floats, count: int) -> Floats:
    """Give how far x lies beyond the squares, in squares; negative on them."""
    return np.abs(x - np.float32((count - 1) / 2)) - np.float32((count + 1) / 2)
