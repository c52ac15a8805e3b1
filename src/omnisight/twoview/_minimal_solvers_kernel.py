"""Compiled minimal solvers as functions that Python calls with one sample; each returns the solutions."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver
from omnisight.twoview import _alignment_kernel as alignment_kernel
from omnisight.twoview import _eight_point_kernel as eight_point_kernel
from omnisight.twoview import _five_point_kernel as five_point_kernel
from omnisight.twoview import _gp3p_kernel as gp3p_kernel
from omnisight.twoview import _homography_kernel as homography_kernel
from omnisight.twoview import _p3p_kernel as p3p_kernel
from omnisight.twoview import _upright_kernel as upright_kernel
from omnisight.twoview import _upright_p2p_kernel as upright_p2p_kernel


@njit_driver
def five_point(a, b):
    poses = np.empty((10, 3, 4))
    return poses[: five_point_kernel.five_point(a, b, poses)]


@njit_driver
def p3p(points, bearings):
    poses = np.empty((4, 3, 4))
    return poses[: p3p_kernel.p3p(points, bearings, poses)]


@njit_driver
def two_point_rotation(a, b):
    poses = np.empty((1, 3, 4))
    return poses[: alignment_kernel.two_point_rotation(a, b, poses)]


@njit_driver
def upright_three_point(a, b):
    poses = np.empty((4, 3, 4))
    return poses[: upright_kernel.upright_three_point(a, b, poses)]


@njit_driver
def planar_two_point(a, b):
    poses = np.empty((2, 3, 4))
    return poses[: upright_kernel.planar_two_point(a, b, poses)]


@njit_driver
def circular_one_point(a, b):
    poses = np.empty((1, 3, 4))
    return poses[: upright_kernel.circular_one_point(a, b, poses)]


@njit_driver
def upright_p2p(points, bearings):
    poses = np.empty((2, 3, 4))
    return poses[: upright_p2p_kernel.upright_p2p(points, bearings, poses)]


@njit_driver
def eight_point(a, b, weights):
    poses = np.empty((1, 3, 4))
    return poses[: eight_point_kernel.eight_point(a, b, weights, poses)]


@njit_driver
def four_point_homography(a, b):
    homographies = np.empty((1, 3, 3))
    return homographies[: homography_kernel.four_point_homography(a, b, homographies)]


@njit_driver
def poses_from_homography(h, a):
    poses, normals = np.empty((2, 3, 4)), np.empty((2, 3))
    count = homography_kernel.poses_from_homography(h, a, poses, normals)
    return poses[:count], normals[:count]


@njit_driver
def gp3p(points, origins, bearings):
    poses = np.empty((8, 3, 4))
    return poses[: gp3p_kernel.gp3p(points, origins, bearings, poses)]
