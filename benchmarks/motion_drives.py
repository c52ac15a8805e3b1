"""Rendered drives that return to places seen before, for the benchmark of loop closing."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

import omnisight as om
from benchmarks.rendered_images import image_cache
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.simulation import Renderer, Scene, fisheye_setup, mirror_setup, scene_named
from omnisight.simulation.example_rigs import back_to_back
from omnisight.simulation.motion_blur import exposure_times
from omnisight.simulation.preset_motion import DRIVE, Route, preset_trajectory
from omnisight.simulation.trajectory import Trajectory, write_trajectory

# Images per second, and width of the images, px.
FPS, WIDTH = 10.0, 640
# Around one block of the town, on the right lane; there and back through the street, on two lanes.
BLOCK = ((7, 0, -1.7), (61, -0.4, -1.7), (69.7, -0.4, -1.7), (69.7, -0.5, 7), (69.7, -1.2, 43), (69.7, -1.2, 51.7))
BLOCK = (*BLOCK, (61, -1.2, 51.7), (7, -1.2, 51.7), (-1.7, -1.2, 51.7), (-1.7, -1.2, 43), (-1.7, 0, 7), (-1.7, 0, -1.7))
LANES = tuple((x, 0.0, z) for x, z in ((1, -30), (1, 10), (1, 52), (0, 55), (-1, 52), (-1, 10), (-1, -30), (0, -33)))
# Scenes of the drives, and routes through them; None is the preset loop: circles in the room and a walk through the
# corridor and all six rooms of the flat, at walking pace, and a drive around the whole town.
ROUTES: dict[str, tuple[str, Route | None]] = {
    "block": ("town", Route(BLOCK, 7.0, DRIVE)),
    "street": ("street", Route(LANES, 2.0, DRIVE)),
    "room": ("room", None),
    "flat": ("rooms", None),
    "town": ("town", None),
}
# Exposures, which alternate: each step changes the light by a factor of two.
EXPOSURES_STOPS, EXPOSURE_INTERVAL_S = (0.5, -0.5), 10.0
# Distance of the cameras of the rig, metres: those of a car.
RIG_BASELINE_M = 0.5
# Rays per side of a pixel.
SAMPLES = 2


@dataclass(frozen=True)
class Drive:
    """A rendered drive.

    Attributes
    ----------
    route, camera
        Names of the route and the camera.
    count
        Number of images.
    width
        Width of the images of a fisheye or a mirror, px.
    exposure_time
        Duration of the exposure, seconds, for motion blur; the exposure then also changes in steps. 0 for sharp images.
    seed
        Seed of the scene.
    fps
        Images per second.
    """

    route: str
    camera: str
    count: int
    width: int = WIDTH
    exposure_time: float = 0.0
    seed: int = 0
    fps: float = FPS

    @property
    def name(self) -> str:
        """Name of its folder."""
        others = f"-seed{self.seed}" if self.seed else ""
        others += f"-{self.fps:g}fps" if self.fps != FPS else ""
        others += f"-{self.width}px" if self.width != WIDTH else ""
        return f"{self.route}-{self.camera}-{self.count}{others}"

    @property
    def folder(self) -> Path:
        """Its folder in the cache, or in the folder of temporary files if there is no cache."""
        return image_cache("motion") / self.name

    @property
    def body(self) -> om.Camera | om.Rig:
        """The camera, or a rig of two fisheyes back to back."""
        if self.camera == "rig":
            return back_to_back(480, apart=RIG_BASELINE_M)
        return camera_named(self.camera, 960 if self.camera == "sphere" else self.width)

    @property
    def trajectory(self) -> Trajectory:
        """The poses world_from_rig of the images."""
        times = np.arange(self.count) / self.fps
        return Trajectory(times, tuple(self.motion.at(time) for time in times))

    @cached_property
    def motion(self) -> Trajectory:
        """The poses world_from_rig at short steps of time."""
        level = preset_trajectory(
            "loop", self.scene.free, self.count / self.fps, ROUTES[self.route][1] or self.scene.route
        )
        up = Pose(look(up="back" if self.camera == "mirror" else "top"))
        return Trajectory(level.times, tuple(pose @ up for pose in level.poses))

    def exposure(self, k: int) -> float:
        """Return the exposure of an image, stops."""
        return EXPOSURES_STOPS[int(k / self.fps / EXPOSURE_INTERVAL_S) % 2] if self.exposure_time else 0.0

    @property
    def scene(self) -> Scene:
        """The scene."""
        return scene_of(ROUTES[self.route][0], self.seed)


def camera_named(name: str, width: int) -> om.Camera:
    """Return the camera "sphere", "fisheye" or "mirror" with a width of its images, px."""
    if name == "sphere":
        return om.sphere(width)
    setup = fisheye_setup(width) if name == "fisheye" else mirror_setup(width)
    return replace(setup.camera, theta_min=setup.theta[0], theta_max=setup.theta[1])


def render(drive: Drive) -> Path:
    """Return the folder of a drive; render the images that it lacks."""
    folder, body = drive.folder, drive.body
    folder.mkdir(parents=True, exist_ok=True)
    om.save(body, folder / ("rig.json" if isinstance(body, om.Rig) else "camera.json"))
    for k in range(drive.count):
        for sensor, (path, camera, mounted) in enumerate(_views(folder, body, k)):
            if not path.exists():
                path.parent.mkdir(exist_ok=True)
                rng = np.random.default_rng((k, sensor))
                om.write_image(path, _renderer(drive, camera, mounted, k)(rng=rng, exposure=drive.exposure(k)).image)
    write_trajectory(folder / "poses.txt", drive.trajectory)
    return folder


def _renderer(drive: Drive, camera: om.Camera, rig_from_camera: Pose, k: int) -> Renderer:
    """Return the renderer of an image of a camera of a drive."""
    window = k / drive.fps, drive.exposure_time
    times = exposure_times(camera, drive.motion, rig_from_camera, drive.scene, window, SAMPLES)
    poses = [drive.motion.at(time) @ rig_from_camera for time in (window[0], *times)]
    theta = camera.theta_min or 0.0, camera.theta_max or np.pi
    return Renderer(camera, poses[0], drive.scene, theta=theta, samples=SAMPLES, shutter_poses=poses[1:])


@cache
def scene_of(name: str, seed: int) -> Scene:
    """Return a scene."""
    return scene_named(name, seed)


def _views(folder: Path, body: om.Camera | om.Rig, k: int) -> Iterator[tuple[Path, om.Camera, Pose]]:
    """Yield file, camera and pose rig_from_camera of the images of a frame."""
    if isinstance(body, om.Rig):
        for name, camera, mounted in zip(body.names, body.cameras, body.sensor_from_rig, strict=True):
            assert isinstance(camera, om.Camera)
            yield folder / name / f"{k:05d}.jpg", camera, mounted.inverse()
    else:
        yield folder / "images" / f"{k:05d}.jpg", body, Pose()
