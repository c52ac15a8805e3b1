"""Rendering of a data set with ground truth: the counterpart of `omnisight simulate`."""

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import omnisight
from omnisight.display import Displayed
from omnisight.formats import FormatError, is_rig_file, load, load_rig
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import angle_from_axis
from omnisight.motion_sensor_options import RATES, MotionSensors
from omnisight.pipeline.simulation.simulate_options import SimulateOptions
from omnisight.pipeline.simulation.simulated_motion import camera_motion, check_trajectory, write_measurements
from omnisight.pipeline.simulation.simulated_scene import visited_scene
from omnisight.progress import Progress, no_progress
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig, Sensor
from omnisight.simulation import motion_sensor_files
from omnisight.simulation.dataset import (
    EXPOSURE_DESCRIPTION,
    MASK_DESCRIPTION,
    Dataset,
    MountedCamera,
    depth_steps_per_metre,
)
from omnisight.simulation.daylight import clock
from omnisight.simulation.exports import SimulatedSequence, get_export, remove_exports, write_exports
from omnisight.simulation.image_samples import ImageSample
from omnisight.simulation.motion_blur import exposure_times
from omnisight.simulation.render import Renderer
from omnisight.simulation.scene import Scene
from omnisight.simulation.sensor import exposure_drift
from omnisight.simulation.trajectory import Motion, Trajectory

# Larger images are mistakes, and would fill the memory.
MAX_IMAGE_PIXELS = 50_000_000
# Pixels per side sampled to decide whether the image circle shows anything.
CIRCLE_SAMPLES = 200


@dataclass(frozen=True)
class SimulatedDataset(Displayed):
    """A data set that was written.

    Attributes
    ----------
    folder
        Where it is.
    cameras
        The cameras with their poses on the body.
    frames
        Number of images of each camera.
    settings
        What settings.json holds.
    notes
        Warnings, such as a camera inside a solid.
    seconds
        Duration of rendering and writing.
    """

    folder: Path
    cameras: tuple[MountedCamera, ...]
    frames: int
    settings: dict[str, Any]
    notes: tuple[str, ...]
    seconds: float


def simulate(
    options: SimulateOptions, *, progress: Progress = no_progress, warn: Callable[[str], None] | None = None
) -> SimulatedDataset:
    """Render images of a scene along a trajectory, and write them with the ground truth of every pixel.

    The folder gets images, depth, normals and instances as PNG, poses in the TUM format, the camera, and a README.txt
    that describes them.

    Parameters
    ----------
    options
        The scene, the camera, the trajectory and the sensor.
    progress
        Called with a stage, the steps done and the total.
    warn
        Called with each warning before rendering starts.

    Raises
    ------
    ValueError
        If an option, the camera or the trajectory is not usable.
    OSError
        If a file cannot be read or written.
    """
    start = time.perf_counter()
    cameras = mounted_cameras(options.camera, options.circle)
    exports = [get_export(name) for name in options.export]
    for export in exports:
        export.check(cameras)
    check_trajectory(options)
    progress("build the scene", 0, 1)
    scene, notes = visited_scene(options)
    motion, times, more_notes = camera_motion(options, scene)
    notes += more_notes + _collision_notes(scene, motion, times, cameras)
    for note in notes if warn else ():
        warn(note)  # pyright: ignore[reportOptionalCall]
    steps = depth_steps_per_metre(scene)
    dataset = Dataset.create(options.output, cameras, exact=options.exact, jpeg=options.jpeg, depth_steps=steps)
    remove_exports(options.output)
    progress("build the scene", 1, 1)
    rendering = _Rendering(options, scene, motion, times, dataset, any(export.NEEDS_SAMPLES for export in exports))
    samples, total = list[ImageSample](), len(times) * len(cameras)
    for k, camera in enumerate(cameras):
        samples += rendering.write_images(k, camera, lambda done: progress("render", done, total))
    progress("render", total, total)
    settings = _settings(options, len(times)) | {"depth_steps_per_metre": None if options.exact else steps}
    measurements = write_measurements(options, motion, times)
    sequence = SimulatedSequence(options.output, cameras, times, motion, dataset.image_suffix, samples, measurements)
    descriptions = _descriptions(options) + write_exports(options.export, sequence)
    dataset.finish(settings, Trajectory(times, tuple(motion.at(float(moment)) for moment in times)), descriptions)
    seconds = time.perf_counter() - start
    return SimulatedDataset(options.output, tuple(cameras), len(times), settings, tuple(notes), seconds)


@dataclass(frozen=True, eq=False)
class _Rendering:
    """What is rendered and where it is written.

    Attributes
    ----------
    options
        Options of the command.
    scene, motion, times
        The scene, the motion of the body in it, and the times of the images, seconds.
    dataset
        The files.
    keeps_samples
        Whether images and their ground truth are needed after all are rendered.
    """

    options: SimulateOptions
    scene: Scene
    motion: Motion
    times: NDArray[np.float64]
    dataset: Dataset
    keeps_samples: bool

    def write_images(self, k: int, camera: MountedCamera, progress: Callable[[int], None]) -> list[ImageSample]:
        """Render and write the images of a camera with their ground truth; return those that exports need."""
        options, scene, times, dataset, samples = (
            self.options,
            self.scene,
            self.times,
            self.dataset,
            list[ImageSample](),
        )
        exposures = options.exposure + exposure_drift(
            times, options.conditions.exposure_drift, np.random.default_rng((options.seed, k, 1, 2))
        )
        for i, moment in enumerate(times):
            progress(k * len(times) + i)
            renderer = _renderer(options, scene.at(float(moment)), camera, self.motion, float(moment))
            rng = np.random.default_rng((options.seed, k, i))
            rendered = renderer(rng=rng, exposure=float(exposures[i]), blur=options.blur, noise=options.noise)
            truth = renderer.truth()
            moving = np.isin(truth.instances, [scene.instance(actor.name) for actor in scene.actors])
            dataset.write_frame(camera, i, rendered.image, truth)
            if scene.actors:
                dataset.write_mask(camera, i, moving)
            if self.keeps_samples:
                samples.append(ImageSample.of(rendered.image, truth, moving))
            if i == 0:
                dataset.write_photometry(camera, renderer.vignetting())
        if options.conditions.exposure_drift:
            dataset.write_exposures(camera, times, exposures)
        poses = tuple(self.motion.at(float(moment)) @ camera.rig_from_camera for moment in times)
        dataset.write_camera(camera, Trajectory(times, poses), options.scene, scene.names)
        return samples


def _descriptions(options: SimulateOptions) -> list[str]:
    """Return the sections of the README on files that are written on request."""
    optional = (
        (motion_sensor_files.DESCRIPTION, options.motion_sensors),
        (MASK_DESCRIPTION, options.conditions.traffic),
        (EXPOSURE_DESCRIPTION, options.conditions.exposure_drift),
    )
    return [text for text, present in optional if present]


def mounted_cameras(source: Path | Sensor | Rig, circle: tuple[float, float] | None) -> list[MountedCamera]:
    """Return the cameras of a file, camera or rig with their poses; a single camera is its own rig.

    Raises
    ------
    ValueError
        If an image size is missing or too large, lengths are not metres, or `circle` (degrees) shows nothing.
    """
    label = source if isinstance(source, Path) else "camera"
    cameras: list[MountedCamera] = []
    for name, camera, rig_from_camera in _sensors(source):
        if min(camera.size) < 1:
            raise ValueError(f"{label}: has no image size; add it to the file")
        if camera.size[0] * camera.size[1] > MAX_IMAGE_PIXELS:
            raise ValueError(
                f"{label}: images of {camera.size[0]}x{camera.size[1]} px are too large to render:"
                f" at most {MAX_IMAGE_PIXELS / 1e6:.0f} megapixels; correct the image size in the file"
            )
        if isinstance(camera, RayCamera) and camera.unit != "m":
            raise ValueError(
                f"{label}: the lengths of this camera are in {camera.unit}, not metres: calibrate it with --square"
            )
        if not re.fullmatch(r"(\w[\w .-]{0,99})?", name):
            raise ValueError(f"{label}: the camera name {name[:100]!r} cannot be used as a folder name")
        if circle is None:
            theta = camera.theta_min, math.pi if camera.theta_max is None else camera.theta_max
        else:
            theta = math.radians(circle[0]), math.radians(circle[1])
            if not _shows_any(camera, theta):
                raise ValueError(f"--circle {circle[0]:g}:{circle[1]:g} excludes the whole field of view of {label}")
        cameras.append(MountedCamera(name, camera, rig_from_camera, theta))
    return cameras


def _sensors(source: Path | Sensor | Rig) -> list[tuple[str, Sensor, Pose]]:
    """Return name, camera and rig_from_camera of every camera."""
    label = source if isinstance(source, Path) else "rig"
    if isinstance(source, Path):
        try:
            source = load_rig(source)
        except FormatError:
            if is_rig_file(source):
                raise
            source = load(source, option=None)
    if not isinstance(source, Rig):
        return [("", source, Pose())]
    if source.unit != "m" and len(source) > 1:
        raise ValueError(
            f"{label}: the lengths of this rig are in {source.unit}, not metres: calibrate it with --square"
        )
    poses = [pose.inverse() for pose in source.sensor_from_rig]
    return list(zip(source.names, source.cameras, poses, strict=True))


def _shows_any(camera: Sensor, theta: tuple[float, float]) -> bool:
    """Return whether any ray of the image is between two angles from the axis (radians)."""
    u, v = (np.linspace(0, side - 1, min(side, CIRCLE_SAMPLES)) for side in camera.size)
    rays = camera.rays(np.stack(np.meshgrid(u, v), -1))
    angle = angle_from_axis(rays.bearings[rays.valid])
    return bool(((angle >= theta[0]) & (angle <= theta[1])).any())


def _collision_notes(
    scene: Scene, motion: Motion, times: NDArray[np.float64], cameras: list[MountedCamera]
) -> list[str]:
    """Return a warning for each camera that enters a solid or leaves the scene."""
    notes: list[str] = []
    for camera in cameras:
        positions = [(motion.at(float(moment)) @ camera.rig_from_camera).translation for moment in times]
        solids = scene.solids_at(positions)
        inside = [i for i, name in enumerate(solids) if name]
        if inside:
            first = inside[0]
            x, y, z = positions[first]
            notes.append(
                f"{len(inside)} of {len(times)} images{f' of {camera.name}' * bool(camera.name)} are taken inside a"
                f" solid or behind a wall: first {first:06d} at ({x:.2f}, {y:.2f}, {z:.2f}) m, in {solids[first]!r};"
                f" the free space is {scene.free[0]} to {scene.free[1]}"
            )
    return notes


def _renderer(options: SimulateOptions, scene: Scene, camera: MountedCamera, motion: Motion, moment: float) -> Renderer:
    """Return the renderer of one frame; with a rolling shutter each row has its own pose."""
    mounted = camera.rig_from_camera

    def poses(time: float) -> Pose | list[Pose]:
        if not options.rolling_shutter:
            return motion.at(time) @ mounted
        rows = motion.row_poses(time, camera.camera.size[1], options.rolling_shutter / 1e3)
        return [row @ mounted for row in rows]

    samples, window = math.isqrt(options.rays), (moment, options.exposure_time / 1e3)
    times = exposure_times(camera.camera, motion, mounted, scene, window, samples)
    return Renderer(
        camera.camera,
        poses(moment),
        scene,
        theta=camera.theta,
        samples=samples,
        vignette=options.vignette,
        shutter_poses=[poses(time) for time in times],
    )


def _settings(options: SimulateOptions, frames: int) -> dict[str, Any]:
    """Return what settings.json records."""
    return {
        "omnisight": omnisight.__version__,
        "scene": options.scene,
        "camera": options.camera.name if isinstance(options.camera, Path) else None,
        "trajectory": options.trajectory,
        "up": options.up,
        "frames": frames,
        "rays": options.rays,
        "exposure": options.exposure,
        "vignette": options.vignette,
        "blur": options.blur,
        "noise": options.noise,
        "jpeg": options.jpeg,
        "rolling_shutter_ms": options.rolling_shutter,
        "exposure_time_ms": options.exposure_time,
        "circle": None if options.circle is None else "{:g}:{:g}".format(*options.circle),
        "seed": options.seed,
        "export": ",".join(options.export) or None,
        "time": None if options.conditions.time is None else clock(options.conditions.time),
        "weather": options.conditions.weather,
        "exposure_drift": options.conditions.exposure_drift,
        "visit": options.conditions.visit,
        "traffic": options.conditions.traffic,
        "motion_sensors": _sensor_settings(options.motion_sensors),
    }


def _sensor_settings(sensors: MotionSensors) -> dict[str, Any] | None:
    if not sensors:
        return None
    return {f"{name}_hz": getattr(sensors, name) for name in RATES} | {
        "noise": sensors.noise,
        "origin": list(sensors.origin),
    }
