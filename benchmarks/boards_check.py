"""Check the renderer of the boards by integrals of light along rows, without any detection.

The integral of a row that one edge crosses gives the mean position of the edge in that row: no sampling, no fit.
"""

import numpy as np

from benchmarks.boards_scene import BOARD, INK, LENSES, PAPER, Lens, Shot, hold, paint
from omnisight.geometry.pose import Pose

SHOTS = ((0.0, 0.0, 40.0), (0.2, 20.0, 50.0), (0.5, 45.0, 40.0), (0.85, 30.0, 36.0))
NEAR = 0.25  # of a square's side: how far along an edge from its middle rows are looked at
HALF = 4  # px on each side of the edge


def run() -> str:
    """Return the errors of edges of squares, px, over all lenses and a few poses."""
    errors = []
    for name, lens in LENSES.items():
        for place, tilt, square in SHOTS:
            pose = hold(lens, Shot(name, place, tilt, square, 3), np.random.default_rng(3))
            light = np.full(lens.camera.size[::-1], 110.0)
            paint(light, lens, pose)
            errors += [_edges(light, lens, pose, axis) for axis in (0, 1)]
    off = np.concatenate(errors)
    return (
        f"renderer: {len(off)} pieces of edge, error mean {off.mean():+.5f} px, rms {np.sqrt((off**2).mean()):.5f} px,"
        f" largest {np.abs(off).max():.4f} px"
    )


def _edges(light: np.ndarray, lens: Lens, pose: Pose, axis: int) -> np.ndarray:
    """Compare rows of the image with the edges along the board's x (axis 0) or y (axis 1)."""
    errors = []
    t = np.linspace(-NEAR, NEAR, 201)
    for j in range(BOARD.rows - axis):
        for i in range(BOARD.columns - 1 + axis):
            points = np.zeros((len(t), 3))
            points[:, axis], points[:, 1 - axis] = t + (i + 0.5, j + 0.5)[axis], (i, j)[1 - axis]
            edge, valid = lens.camera.project(pose @ points)
            if valid.all():
                errors += _pieces(light, edge)
    return np.array(errors)


def _pieces(light: np.ndarray, edge: np.ndarray) -> list[float]:
    """Return the error of each row that an edge, a dense line of pixels (N, 2), crosses steeply."""
    if np.ptp(edge[:, 0]) > 0.7 * np.ptp(edge[:, 1]):
        light, edge = light.T, edge[:, ::-1]
    if np.ptp(edge[:, 1]) < 2 or np.ptp(edge[:, 0]) > 0.7 * np.ptp(edge[:, 1]):
        return []
    edge = edge[np.argsort(edge[:, 1])]
    errors = []
    for row in range(int(np.ceil(edge[0, 1] + 0.5)), int(np.floor(edge[-1, 1] - 0.5)) + 1):
        across = np.interp(np.linspace(row - 0.5, row + 0.5, 101), edge[:, 1], edge[:, 0])
        truth, middle = np.trapezoid(across, dx=0.01), int(np.rint(across.mean()))
        left, right = middle - HALF, middle + HALF
        if left < 0 or right >= light.shape[1] or not 0 <= row < light.shape[0]:
            continue
        values = light[row, left : right + 1]
        if (
            sorted((values[0], values[-1])) != [INK, PAPER]
            or not (np.diff(values) * (values[-1] - values[0]) >= 0).all()
        ):
            continue  # another edge is near
        share = (values - values[-1]).sum() / (values[0] - values[-1])
        errors.append(left - 0.5 + share - truth)
    return errors
