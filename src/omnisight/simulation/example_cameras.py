"""Cameras shared by the demonstration, the examples and the documentation."""

from dataclasses import dataclass

import numpy as np

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.models.unified import Unified
from omnisight.simulation.board import BoardInScene
from omnisight.simulation.board_poses import board_poses
from omnisight.simulation.render import Renderer
from omnisight.targets import Checkerboard

DEMO_BOARD = Checkerboard(8, 5, 0.04)


@dataclass(frozen=True)
class CameraSetup:
    """A camera with its pose in the room.

    Attributes
    ----------
    camera
        The true camera.
    world_from_cam
        Its pose.
    theta
        Field of view: range of angles from the axis, radians.
    """

    camera: Camera
    world_from_cam: Pose
    theta: tuple[float, float]

    def renderer(self, samples: int = 2) -> Renderer:
        """Return a renderer of the furnished room."""
        return Renderer(self.camera, self.world_from_cam, theta=self.theta, samples=samples)

    def boards(self, count: int = 12, board: Checkerboard = DEMO_BOARD, *, seed: int = 0) -> list[BoardInScene]:
        """Return boards at different poses, one for each image."""
        poses = board_poses(self.camera, board, count, seed=seed, theta=self.theta)
        return [BoardInScene(board, pose) for pose in poses]


def fisheye_setup(width: int = 960) -> CameraSetup:
    """Return a fisheye of 190 degrees with its whole image circle in a 4:3 image."""
    f = width / 960
    model = KannalaBrandt(222.0 * f, 221.4 * f, 483.2 * f, 356.7 * f, k1=-0.018, k2=0.0031, k3=-0.0016, k4=1e-4)
    camera = Camera(model, (width, round(0.75 * width)))
    return CameraSetup(camera, Pose(translation=np.array((0.0, 0.0, -0.9))), (0.0, np.radians(95.0)))


def mirror_setup(width: int = 720) -> CameraSetup:
    """Return a camera below a nearly parabolic mirror that sees all around, from 18 to 110 degrees off nadir.

    fx is negative, because the mirror exchanges left and right.
    """
    f = width / 720
    camera = Camera(Unified(-175.0 * f, 174.6 * f, 361.4 * f, 268.3 * f, xi=0.97), (width, round(0.75 * width)))
    return CameraSetup(camera, Pose(look(up="back")), (np.radians(18.0), np.radians(110.0)))
