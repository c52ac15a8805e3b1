"""Options of the images and other files that `simulate` renders; they are those of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass, field
from typing import Literal

from omnisight.choices import Options
from omnisight.motion_sensor_options import MotionSensors

MAX_DRIFT_STOPS = 10


@dataclass(frozen=True)
class Conditions(Options):
    """Conditions under which a scene is visited.

    Attributes
    ----------
    time
        Local solar time of an outdoor scene, hours, at the latitude of the world's origin on 1 May; None for the
        scene's usual sun.
    weather
        Weather of an outdoor scene.
    exposure_drift
        Standard deviation of a slow random change of the exposure, stops; exposure.csv has that of each image.
    visit
        Number of the visit of the town: other cars are parked at each, and everything else is the same.
    traffic
        Cars drive and people walk through the town; masks/ is white where the image shows what is static.
    """

    time: float | None = None
    weather: Literal["clear", "overcast", "rain", "fog"] = "clear"
    exposure_drift: float = 0.0
    visit: int = 0
    traffic: bool = False

    def __post_init__(self) -> None:
        """Check the ranges of all values."""
        super().__post_init__()
        if self.visit < 0:
            raise ValueError(f"--visit must not be negative, got {self.visit}")
        if not 0 <= self.exposure_drift <= MAX_DRIFT_STOPS:
            raise ValueError(f"--exposure-drift must be from 0 to {MAX_DRIFT_STOPS} stops, got {self.exposure_drift:g}")


@dataclass(frozen=True, kw_only=True)
class RenderingOptions(Options):
    """Options of the images and other files of a simulated data set.

    Attributes
    ----------
    trajectory
        loop, line, turn or still, at the speed of a walking person; loop follows the roads of the town, as a car, and
        enters all rooms of `rooms`. Or a file of world_from_cam poses (world_from_rig for a rig), in the TUM format
        (timestamp tx ty tz qx qy qz qw) or CSV with the same columns.
    up
        Orientation of the camera on loop, line, turn and still: top is level; back looks down, as below a mirror; front
        looks up.
    frames
        Maximum number of images: 60, or all poses of a file.
    fps
        Images per second. By default the images are distributed over the motion, or have the timestamps of a file.
    rays
        Rays per pixel: 1, 4, 9 or 16.
    exposure
        Exposure, stops.
    vignette
        Relative loss of light at the edge of the lens's image, 0 to 1; panoramas have none.
    blur
        Standard deviation of the lens blur, px.
    noise
        Standard deviation of the noise at middle gray, of 255.
    jpeg
        Write the images as JPEG of this quality.
    rolling_shutter
        Readout time from the first to the last row, milliseconds; poses are those of the middle row.
    exposure_time
        Duration of the exposure, milliseconds, for motion blur; 0 for sharp images. The pose is that of its middle.
    circle
        (low, high) angles from the axis, degrees; images are black outside. None is the calibrated field of view.
    exact
        Write depth and normals as float32 NumPy arrays instead of 16-bit images.
    seed
        Seed of the noise and of random parts of the scene.
    motion_sensors
        IMU, wheel odometry and GNSS.
    conditions
        Time of day, weather and drift of the exposure.
    export
        Other formats to write: colmap, covisibility, euroc, kitti and nerfstudio.
    """

    trajectory: str = "loop"
    up: Literal["top", "back", "front"] = "top"
    frames: int | None = None
    fps: float | None = None
    rays: int = 4
    exposure: float = 0.0
    vignette: float = 0.35
    blur: float = 0.7
    noise: float = 1.5
    jpeg: int | None = None
    rolling_shutter: float = 0.0
    exposure_time: float = 0.0
    circle: tuple[float, float] | None = None
    exact: bool = False
    seed: int = 0
    motion_sensors: MotionSensors = field(default_factory=MotionSensors)
    conditions: Conditions = field(default_factory=Conditions)
    export: tuple[str, ...] = ()
