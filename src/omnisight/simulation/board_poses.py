"""Board poses that cover the whole field of view of a camera, for rendering calibration images."""

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import angle_from_axis
from omnisight.simulation.board import BoardInScene
from omnisight.targets import Checkerboard

Array = NDArray[np.float64]

# Azimuths advance by the golden angle, which distributes any number of boards evenly.
GOLDEN_ANGLE_RAD = np.pi * (3 - np.sqrt(5))
MAX_ATTEMPTS = 200
# Distance of boards from the image border.
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
    """Return cam_from_board of tilted, fully visible boards, distributed over the whole field of view.

    The poses are reproducible by the seed.

    Parameters
    ----------
    camera
        The camera.
    board
        The board.
    count
        Number of poses.
    seed
        Seed of the random rotations and distances.
    theta
        Field of view: range of angles from the axis, radians.
    distance
        Range of distances, in board widths.
    tilt_deg
        Range of angles between the board's normal and the line of sight, degrees.

    Raises
    ------
    ValueError
        If the whole board fits nowhere in the image.
    """
    rng = np.random.default_rng(seed)
    far = min(theta[1], camera.image_theta_max() if theta[1] >= np.pi else theta[1])
    turn = rng.uniform(0, 2 * np.pi)
    poses: list[Pose] = []
    for i in range(count):
        # Equal areas of an equidistant image, starting at the image circle, which is then always covered.
        target = theta[0] + (far - theta[0]) * np.sqrt(1 - i / count)
        for attempt in range(MAX_ATTEMPTS):
            moved = target + ((theta[0] + far) / 2 - target) * attempt / MAX_ATTEMPTS
            pose = _random_pose(board, moved, turn + i * GOLDEN_ANGLE_RAD, rng, distance, tilt_deg)
            if _is_visible(camera, BoardInScene(board, pose), (theta[0], far)):
                poses.append(pose)
                break
        else:
            raise ValueError(f"the whole {board} board fits nowhere in the image: increase its distance")
    return poses


def _random_pose(
    board: Checkerboard,
    theta: float,
    azimuth: float,
    rng: np.random.Generator,
    distance: tuple[float, float],
    tilt_deg: tuple[float, float],
) -> Pose:
    """Return a pose with the board's centre in a direction, rotated randomly in its plane and tilted."""
    towards = np.array((np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)))
    axis = np.array((-np.sin(azimuth), np.cos(azimuth), 0.0))
    # The tilt axis is random within the board's plane.
    lean = rng.uniform(0, 2 * np.pi)
    tilt = np.radians(rng.uniform(*tilt_deg)) * np.array((np.cos(lean), np.sin(lean), 0))
    spin = np.array((0, 0, rng.uniform(-np.pi, np.pi)))
    rotation = so3.exp(axis * theta) @ so3.exp(tilt) @ so3.exp(spin)
    points = board.points
    width = float(np.ptp(points[:, 0]))
    return Pose(rotation, towards * width * rng.uniform(*distance) - rotation @ points.mean(0))


def _is_visible(camera: Camera, board: BoardInScene, theta: tuple[float, float]) -> bool:
    """Return whether the whole board is inside image and image circle, with its printed side towards the camera."""
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
