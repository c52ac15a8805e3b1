"""Compile what the tests need into the cache of compiled code, in steps that processes can share."""

import contextlib
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import omnisight as om


def compile_step(step):
    """Run a step: the name of a function of this module, or of a camera model. An error is left to the tests."""
    with contextlib.suppress(Exception):
        if step in FUNCTIONS:
            FUNCTIONS[step]()
        else:
            model = om.model_class(step).example()
            model.unproject(model.project(np.array([[0.1, 0.2, 1.0]]))[0])


def detect():
    from drawn import POSES, shot
    from omnisight.images import write_image
    from omnisight.targets import Checkerboard, detect_boards

    with TemporaryDirectory() as folder:
        image = Path(folder) / "board.png"
        write_image(image, shot(POSES[0])[0])
        detect_boards([image], Checkerboard(9, 6), cache=False)


def render():
    from omnisight.simulation import fisheye_setup

    fisheye_setup(64).renderer(samples=1)()


def calibrate():
    from omnisight.calibration.warm_up import warm_up

    warm_up()


def solve():
    from omnisight import twoview

    for solver, count in (
        (twoview.five_point, 5),
        (twoview.eight_point, 8),
        (twoview.four_point_homography, 4),
        (twoview.upright_three_point, 3),
        (twoview.planar_two_point, 2),
        (twoview.circular_one_point, 1),
        (twoview.two_point_rotation, 2),
        (twoview.p3p, 3),
        (twoview.upright_p2p, 2),
    ):
        solver(np.zeros((count, 3)), np.zeros((count, 3)))
    twoview.poses_from_homography(np.eye(3), np.eye(3))
    twoview.gp3p(np.eye(3), np.eye(3), np.eye(3))


FUNCTIONS = {step.__name__: step for step in (detect, render, calibrate, solve)}
# The longest first.
STEPS = (*FUNCTIONS, *om.model_names())
