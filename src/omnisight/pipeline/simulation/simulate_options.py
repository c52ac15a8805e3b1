"""Options of `simulate`."""

from dataclasses import dataclass
from pathlib import Path

from omnisight.motion_sensor_options import MotionSensors
from omnisight.pipeline.simulation.rendering_options import RenderingOptions
from omnisight.rig import Rig, Sensor
from omnisight.simulation.exports import get_export
from omnisight.simulation.sensor import check_sensor

# Larger requests are mistakes, and would fill the disk.
MAX_FRAMES = 100_000
RAYS_PER_PIXEL = (1, 4, 9, 16)


@dataclass(frozen=True)
class SimulateOptions(RenderingOptions):
    """Options of `simulate`.

    Attributes
    ----------
    scene
        room, rooms, street, town, boards or lines.
    camera
        A calibration file of any format, or a camera or rig. Non-central cameras are supported.
    output
        Folder of the data set. It is created if needed; a folder with other content is refused.
    """

    scene: str
    camera: Path | Sensor | Rig
    output: Path

    def __post_init__(self) -> None:
        """Check the ranges of all values."""
        super().__post_init__()
        if self.rays not in RAYS_PER_PIXEL:
            raise ValueError(f"--rays must be 1, 4, 9 or 16, got {self.rays}")
        if self.frames is not None and not 1 <= self.frames <= MAX_FRAMES:
            raise ValueError(f"--frames must be from 1 to {MAX_FRAMES}, got {self.frames}")
        if self.fps is not None and not 1e-3 <= self.fps <= 1e5:
            raise ValueError(f"--fps must be from 0.001 to 100000 images per second, got {self.fps:g}")
        if not 0 <= self.vignette <= 1:
            raise ValueError(f"--vignette must be from 0 to 1, got {self.vignette:g}")
        if not 0 <= self.rolling_shutter <= 1e4:
            raise ValueError(f"--rolling-shutter must be from 0 to 10000 milliseconds, got {self.rolling_shutter:g}")
        if not 0 <= self.exposure_time <= 1e4:
            raise ValueError(f"--exposure-time must be from 0 to 10000 milliseconds, got {self.exposure_time:g}")
        if self.seed < 0:
            raise ValueError(f"--seed must not be negative, got {self.seed}")
        if self.circle is not None and not 0 <= self.circle[0] < self.circle[1] <= 180:
            low, high = self.circle
            raise ValueError(f"--circle must be two angles from 0 to 180 degrees, such as 0:95, got {low:g}:{high:g}")
        self._check_motion_sensors()
        for name in self.export:
            if get_export(name).NEEDS_IMU and not self.motion_sensors.imu:
                raise ValueError(f"--export {name} needs an IMU: add --imu RATE, such as --imu 200")
        check_sensor(exposure=self.exposure, blur=self.blur, noise=self.noise, jpeg=self.jpeg)

    def _check_motion_sensors(self) -> None:
        """Raise ValueError for options of sensors of the motion that are not simulated."""
        sensors = self.motion_sensors
        if sensors.noise != MotionSensors.noise and not sensors:
            raise ValueError(
                f"--sensor-noise {sensors.noise:g}: there is no sensor of the motion: add --imu, --odometry or --gnss"
                " RATE, such as --imu 200 (--noise is the noise of the images)"
            )
        if sensors.origin != MotionSensors.origin and not sensors.gnss and self.conditions.time is None:
            raise ValueError(
                f"--origin {','.join(f'{value:g}' for value in sensors.origin)}: nothing depends on it: add --gnss"
                " RATE, such as --gnss 5, or --time HH:MM for the sun at its latitude"
            )
