"""Options of the sensors of the motion of a simulated body; they are those of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass, field

from omnisight.display import Displayed

MAX_RATE_HZ = 10_000.0
RATES = ("imu", "odometry", "gnss")


@dataclass(frozen=True)
class ImuNoise(Displayed):
    """Noise of an IMU in the convention of EuRoC and Kalibr. Defaults: ADIS16448, as in EuRoC's sensor.yaml.

    Attributes
    ----------
    gyroscope_density
        White noise, rad/s/sqrt(Hz).
    gyroscope_walk
        Random walk of the bias, rad/s^2/sqrt(Hz).
    accelerometer_density
        White noise, m/s^2/sqrt(Hz).
    accelerometer_walk
        Random walk of the bias, m/s^3/sqrt(Hz).
    gyroscope_bias, accelerometer_bias
        Standard deviation of the biases at the beginning, rad/s and m/s^2: what remains after a calibration.
    """

    gyroscope_density: float = 1.6968e-4
    gyroscope_walk: float = 1.9393e-5
    accelerometer_density: float = 2.0e-3
    accelerometer_walk: float = 3.0e-3
    gyroscope_bias: float = 5e-3
    accelerometer_bias: float = 5e-2


@dataclass(frozen=True)
class OdometryNoise(Displayed):
    """Noise of wheel odometry, one standard deviation.

    Attributes
    ----------
    scale
        Relative error of the wheel radius, constant.
    speed, yaw_rate
        Noise of a sample, m/s and rad/s.
    """

    scale: float = 0.005
    speed: float = 0.02
    yaw_rate: float = 0.005


@dataclass(frozen=True)
class GnssNoise(Displayed):
    """Noise of a GNSS receiver, one standard deviation of each horizontal axis; the vertical one is twice as large.

    Attributes
    ----------
    correlated
        Slowly varying part (atmosphere, orbits), a Gauss-Markov process, metres.
    correlation_time
        Its correlation time, seconds.
    white
        White noise of a position, metres.
    """

    correlated: float = 1.0
    correlation_time: float = 60.0
    white: float = 0.3


@dataclass(frozen=True)
class MotionSensors(Displayed):
    """Sensors of the motion of the body.

    Attributes
    ----------
    imu
        Samples per second of an IMU at the body's origin, such as 200; 0 for none. With any sensor of the motion, the
        poses are interpolated by a twice continuously differentiable spline.
    odometry
        Samples per second of wheel odometry: forward speed and yaw rate; 0 for none.
    gnss
        Positions per second of a GNSS receiver; 0 for none.
    noise
        Factor of the noise and biases of these sensors; 0 for exact measurements.
    origin
        Latitude and longitude, degrees, and altitude, metres, of the world's origin.
    imu_noise, odometry_noise, gnss_noise
        Noise of each.
    """

    imu: float = 0.0
    odometry: float = 0.0
    gnss: float = 0.0
    noise: float = 1.0
    origin: tuple[float, float, float] = (47.3769, 8.5417, 408.0)
    imu_noise: ImuNoise = field(default_factory=ImuNoise)
    odometry_noise: OdometryNoise = field(default_factory=OdometryNoise)
    gnss_noise: GnssNoise = field(default_factory=GnssNoise)

    def __post_init__(self) -> None:
        """Check the ranges of all values."""
        for name in RATES:
            if not 0 <= getattr(self, name) <= MAX_RATE_HZ:
                raise ValueError(f"--{name} must be from 0 to {MAX_RATE_HZ:g} Hz, got {getattr(self, name):g}")
        if not 0 <= self.noise <= 1e6:
            raise ValueError(f"--sensor-noise must be a factor from 0 to 1000000, got {self.noise:g}")
        latitude, longitude, altitude = self.origin
        if not (abs(latitude) <= 90 and abs(longitude) <= 360 and abs(altitude) <= 1e5):
            text = ",".join(f"{value:g}" for value in self.origin)
            raise ValueError(f"--origin must be LATITUDE,LONGITUDE,ALTITUDE in degrees and metres, got {text}")

    def __bool__(self) -> bool:
        """Return whether there is any sensor."""
        return bool(self.imu or self.odometry or self.gnss)
