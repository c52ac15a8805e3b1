"""Rendered images of checkerboards through an equidistant fisheye, with the true corners."""

from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from omnisight.targets import Checkerboard

SIZE = (640, 480)
FOCAL = 190.0  # px per radian: 640 px across are 190 degrees
CENTRE = np.array([322.3, 236.8])
PAPER, INK, WALL, NIGHT = 200.0, 40.0, 110.0, 6.0
FINE = 3  # samples per pixel and axis

# Where boards are held, as `pose` takes it.
POSES = [
    (0, 0, 0, 9),
    (5, -10, 25, 5),
    (50, 10, 80, 6),
    (-60, -15, -120, 5.5),
    (0, 45, 170, 7),
    (60, 0, 10, 8),
]


def project(points):
    theta = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
    phi = np.arctan2(points[..., 1], points[..., 0])
    return CENTRE + FOCAL * theta[..., None] * np.stack([np.cos(phi), np.sin(phi)], axis=-1)


def pose(board, yaw, pitch, roll, distance):
    """Turn a board towards a direction (degrees) at a distance in squares, tilted by 20 degrees."""
    facing = Rotation.from_euler("YXZ", [yaw, -pitch, roll], degrees=True)
    tilt = Rotation.from_euler("XY", [20, -15], degrees=True)
    middle = np.array([(board.columns - 1) / 2, (board.rows - 1) / 2, 0])
    cam_from_board = (facing * tilt).as_matrix()
    return cam_from_board, facing.apply([0, 0, distance]) - cam_from_board @ middle


def corners(board, placed):
    return project(board.points @ placed[0].T + placed[1])


@cache
def rays():
    at = (np.arange(FINE) + 0.5) / FINE - 0.5
    u, v = (np.add.outer(np.arange(n), at).ravel() for n in SIZE)
    away = np.stack(np.meshgrid(u, v), axis=-1) - CENTRE
    theta = np.linalg.norm(away, axis=-1, keepdims=True) / FOCAL
    return np.concatenate([away / FOCAL * np.sinc(theta / np.pi), np.cos(theta)], axis=-1).astype(np.float32)


def scene(*shown, sees=np.pi):
    """Return an image of boards, each (board, pose, whether its first square is dark), by a lens that `sees` so far."""
    light = np.full((SIZE[1] * FINE, SIZE[0] * FINE), WALL, np.float32)
    for board, (rotation, position), dark in shown:
        edge = np.array([[x, y, 0] for x in np.linspace(-2, board.columns + 1, 20) for y in (-2, 2, board.rows + 1)])
        around = project(edge @ rotation.T + position)
        low, high = (np.clip(a, 0, SIZE).astype(int) * FINE for a in (around.min(0) - 9, around.max(0) + 9))
        part = (slice(low[1], high[1]), slice(low[0], high[0]))
        seen, start = rays()[part] @ rotation.astype(np.float32), -position @ rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -start[2] / seen[..., 2]
            x, y = (start[k] + distance * seen[..., k] for k in (0, 1))
            paper, squares = (
                (distance > 0) & (x > -m) & (x < board.columns - 1 + m) & (y > -m) & (y < board.rows - 1 + m)
                for m in (2, 1)
            )
            ink = squares & ((np.floor(x) + np.floor(y)) % 2 == (0 if dark else 1))
        light[part][paper] = PAPER
        light[part][ink] = INK
    if sees < np.pi:
        light[rays()[..., 2] < np.cos(sees)] = NIGHT
    image = cv2.GaussianBlur(cv2.resize(light, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    image = image + np.random.default_rng(0).normal(0, 2, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@cache
def shot(view, columns=9, rows=6, *, dark=True):
    """Return an image of one board in one of the poses, read-only, and its true corners."""
    board = Checkerboard(columns, rows)
    placed = pose(board, *view)
    image = scene((board, placed, dark))
    image.flags.writeable = False
    return image, corners(board, placed)
