"""Rendered sequences of a fisheye camera that is carried through a room."""

import dataclasses

import omnisight as om
from omnisight.simulation import fisheye_setup


def render_walk(folder, frames, width=400):
    """Render a sequence at 10 frames per second; return its folder, with images, camera and poses."""
    setup = fisheye_setup(width)
    camera = dataclasses.replace(setup.camera, theta_max=setup.theta[1])
    om.simulate(om.SimulateOptions("room", camera, folder, frames=frames, fps=10, rays=1, jpeg=95))
    return folder
