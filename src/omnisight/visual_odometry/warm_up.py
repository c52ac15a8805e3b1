"""Load the code of visual odometry before it is needed."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.progress import Progress, no_progress
from omnisight.visual_odometry.motion_options import MotionOptions
from omnisight.visual_odometry.odometry import Odometry

Array = NDArray[np.float64]

STAGE = "loading code before the first image"

# Code is loaded by the first three keyframes, and by a sudden turn, after which descriptors determine the pose.
FRAMES, TURNED_FROM = 10, 8
TURN_RAD = 0.7
# Larger side of the images, px, which show enough corners and cost little.
WIDTH = 320
# Size of the images of a camera whose file has none, px.
DEFAULT_SIZE = 320, 240
# Rotation that turns the optical axis between the axes of the room: walls at different distances show a parallax.
TO_EDGE = so3.exp([0.5, 0.7, 0.0])
# Step between two images, and side of the squares of the walls, in halves of the side of the room.
STEP, SQUARE = 0.04, 0.1


def warm_up(camera: Camera, options: MotionOptions = MotionOptions(), progress: Progress = no_progress) -> None:
    """Track a camera in small drawn images, which loads the compiled code for its model, or compiles it at first.

    Takes seconds; on the first run on a machine minutes.
    """
    known = min(camera.size) > 0
    small = camera.scaled(WIDTH / max(camera.size)) if known else replace(camera, size=DEFAULT_SIZE)
    tracking = Odometry(small, options)
    for frame in range(FRAMES):
        progress(STAGE, frame, FRAMES)
        roll = so3.exp([0.0, 0.0, TURN_RAD if frame >= TURNED_FROM else 0.0])
        tracking.add(_draw_room(small, TO_EDGE @ roll, np.array([STEP * frame, 0.0, 0.0])), 0.1 * frame)
    tracking.finish()
    progress(STAGE, FRAMES, FRAMES)


def _draw_room(camera: Camera, world_from_cam: Array, center: Array) -> NDArray[np.uint8]:
    """Return the RGB image (H, W, 3) of a cube of side 2 with squares of random brightness.

    The camera is in it, with a rotation (3, 3) and a position (3,).
    """
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1)
    bearings, valid = camera.unproject(pixels.astype(float))
    directions = bearings @ world_from_cam.T
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = ((np.sign(directions) - center) / directions).min(axis=-1, keepdims=True)
        points = np.where(valid[..., None], center + distances * directions, 0.0)
    squares = int(2 / SQUARE) + 1
    brightness = np.random.default_rng(0).integers(30, 255, (squares,) * 3, np.uint8)
    x, y, z = np.moveaxis(((points + 1) / SQUARE).astype(int).clip(0, squares - 1), -1, 0)
    gray = np.where(valid, brightness[x, y, z], 0).astype(np.uint8)
    return np.repeat(gray[..., None], 3, axis=-1)
