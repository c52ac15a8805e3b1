"""Short rendered sequences with exact poses."""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.sfm.georeference import least_squares_similarity
from omnisight.simulation import fisheye_setup
from omnisight.simulation.trajectory import read_trajectory


class Sequence(NamedTuple):
    """Images of a camera, and their poses world_from_camera."""

    folder: Path
    camera: om.Camera
    images: list
    seconds: list
    poses: list

    def errors(self, trajectory):
        """Return the rms position error over the path length, and the largest rotation error, degrees."""
        true = [self.poses[pose.frame] for pose in trajectory]
        found = [pose.rig_from_world.inverse() for pose in trajectory]
        a, b = (np.array([pose.translation for pose in poses]) for poses in (found, true))
        aligned = least_squares_similarity(a, b)
        length = np.linalg.norm(np.diff(b, axis=0), axis=1).sum()
        first = true[0].rotation @ found[0].rotation.T
        turns = [first @ f.rotation @ t.rotation.T for f, t in zip(found, true, strict=True)]
        angle = np.degrees(np.linalg.norm(so3.log(np.array(turns)), axis=1)).max()
        return np.sqrt(((aligned @ a - b) ** 2).sum(axis=1).mean()) / length, angle


def render(folder, scene, camera, frames):
    om.simulate(om.SimulateOptions(scene, camera, folder, frames=frames, fps=10, rays=1, jpeg=95))
    trajectory = read_trajectory(folder / "poses.txt")
    images = [om.read_image(path) for path in sorted((folder / "images").iterdir())]
    return Sequence(folder, camera, images, list(trajectory.times), list(trajectory.poses))


@pytest.fixture(scope="session")
def fisheye(tmp_path_factory):
    """A fisheye that moves through a room."""
    setup = fisheye_setup(400)
    camera = dataclasses.replace(setup.camera, theta_max=setup.theta[1])
    return render(tmp_path_factory.mktemp("odometry") / "room", "room", camera, 36)


@pytest.fixture(scope="session")
def sphere(tmp_path_factory):
    """A 360 camera in a street."""
    return render(tmp_path_factory.mktemp("odometry") / "street", "street", om.sphere(512), 16)


@pytest.fixture(scope="session")
def run():
    """Return a function that tracks images, ten per second, and returns the odometry."""

    def track(sequence, images=None, **options):
        tracking = om.Odometry(sequence.camera, om.MotionOptions(**options))
        for k, image in enumerate(images or sequence.images):
            tracking.add(image, 0.1 * k)
        tracking.finish()
        return tracking

    return track
