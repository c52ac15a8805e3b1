"""Files of the sensors of the motion: tables as in EuRoC, and the noise of the IMU as Kalibr reads it."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.images import write_bytes
from omnisight.motion_sensor_options import MotionSensors
from omnisight.simulation.motion_sensors import GRAVITY, ImuMeasurements, MotionMeasurements

Array = NDArray[np.float64]

FOLDER = "motion"
FILES = tuple(f"{FOLDER}/{name}" for name in ("imu.csv", "imu_biases.csv", "imu.yaml", "odometry.csv", "gnss.csv"))
IMU_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
BIAS_HEADER = (
    "#timestamp [ns],b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],"
    "b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)
ODOMETRY_HEADER = "#timestamp [ns],speed [m s^-1],yaw rate to the left [rad s^-1]"
GNSS_HEADER = "#timestamp [ns],latitude [deg],longitude [deg],altitude [m],sigma east [m],sigma north [m],sigma up [m]"
IMU_YAML = """# Of the body frame; for Kalibr and programs that read its files. Gravity is {gravity} m/s^2.
accelerometer_noise_density: {accelerometer_density:.6g}
accelerometer_random_walk: {accelerometer_walk:.6g}
gyroscope_noise_density: {gyroscope_density:.6g}
gyroscope_random_walk: {gyroscope_walk:.6g}
rostopic: /imu0
update_rate: {rate:.10g}
"""
DESCRIPTION = """\
motion/      sensors in the body frame, that of the rig or of the single camera; timestamps in nanoseconds
             imu.csv: angular velocity and specific force, columns of EuRoC; imu_biases.csv: true biases; imu.yaml:
             noise in Kalibr's format. odometry.csv: forward speed and yaw rate. gnss.csv: positions on WGS 84; the
             world's +x is east, +z is north.
"""


def write_motion_sensors(folder: Path, measurements: MotionMeasurements, sensors: MotionSensors) -> None:
    """Write the measurements into the subfolder `motion` of a data set."""
    measurements_folder = folder / FOLDER
    measurements_folder.mkdir(exist_ok=True)
    if (imu := measurements.imu) is not None:
        write_bytes(measurements_folder / "imu.csv", imu_table(imu))
        biases = np.column_stack([imu.gyroscope_bias, imu.accelerometer_bias])
        write_bytes(measurements_folder / "imu_biases.csv", table(BIAS_HEADER, imu.times, biases))
        write_bytes(measurements_folder / "imu.yaml", _imu_yaml(sensors))
    if (odometry := measurements.odometry) is not None:
        values = np.column_stack([odometry.speed, odometry.yaw_rate])
        write_bytes(measurements_folder / "odometry.csv", table(ODOMETRY_HEADER, odometry.times, values))
    if (gnss := measurements.gnss) is not None:
        values = np.column_stack([gnss.geodetic, np.tile(gnss.sigma, (len(gnss.times), 1))])
        write_bytes(measurements_folder / "gnss.csv", table(GNSS_HEADER, gnss.times, values))


def imu_table(imu: ImuMeasurements) -> bytes:
    """Return the table of an IMU in the format of EuRoC."""
    return table(IMU_HEADER, imu.times, np.column_stack([imu.angular_velocity, imu.specific_force]))


def table(header: str, times: Array, values: Array) -> bytes:
    """Return a CSV table (N, K) with timestamps in nanoseconds."""
    rows: Iterable[list[float]] = values.tolist()
    lines = [
        f"{time}," + ",".join(f"{value:.12g}" for value in row)
        for time, row in zip(nanoseconds(times), rows, strict=True)
    ]
    return ("\n".join([header, *lines]) + "\n").encode()


def nanoseconds(times: Array) -> list[int]:
    """Return times (N,), seconds, in nanoseconds."""
    return [round(time * 1e9) for time in times.tolist()]


def _imu_yaml(sensors: MotionSensors) -> bytes:
    values = {name: sensors.noise * value for name, value in vars(sensors.imu_noise).items()}
    return IMU_YAML.format(**values, rate=sensors.imu, gravity=GRAVITY).encode()
