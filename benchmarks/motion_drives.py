"""Rendered drives that return to places seen before, for the benchmark of loop closing."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

import omnisight as om
from benchmarks.rendered_images import image_cache
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.simulation import Renderer, Scene, fisheye_setup, mirror_setup, scene_named
from omnisight.simulation.example_rigs import back_to_back
from omnisight.simulation.preset_motion import DRIVE, Route, preset_trajectory
from omnisight.simulation.trajectory import Trajectory, write_trajectory

FPS = 10.0
# Around one block of the town, on the right lane; there and back through the street, on two lanes.
BLOCK = ((7, 0, -1.7), (61, -0.4, -1.7), (69.7, -0.4, -1.7), (69.7, -0.5, 7), (69.7, -1.2, 43), (69.7, -1.2, 51.7))
BLOCK = (*BLOCK, (61, -1.2, 51.7), (7, -1.2, 51.7), (-1.7, -1.2, 51.7), (-1.7, -1.2, 43), (-1.7, 0, 7), (-1.7, 0, -1.7))
LANES = tuple((x, 0.0, z) for x, z in ((1, -30), (1, 10), (1, 52), (0, 55), (-1, 52), (-1, 10), (-1, -30), (0, -33)))
ROUTES = {"block": ("town", Route(BLOCK, 7.0, DRIVE)), "street": ("street", Route(LANES, 2.0, DRIVE))}
# Distance of the cameras of the rig, metres: those of a car.
RIG_BASELINE_M = 0.5


@dataclass(frozen=True)
class Drive:
    """A rendered drive: route, camera and number of images."""

    route: str
    camera: str
    count: int

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.route}-{self.camera}-{self.count}"

    @property
    def folder(self) -> Path:
        """Its folder in the cache, or in the folder of temporary files if there is no cache."""
        return image_cache("motion") / self.name

    @property
    def body(self) -> om.Camera | om.Rig:
        """The camera, or a rig of two fisheyes back to back."""
        if self.camera == "rig":
            return back_to_back(480, apart=RIG_BASELINE_M)
        if self.camera == "sphere":
            return om.sphere(960)
        setup = fisheye_setup(640) if self.camera == "fisheye" else mirror_setup(640)
        return replace(setup.camera, theta_min=setup.theta[0], theta_max=setup.theta[1])

    @property
    def trajectory(self) -> Trajectory:
        """The poses world_from_rig of the images."""
        _, route = ROUTES[self.route]
        times = np.arange(self.count) / FPS
        level = preset_trajectory("loop", ((0, 0, 0), (1, 1, 1)), times[-1], route)
        up = Pose(look(up="back" if self.camera == "mirror" else "top"))
        return Trajectory(times, tuple(level.at(time) @ up for time in times))


def render(drive: Drive) -> Path:
    """Return the folder of a drive; render the images that it lacks."""
    folder, trajectory, scene = drive.folder, drive.trajectory, scene_of(ROUTES[drive.route][0])
    folder.mkdir(parents=True, exist_ok=True)
    body = drive.body
    om.save(body, folder / ("rig.json" if isinstance(body, om.Rig) else "camera.json"))
    for k, pose in enumerate(trajectory.poses):
        for sensor, (path, camera, place) in enumerate(_views(folder, body, k, pose)):
            if not path.exists():
                path.parent.mkdir(exist_ok=True)
                renderer = Renderer(camera, place, scene, theta=(camera.theta_min or 0.0, camera.theta_max or np.pi))
                om.write_image(path, renderer(rng=np.random.default_rng((k, sensor))).image)
    write_trajectory(folder / "poses.txt", trajectory)
    return folder


@cache
def scene_of(name: str) -> Scene:
    """Return a scene."""
    return scene_named(name)


def _views(folder: Path, body: om.Camera | om.Rig, k: int, pose: Pose) -> Iterator[tuple[Path, om.Camera, Pose]]:
    """Yield file, camera and pose world_from_camera of the images of a frame."""
    if isinstance(body, om.Rig):
        for name, camera, mounted in zip(body.names, body.cameras, body.sensor_from_rig, strict=True):
            assert isinstance(camera, om.Camera)
            yield folder / name / f"{k:05d}.jpg", camera, pose @ mounted.inverse()
    else:
        yield folder / "images" / f"{k:05d}.jpg", body, pose
