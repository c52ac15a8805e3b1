"""Polydioptric heads: cameras that look all around together. Nominal, to simulate and to try things with."""

import numpy as np
from numpy.typing import ArrayLike

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.rig import Rig


def back_to_back(width: int = 960, apart: float = 0.024) -> Rig:
    """Give two fisheyes of 200 degrees, back to back: the whole sphere with 20 degrees of overlap all around.

    Parameters
    ----------
    width
        Of each image, px, which is square and holds the whole image circle.
    apart
        Distance of the two viewpoints, metres; the rig's frame is in the middle, z ahead of the first.
    """
    camera = _fisheye((width, width), 200.0, 0.49 * width)
    return Rig.from_sensors(
        {
            "front": (camera, _standing(camera_yaw=0.0, at=(0.0, 0.0, apart / 2))),
            "back": (camera, _standing(camera_yaw=180.0, at=(0.0, 0.0, -apart / 2))),
        }
    )


def ladybug(height: int = 1024, radius: float = 0.06) -> Rig:
    """Give five upright wide-angle cameras in a ring, one every 72 degrees: all around, to 72 degrees up and down.

    Parameters
    ----------
    height
        Of each image, px, 4:3 upright: 150 degrees high, 112 across.
    radius
        Of the ring of viewpoints, metres; the rig's frame is in its middle, z through the first camera.
    """
    camera = _fisheye((round(0.75 * height), height), 150.0, height / 2)
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for k in range(5):
        yaw = 72.0 * k
        at = radius * np.array([np.sin(np.radians(yaw)), 0.0, np.cos(np.radians(yaw))])
        sensors[f"cam{k}"] = (camera, _standing(camera_yaw=yaw, at=at))
    return Rig.from_sensors(sensors)


def surround_car(width: int = 1280) -> Rig:
    """Give the four fisheyes of 190 degrees of a car: in its grille, its door mirrors and above its number plate.

    The rig's frame lies on the ground below the middle of the car: x right, y down, z ahead; metres.

    Parameters
    ----------
    width
        Of each image, px, 4:3.
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
    """Give a fisheye, next to equidistant, that shows so many degrees on a circle of that radius, px, in the middle."""
    rim = np.radians(degrees / 2)
    # Equisolid lenses and their kin bend inwards a little towards the rim.
    bent = {"k1": -0.01, "k2": -0.001, "k3": 0.0, "k4": 0.0}
    focal = float(radius / (rim * (1 + bent["k1"] * rim**2 + bent["k2"] * rim**4)))
    centre = {"cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    return Camera(KannalaBrandt(fx=focal, fy=focal, **centre, **bent), size, theta_max=float(rim))


def _standing(*, camera_yaw: float, camera_pitch: float = 0.0, at: ArrayLike) -> Pose:
    """Give sensor_from_rig of a camera at a place of the rig that looks so far to the right and up, degrees."""
    rotation = look(camera_yaw, camera_pitch)
    return Pose(rotation, -rotation @ np.asarray(at, float))
