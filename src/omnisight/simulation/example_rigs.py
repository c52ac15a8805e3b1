"""Nominal rigs that see all around (polydioptric cameras), for simulation and examples."""

import numpy as np
from numpy.typing import ArrayLike

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.rig import Rig


def back_to_back(width: int = 960, apart: float = 0.024) -> Rig:
    """Return two fisheyes of 200 degrees back to back: the whole sphere with 20 degrees of overlap.

    Parameters
    ----------
    width
        Width of each square image, px; it contains the whole image circle.
    apart
        Distance between the viewpoints, metres. The rig frame is in the middle, with z along the first camera.
    """
    camera = _fisheye((width, width), 200.0, 0.49 * width)
    return Rig.from_sensors(
        {
            "front": (camera, _standing(camera_yaw=0.0, at=(0.0, 0.0, apart / 2))),
            "back": (camera, _standing(camera_yaw=180.0, at=(0.0, 0.0, -apart / 2))),
        }
    )


def ladybug(height: int = 1024, radius: float = 0.06) -> Rig:
    """Return a ring of five wide-angle cameras in portrait format, one every 72 degrees, to 72 degrees up and down.

    Parameters
    ----------
    height
        Height of each 3:4 image, px: 150 degrees vertically, 112 horizontally.
    radius
        Radius of the ring of viewpoints, metres. The rig frame is at its centre, with z along the first camera.
    """
    camera = _fisheye((round(0.75 * height), height), 150.0, height / 2)
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for k in range(5):
        yaw = 72.0 * k
        at = radius * np.array([np.sin(np.radians(yaw)), 0.0, np.cos(np.radians(yaw))])
        sensors[f"cam{k}"] = (camera, _standing(camera_yaw=yaw, at=at))
    return Rig.from_sensors(sensors)


def surround_car(width: int = 1280) -> Rig:
    """Return the four fisheyes of 190 degrees of a car: in the grille, the door mirrors and above the number plate.

    The rig frame is on the ground below the centre of the car: x right, y down, z forward; metres.

    Parameters
    ----------
    width
        Width of each 4:3 image, px.
    """
    camera = _fisheye((width, round(0.75 * width)), 190.0, 0.54 * width)
    return Rig.from_sensors(
        {
            "front": (camera, _standing(camera_yaw=0.0, camera_pitch=-20.0, at=(0.0, -0.65, 2.25))),
            "right": (camera, _standing(camera_yaw=90.0, camera_pitch=-45.0, at=(1.0, -1.0, 0.85))),
            "back": (camera, _standing(camera_yaw=180.0, camera_pitch=-30.0, at=(0.0, -0.95, -2.2))),
            "left": (camera, _standing(camera_yaw=-90.0, camera_pitch=-45.0, at=(-1.0, -1.0, 0.85))),
        }
    )


def _fisheye(size: tuple[int, int], degrees: float, radius: float) -> Camera:
    """Return a nearly equidistant fisheye with a field of view and a centred image circle of a radius, px."""
    rim = np.radians(degrees / 2)
    # Real lenses, such as equisolid ones, compress the image slightly towards the edge.
    bent = {"k1": -0.01, "k2": -0.001, "k3": 0.0, "k4": 0.0}
    focal = float(radius / (rim * (1 + bent["k1"] * rim**2 + bent["k2"] * rim**4)))
    centre = {"cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    return Camera(KannalaBrandt(fx=focal, fy=focal, **centre, **bent), size, theta_max=float(rim))


def _standing(*, camera_yaw: float, camera_pitch: float = 0.0, at: ArrayLike) -> Pose:
    """Return sensor_from_rig of a camera at a position of the rig, rotated by yaw and pitch (degrees)."""
    rotation = look(camera_yaw, camera_pitch)
    return Pose(rotation, -rotation @ np.asarray(at, float))
