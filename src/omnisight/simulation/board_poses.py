"""Where to hold a board so that a calibration learns the whole image."""

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import angle_from_axis
from omnisight.simulation.board import BoardInScene
from omnisight.targets import Checkerboard

Array = NDArray[np.float64]

GOLDEN = np.pi * (3 - np.sqrt(5))
TRIES = 200
MARGIN_PX = 6.0


def board_poses(
    camera: Camera,
    board: Checkerboard,
    count: int = 12,
    *,
    seed: int = 0,
    theta: tuple[float, float] = (0.0, np.pi),
    distance: tuple[float, float] = (1.1, 1.7),
    tilt_deg: tuple[float, float] = (20.0, 45.0),
) -> list[Pose]:
    """Give cam_from_board of boards all around the field of view, tilted, at varied distances, wholly visible.

    The same seed gives the same poses.

    Parameters
    ----------
    camera
        Whose field of view.
    board
        What is held.
    count
        How many.
    seed
        Of everything random.
    theta
        From which angle to which (radians from the axis) the camera sees.
    distance
        Least and most, in board widths.
    tilt_deg
        Least and most angle between the board's normal and the line to the camera, degrees.

    Raises
    ------
    ValueError
        If no place shows all of the board.
    """
    rng = np.random.default_rng(seed)
    far = min(theta[1], camera.image_theta_max() if theta[1] >= np.pi else theta[1])
    turn = rng.uniform(0, 2 * np.pi)
    poses: list[Pose] = []
    for i in range(count):
        # Equal areas of an equidistant image, from the rim inwards so that the rim is never left out.
        wanted = theta[0] + (far - theta[0]) * np.sqrt(1 - i / count)
        for attempt in range(TRIES):
            pulled = wanted + ((theta[0] + far) / 2 - wanted) * attempt / TRIES
            pose = _held(board, pulled, turn + i * GOLDEN, rng, distance, tilt_deg)
            if _shown(camera, BoardInScene(board, pose), (theta[0], far)):
                poses.append(pose)
                break
        else:
            raise ValueError(f"no place in the image shows all of the {board} board: hold it farther away")
    return poses


def _held(
    board: Checkerboard,
    theta: float,
    azimuth: float,
    rng: np.random.Generator,
    distance: tuple[float, float],
    tilt_deg: tuple[float, float],
) -> Pose:
    """Hold the board's middle in a direction, turned at random in its plane and tilted about a random axis in it."""
    towards = np.array((np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)))
    axis = np.array((-np.sin(azimuth), np.cos(azimuth), 0.0))
    # Tilts lean mostly towards the axis or away from it: there they tell the profile most.
    lean = rng.uniform(0, 2 * np.pi)
    tilt = np.radians(rng.uniform(*tilt_deg)) * np.array((np.cos(lean), np.sin(lean), 0))
    spin = np.array((0, 0, rng.uniform(-np.pi, np.pi)))
    rotation = so3.exp(axis * theta) @ so3.exp(tilt) @ so3.exp(spin)
    points = board.points
    width = float(np.ptp(points[:, 0]))
    return Pose(rotation, towards * width * rng.uniform(*distance) - rotation @ points.mean(0))


def _shown(camera: Camera, board: BoardInScene, theta: tuple[float, float]) -> bool:
    """Say whether the paper lies inside the image and the image circle, its printed side to the camera."""
    outline = board.outline(8)
    angle = angle_from_axis(outline)
    pixels, valid = camera.project(outline)
    return bool(
        valid.all()
        and board.faces_camera()
        and (angle > theta[0]).all()
        and (angle < theta[1]).all()
        and (pixels > MARGIN_PX - 1).all()
        and (pixels < np.array(camera.size) - MARGIN_PX).all()
    )
