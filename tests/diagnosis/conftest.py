"""A short rendered recording."""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.simulation import fisheye_setup
from omnisight.simulation.trajectory import quaternion, read_trajectory


class Clip(NamedTuple):
    """A rendered recording: its folder, its camera, and its images."""

    folder: Path
    camera: om.Camera
    images: list

    def write(self, folder, images):
        """Write other images, and return their folder."""
        folder.mkdir()
        for k, image in enumerate(images):
            om.write_image(folder / f"{k:03d}.png", image)
        return folder


def render(folder, **options):
    setup = fisheye_setup(400)
    camera = dataclasses.replace(setup.camera, theta_max=setup.theta[1])
    om.simulate(om.SimulateOptions("room", camera, folder, rays=1, **options))
    return Clip(folder, camera, [om.read_image(path) for path in sorted((folder / "images").iterdir())])


@pytest.fixture(scope="session")
def walk(tmp_path_factory):
    """A fisheye that is carried through a room."""
    return render(tmp_path_factory.mktemp("doctor") / "walk", frames=32, fps=10, jpeg=95)


@pytest.fixture(scope="session")
def rolling(tmp_path_factory, walk):
    """The camera shakes, and has a readout of 40 ms."""
    folder = tmp_path_factory.mktemp("doctor")
    way = read_trajectory(walk.folder / "poses.txt")
    lines = []
    for seconds in np.arange(0, 3.2, 0.01):
        center = [np.interp(seconds, way.times, axis) for axis in np.transpose([p.translation for p in way.poses])]
        turn = 0.25 * np.sin(np.array([5, 3.1, 4]) * seconds + [0, 0, 1])
        values = [seconds, *center, *quaternion(so3.exp(turn))]
        lines.append(" ".join(f"{value:.6f}" for value in values))
    (folder / "shake.tum").write_text("\n".join(lines))
    trajectory = str(folder / "shake.tum")
    return render(folder / "rolling", trajectory=trajectory, fps=10, jpeg=95, rolling_shutter=40.0)
