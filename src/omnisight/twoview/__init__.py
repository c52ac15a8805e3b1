"""Geometry between two images, and between an image and points, on bearings of any direction."""

from omnisight.twoview.minimal_solvers import five_point, p3p

__all__ = ["five_point", "p3p"]
