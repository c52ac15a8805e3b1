"""The motion of the camera in `simulate`, and the measurements of the sensors of the motion."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.extensions import did_you_mean
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.pipeline.simulation.simulate_options import MAX_FRAMES, SimulateOptions
from omnisight.simulation import motion_sensor_files
from omnisight.simulation.motion_sensors import MotionMeasurements, measure_motion
from omnisight.simulation.preset_motion import PRESETS, preset_trajectory
from omnisight.simulation.scene import Scene
from omnisight.simulation.spline_trajectory import SplineTrajectory
from omnisight.simulation.trajectory import Motion, Trajectory, read_trajectory

Array = NDArray[np.float64]

DEFAULT_FRAMES = 60
# Differences between a spline and the poses of a file that are reported: above the noise of motion capture.
REPORTED_DISTANCE_M, REPORTED_ANGLE_RAD = 0.005, math.radians(0.1)


def camera_motion(options: SimulateOptions, scene: Scene) -> tuple[Motion, Array, list[str]]:
    """Return the motion, the times of its images, and warnings; a spline if the motion is measured by sensors."""
    motion, times = _trajectory(options, scene)
    if not options.motion_sensors:
        return motion, times, []
    spline = SplineTrajectory.fit(motion, end=float(times[-1]))
    distance, angle = spline.deviation(motion)
    if distance < REPORTED_DISTANCE_M and angle < REPORTED_ANGLE_RAD:
        return spline, times, []
    note = (
        f"the spline through {options.trajectory} differs from its poses by up to {distance:.3f} m and"
        f" {math.degrees(angle):.2f} degrees, because they are noisy or change faster than 5 Hz; poses.txt holds the"
        " poses of the spline"
    )
    return spline, times, [note]


def write_measurements(options: SimulateOptions, motion: Motion, times: Array) -> MotionMeasurements:
    """Write and return the measurements of the sensors of the motion, if there are any."""
    if not isinstance(motion, SplineTrajectory):
        return MotionMeasurements()
    span = float(times[0]), float(times[-1])
    measurements = measure_motion(options.motion_sensors, motion, span, look(up=options.up), options.seed)
    motion_sensor_files.write_motion_sensors(options.output, measurements, options.motion_sensors)
    return measurements


def check_trajectory(options: SimulateOptions) -> None:
    """Raise `ValueError` if there is no trajectory of this name, before the scene is built."""
    name, presets = options.trajectory, ", ".join(PRESETS)
    if name in PRESETS:
        return
    if options.up != "top":
        raise ValueError(f"--up {options.up} applies only to {presets}: the poses of a file define the orientation")
    if not Path(name).is_file():
        raise ValueError(f"--trajectory {name}: is neither a file nor one of {presets}{did_you_mean(name, PRESETS)}")


def _trajectory(options: SimulateOptions, scene: Scene) -> tuple[Trajectory, Array]:
    """Return the motion and the times of its images."""
    name = options.trajectory
    if name in PRESETS:
        count = options.frames or DEFAULT_FRAMES
        level = preset_trajectory(name, scene.free, count / options.fps if options.fps else 0.0, scene.route)
        rate = options.fps or count / level.times[-1]
        poses = tuple(pose @ Pose(look(up=options.up)) for pose in level.poses)
        return Trajectory(level.times, poses), np.arange(count) / rate
    motion = read_trajectory(name)
    times = motion.times
    if options.fps is not None:
        count = int((times[-1] - times[0]) * options.fps + 1e-6) + 1
        times = times[0] + np.arange(min(count, options.frames or MAX_FRAMES + 1)) / options.fps
    times = times[: options.frames]
    if len(times) > MAX_FRAMES:
        raise ValueError(f"{name}: more than {MAX_FRAMES} images; reduce them by --frames or --fps")
    return motion, times
