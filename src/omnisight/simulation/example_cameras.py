"""The cameras that the demonstration, the examples and the documentation share."""

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
    """A camera in its place.

    Attributes
    ----------
    camera
        The truth.
    world_from_cam
        Where it stands in the room.
    theta
        From which angle to which it sees (radians from the axis).
    """

    camera: Camera
    world_from_cam: Pose
    theta: tuple[float, float]

    def renderer(self, samples: int = 2) -> Renderer:
        """Set the camera up in the furnished room."""
        return Renderer(self.camera, self.world_from_cam, theta=self.theta, samples=samples)

    def boards(self, count: int = 12, board: Checkerboard = DEMO_BOARD, *, seed: int = 0) -> list[BoardInScene]:
        """Hold a board up in so many places, one for each image."""
        poses = board_poses(self.camera, board, count, seed=seed, theta=self.theta)
        return [BoardInScene(board, pose) for pose in poses]


def fisheye_setup(width: int = 960) -> CameraSetup:
    """Give a fisheye lens of 190 degrees, its whole circle in an image 4:3."""
    f = width / 960
    model = KannalaBrandt(222.0 * f, 221.4 * f, 483.2 * f, 356.7 * f, k1=-0.018, k2=0.0031, k3=-0.0016, k4=1e-4)
    camera = Camera(model, (width, round(0.75 * width)))
    return CameraSetup(camera, Pose(translation=np.array((0.0, 0.0, -0.9))), (0.0, np.radians(95.0)))


def mirror_setup(width: int = 720) -> CameraSetup:
    """Give a camera that looks up into a nearly parabolic mirror: all around, from 18 to 110 degrees off the nadir.

    The mirror exchanges left and right: fx is negative in a frame that does not.
    """
    f = width / 720
    camera = Camera(Unified(-175.0 * f, 174.6 * f, 361.4 * f, 268.3 * f, xi=0.97), (width, round(0.75 * width)))
    return CameraSetup(camera, Pose(look(up="back")), (np.radians(18.0), np.radians(110.0)))
