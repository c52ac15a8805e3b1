"""Geometry between two images, and between an image and points, on bearings of any direction."""

from omnisight.twoview.minimal_solvers import (
    circular_one_point,
    five_point,
    p3p,
    planar_two_point,
    two_point_rotation,
    upright_p2p,
    upright_three_point,
)

__all__ = [
    "circular_one_point",
    "five_point",
    "p3p",
    "planar_two_point",
    "two_point_rotation",
    "upright_p2p",
    "upright_three_point",
]
