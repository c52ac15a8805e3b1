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


def relative_pose():
    om.relative_pose(*bearings(), sigma_deg=0.05)


def resect():
    om.resect(*bearings(), sigma_deg=0.05)


def estimate_car_motion():
    from omnisight.optim.ransac import RansacOptions
    from omnisight.twoview.bearing_pairs import BearingPairs
    from omnisight.visual_odometry.car_motion import estimate_car_motion

    estimate_car_motion(BearingPairs.of(*bearings(), None, None, 0.05), np.eye(3), RansacOptions())


def bearings():
    """Return the bearings of points from two places."""
    points = np.random.default_rng(0).normal(size=(100, 3))
    return tuple(x / np.linalg.norm(x, axis=1, keepdims=True) for x in (points, np.add(points, (0.1, 0.0, -0.2))))


ROBUST = relative_pose, resect, estimate_car_motion
FUNCTIONS = {step.__name__: step for step in (solve, render, *ROBUST, detect, calibrate)}
# The longest first.
STEPS = (*FUNCTIONS, *om.model_names())
