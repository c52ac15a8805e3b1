"""Rendering of a data set with ground truth: the counterpart of `omnisight simulate`."""

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import omnisight
from omnisight.formats import FormatError, load, load_rig
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.geometry.sphere import angle_from_axis
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig, Sensor
from omnisight.simulation.dataset import Dataset, MountedCamera, depth_steps_per_metre
from omnisight.simulation.preset_motion import PRESETS, preset_trajectory
from omnisight.simulation.render import Renderer
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes import scene_named
from omnisight.simulation.sensor import check_sensor
from omnisight.simulation.trajectory import Trajectory, read_trajectory

Progress = Callable[[str, int, int], None]

DEFAULT_FRAMES = 60
# Larger requests are mistakes, and would fill the disk or the memory.
MAX_FRAMES, MAX_IMAGE_PIXELS = 100_000, 50_000_000
# Pixels per side sampled to decide whether the image circle shows anything.
CIRCLE_SAMPLES = 200
RAYS_PER_PIXEL = (1, 4, 9, 16)


@dataclass(frozen=True)
class SimulateOptions:
    """Options of `simulate`.

    Attributes
    ----------
    scene
        room, rooms, street, town, boards or lines.
    camera
        A calibration file of any format, or a camera or rig. Non-central cameras are supported.
    output
        Folder of the data set. It is created if needed; a folder with other content is refused.
    trajectory
        loop, line, turn or still, at the speed of a walking person; loop follows the roads of the town, as a car, and
        enters all rooms of `rooms`. Or a file of world_from_cam poses (world_from_rig for a rig), in the TUM format
        (timestamp tx ty tz qx qy qz qw) or CSV with the same columns.
    up
        Orientation of the camera on the trajectories loop, line, turn and still: "top" is level; "back" looks down, as
        below a mirror; "front" looks up.
    frames
        Maximum number of images: 60, or all poses of a file.
    fps
        Images per second. By default the images are spread over the motion, or have the timestamps of a file.
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
        Quality of the images as JPEG; None for PNG.
    rolling_shutter
        Readout time from the first to the last row, milliseconds. Poses are those of the middle row.
    circle
        (low, high) angles from the axis, degrees; images are black outside. None is the calibrated field of view.
    exact
        Write depth and normals as float32 NumPy arrays instead of 16-bit images.
    seed
        Seed of the noise and of random parts of the scene.
    """

    scene: str
    camera: Path | Sensor | Rig
    output: Path
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
    circle: tuple[float, float] | None = None
    exact: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the ranges of all values."""
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
        if self.seed < 0:
            raise ValueError(f"--seed must not be negative, got {self.seed}")
        if self.circle is not None and not 0 <= self.circle[0] < self.circle[1] <= 180:
            low, high = self.circle
            raise ValueError(f"--circle must be two angles from 0 to 180 degrees, such as 0:95, got {low:g}:{high:g}")
        check_sensor(exposure=self.exposure, blur=self.blur, noise=self.noise, jpeg=self.jpeg)


@dataclass(frozen=True)
class SimulatedDataset:
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
    options: SimulateOptions, *, progress: Progress | None = None, warn: Callable[[str], None] | None = None
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
    report = progress or (lambda stage, done, total: None)
    cameras = mounted_cameras(options.camera, options.circle)
    report("build the scene", 0, 1)
    scene = scene_named(options.scene, options.seed)
    motion, times = _trajectory(options, scene)
    notes = _collision_notes(scene, motion, times, cameras)
    for note in notes if warn else ():
        warn(note)  # pyright: ignore[reportOptionalCall]
    steps = depth_steps_per_metre(scene)
    dataset = Dataset.create(options.output, cameras, exact=options.exact, jpeg=options.jpeg, depth_steps=steps)
    report("build the scene", 1, 1)
    total = len(times) * len(cameras)
    for k, camera in enumerate(cameras):
        for i, moment in enumerate(times):
            report("render", k * len(times) + i, total)
            renderer = _renderer(options, scene, camera, motion, float(moment))
            rng = np.random.default_rng((options.seed, k, i))
            rendered = renderer(rng=rng, exposure=options.exposure, blur=options.blur, noise=options.noise)
            dataset.write_frame(camera, i, rendered.image, renderer.truth())
            if i == 0:
                dataset.write_photometry(camera, renderer.vignetting())
        poses = tuple(motion.at(float(moment)) @ camera.rig_from_camera for moment in times)
        dataset.write_camera(camera, Trajectory(times, poses), options.scene, scene.names)
    report("render", total, total)
    settings = _settings(options, len(times)) | {"depth_steps_per_metre": None if options.exact else steps}
    dataset.finish(settings, Trajectory(times, tuple(motion.at(float(moment)) for moment in times)))
    seconds = time.perf_counter() - start
    return SimulatedDataset(options.output, tuple(cameras), len(times), settings, tuple(notes), seconds)


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
            raise ValueError(f"{label}: images of {camera.size[0]}x{camera.size[1]} px are too large to render")
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
    if isinstance(source, Path):
        try:
            source = load_rig(source)
        except FormatError:
            source = load(source)
    if not isinstance(source, Rig):
        return [("", source, Pose())]
    poses = [pose.inverse() for pose in source.sensor_from_rig]
    return list(zip(source.names, source.cameras, poses, strict=True))


def _shows_any(camera: Sensor, theta: tuple[float, float]) -> bool:
    """Return whether any ray of the image is between two angles from the axis (radians)."""
    u, v = (np.linspace(0, side - 1, min(side, CIRCLE_SAMPLES)) for side in camera.size)
    rays = camera.rays(np.stack(np.meshgrid(u, v), -1))
    angle = angle_from_axis(rays.bearings[rays.valid])
    return bool(((angle >= theta[0]) & (angle <= theta[1])).any())


def _trajectory(options: SimulateOptions, scene: Scene) -> tuple[Trajectory, NDArray[np.float64]]:
    """Return the motion and the times of its images."""
    name = options.trajectory
    if name in PRESETS:
        count = options.frames or DEFAULT_FRAMES
        level = preset_trajectory(name, scene.free, count / options.fps if options.fps else 0.0, scene.route)
        rate = options.fps or count / level.times[-1]
        poses = tuple(pose @ Pose(look(up=options.up)) for pose in level.poses)
        return Trajectory(level.times, poses), np.arange(count) / rate
    presets = ", ".join(PRESETS)
    if options.up != "top":
        raise ValueError(f"--up {options.up} applies only to {presets}: the poses of a file define the orientation")
    if not Path(name).is_file():
        raise ValueError(f"--trajectory {name}: is neither a file nor one of {presets}")
    motion = read_trajectory(name)
    times = motion.times
    if options.fps is not None:
        count = int((times[-1] - times[0]) * options.fps + 1e-6) + 1
        times = times[0] + np.arange(min(count, options.frames or MAX_FRAMES + 1)) / options.fps
    times = times[: options.frames]
    if len(times) > MAX_FRAMES:
        raise ValueError(f"{name}: more than {MAX_FRAMES} images; reduce them by --frames or --fps")
    return motion, times


def _collision_notes(
    scene: Scene, motion: Trajectory, times: NDArray[np.float64], cameras: list[MountedCamera]
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


def _renderer(
    options: SimulateOptions, scene: Scene, camera: MountedCamera, motion: Trajectory, moment: float
) -> Renderer:
    """Return the renderer of one frame; with a rolling shutter each row has its own pose."""
    if options.rolling_shutter:
        rows = motion.row_poses(moment, camera.camera.size[1], options.rolling_shutter / 1e3)
        pose = [row @ camera.rig_from_camera for row in rows]
    else:
        pose = motion.at(moment) @ camera.rig_from_camera
    samples = math.isqrt(options.rays)
    return Renderer(camera.camera, pose, scene, theta=camera.theta, samples=samples, vignette=options.vignette)


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
        "circle": None if options.circle is None else "{:g}:{:g}".format(*options.circle),
        "seed": options.seed,
    }
