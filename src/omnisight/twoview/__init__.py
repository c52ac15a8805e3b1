"""Geometry between two images, and between an image and points, on bearings of any direction."""

from omnisight.twoview.generalized_relative_pose import seventeen_point
from omnisight.twoview.minimal_solvers import (
    circular_one_point,
    eight_point,
    five_point,
    four_point_homography,
    gp3p,
    p3p,
    planar_two_point,
    poses_from_homography,
    two_point_rotation,
    upright_p2p,
    upright_three_point,
)

__all__ = [
    "circular_one_point",
    "eight_point",
    "five_point",
    "four_point_homography",
    "gp3p",
    "p3p",
    "planar_two_point",
    "poses_from_homography",
    "seventeen_point",
    "two_point_rotation",
    "upright_p2p",
    "upright_three_point",
]
