"""Options of visual odometry; their fields are options of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from omnisight.pipeline.odometry.sequence_options import SequenceOptions
from omnisight.visual_odometry.motion_options import MotionOptions


@dataclass(frozen=True, kw_only=True)
class OdometryOptions(SequenceOptions, MotionOptions):
    """Options of visual odometry.

    Attributes
    ----------
    mask
        Image that is white where the images may be used, such as without the vehicle; or a folder with a mask for each
        camera, which has its name.
    to
        Format of the trajectory: tum has the poses that are known, with times; kitti has a row for each image, of NaN
        where the pose is not known. By default kitti for a file that ends in .kitti, else tum.
    height
        Height of the camera over the ground, such as 1.2m, for the scale.
    wheels
        Table of wheel speeds for the scale: lines of time (seconds, or nanoseconds as in ROS) and speed (m/s).
    imu
        Table of an inertial measurement unit in the format of EuRoC, for the prediction of turns and for the scale:
        lines of time, angular velocity (rad/s) and specific force (m/s^2). Its orientation need not be known.
    distance
        Numbers of two images, the first of all being 0, and the distance between their positions, such as 0 40 1.5m.
    """

    mask: Path | None = None
    to: Literal["tum", "kitti"] | None = None
    height: str | None = None
    wheels: Path | None = None
    imu: Path | None = None
    distance: tuple[int, int, str] | None = None
