"""Minimal solvers on bearings: motion from the smallest number of correspondences.

Bearings are unit vectors of any direction, also behind the camera. A pose (3, 4) is [R | t]: `b_from_a` means
x_b = R x_a + t. Every returned solution has positive distances along all bearings of its sample. A degenerate
sample returns no solution or wrong ones, never NaN.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.twoview import _minimal_solvers_kernel as kernel

Array = NDArray[np.float64]


def five_point(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the relative poses of two calibrated cameras from five pairs of bearings.

    Degenerate if a point is repeated, and if all points have zero parallax (rotation without translation). A plane is
    not degenerate, but can have two solutions.

    D. Nister, An efficient solution to the five-point relative pose problem, PAMI 26, 2004.

    Parameters
    ----------
    a, b
        (5, 3) bearings of both cameras.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with translations of unit length and S <= 10, usually 1 to 3.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.five_point(*_sample(5, a, b))


def four_point_homography(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the homography between the bearings of points on a plane from four pairs.

    The bearings b are along H a and not opposite to it. Degenerate if three bearings of a camera lie in a plane, in
    particular if three points are collinear.

    R. Hartley and A. Zisserman, Multiple View Geometry, 2004, section 4.1, on the sphere.

    Parameters
    ----------
    a, b
        (4, 3) bearings of both cameras.

    Returns
    -------
    homographies
        (S, 3, 3) with the middle singular value 1 and S <= 1.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.four_point_homography(*_sample(4, a, b))


def poses_from_homography(homography: ArrayLike, a: ArrayLike) -> tuple[Array, Array]:
    """Decompose a homography H = R + t n^T/d into relative poses and the normals of the plane n.x = d of camera a.

    A translation along the normal has one solution, returned once or twice; all other motions usually have two. The
    cameras may see the plane from different sides.

    Z. Zhang and A. R. Hanson, 3D reconstruction based on homography mapping, ARPA Image Understanding Workshop, 1996.

    Parameters
    ----------
    homography
        (3, 3) homography with the middle singular value 1 and the sign that maps bearings to bearings.
    a
        (N, 3) bearings of points of the plane in camera a.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` [R | t/d] with S <= 2. All points have positive distances in both cameras.
    normals
        (S, 3) unit vectors, with n.a > 0 for all points; zero for a rotation without translation.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    (homography,) = _sample(3, homography)
    (a,) = _sample(len(np.asarray(a)), a)
    return kernel.poses_from_homography(homography, a)


def p3p(points: ArrayLike, bearings: ArrayLike) -> Array:
    """Compute the poses of a calibrated camera from three bearings of known points.

    Degenerate if the points are collinear or two bearings are parallel, and inaccurate if the camera lies near the
    circular cylinder through the points whose axis is normal to their plane (double solutions).

    M. Persson and K. Nordberg, Lambda Twist: an accurate fast robust perspective three point (P3P) solver, ECCV 2018;
    Y. Ding et al., Revisiting the P3P problem, CVPR 2023.

    Parameters
    ----------
    points
        (3, 3) points in the world frame.
    bearings
        (3, 3) bearings of the points in the camera frame.

    Returns
    -------
    poses
        (S, 3, 4) `camera_from_world` with S <= 4, in the unit of the points.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.p3p(*_sample(3, points, bearings))


def eight_point(a: ArrayLike, b: ArrayLike, weights: ArrayLike | None = None) -> Array:
    """Compute the relative pose of eight or more pairs of bearings by linear least squares.

    Degenerate if the points lie in a plane or, with both cameras, on a ruled quadric, and if all have zero parallax.

    R. I. Hartley, In defense of the eight-point algorithm, PAMI 19, 1997. The bearings are normalized by the square
    root of the inverse of their second moments, which is nearly the identity for bearings all around the camera.

    Parameters
    ----------
    a, b
        (N, 3) bearings of both cameras, N >= 8.
    weights
        (N,) weights of the squared residuals; default: ones.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with a translation of unit length and S <= 1: of the four decompositions of the essential
        matrix that with the most pairs at positive distances. It may not be all of them.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    count = max(len(np.asarray(a)), 8)
    weights = np.ones(count) if weights is None else np.ascontiguousarray(weights, float)
    if weights.shape != (count,):
        raise ValueError(f"expected weights of shape ({count},), got {weights.shape}")
    return kernel.eight_point(*_sample(count, a, b), weights)


def upright_three_point(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the relative poses of two cameras with a known vertical from three pairs of bearings.

    The vertical is the y axis of both camera frames: rotate the bearings so before. R is a rotation about y, t is
    general. Degenerate if a point is repeated, and if all points have zero parallax.

    F. Fraundorfer, P. Tanskanen and M. Pollefeys, A minimal case solution to the calibrated relative pose problem for
    the case of two known orientation angles, ECCV 2010.

    Parameters
    ----------
    a, b
        (3, 3) bearings of both cameras.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with translations of unit length and S <= 4.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.upright_three_point(*_sample(3, a, b))


def planar_two_point(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the relative poses of a camera that moves in a plane from two pairs of bearings.

    The plane is normal to the y axis of both camera frames: R is a rotation about y, t is normal to y. Degenerate if a
    bearing lies in the plane of motion, and if a point has zero parallax.

    S. Choi and J.-H. Kim, Fast and reliable minimal relative pose estimation under planar motion, Image and Vision
    Computing 69, 2018.

    Parameters
    ----------
    a, b
        (2, 3) bearings of both cameras.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with translations of unit length and S <= 2.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.planar_two_point(*_sample(2, a, b))


def circular_one_point(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the relative pose of a camera on a car from one pair of bearings.

    The car drives forwards or backwards on an arc of a circle. The camera is above the rear axle, y is the vertical and
    z points ahead: R is a rotation by the angle theta about y, and the camera moves at theta/2 to its z axis.
    Degenerate if both bearings lie in the plane of motion, and if the point has zero parallax.

    D. Scaramuzza, 1-point-RANSAC structure from motion for vehicle-mounted cameras by exploiting non-holonomic
    constraints, IJCV 95, 2011.

    Parameters
    ----------
    a, b
        (1, 3) bearings of both cameras.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with a translation of unit length and S <= 1.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.circular_one_point(*_sample(1, a, b))


def two_point_rotation(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the rotation of a camera without translation from two pairs of bearings.

    If the angles between the bearings differ in both cameras, the rotation distributes the difference equally.
    Degenerate if two bearings of a camera are parallel or opposite.

    H. D. Black, A passive system for determining the attitude of a satellite, AIAA Journal 2, 1964 (TRIAD), applied to
    the bisectors.

    Parameters
    ----------
    a, b
        (2, 3) bearings of both cameras.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with zero translation and S <= 1.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.two_point_rotation(*_sample(2, a, b))


def gp3p(points: ArrayLike, origins: ArrayLike, bearings: ArrayLike) -> Array:
    """Compute the poses of a rig or of a non-central camera from three rays to known points.

    Three rays with a common origin have the solutions of `p3p`. Degenerate if the points are collinear or the rays
    parallel.

    D. Nister and H. Stewenius, A minimal solution to the generalised 3-point pose problem, JMIV 27, 2007.

    Parameters
    ----------
    points
        (3, 3) points in the world frame.
    origins, bearings
        (3, 3) origins and directions of the rays in the frame of the rig, in the unit of the points.

    Returns
    -------
    poses
        (S, 3, 4) `rig_from_world` with S <= 8, in the unit of the points.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.gp3p(*_sample(3, points, origins, bearings))


def upright_p2p(points: ArrayLike, bearings: ArrayLike) -> Array:
    """Compute the poses of a camera with a known vertical from two bearings of known points.

    The vertical is the y axis of the world and of the camera frame: rotate points and bearings so before. Degenerate if
    one point is above the other, and if both bearings are horizontal.

    Z. Kukelova, M. Bujnak and T. Pajdla, Closed-form solutions to minimal absolute pose problems with known vertical
    direction, ACCV 2010.

    Parameters
    ----------
    points
        (2, 3) points in the world frame.
    bearings
        (2, 3) bearings of the points in the camera frame.

    Returns
    -------
    poses
        (S, 3, 4) `camera_from_world` with S <= 2, in the unit of the points; R is a rotation about y.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.upright_p2p(*_sample(2, points, bearings))


def _sample(count: int, *arrays: ArrayLike) -> list[Array]:
    """Return the arrays of a sample as contiguous floats; raise ValueError if one is not (count, 3)."""
    sample = [np.ascontiguousarray(array, float) for array in arrays]
    for array in sample:
        if array.shape != (count, 3):
            raise ValueError(f"expected an array of shape ({count}, 3), got {array.shape}")
    return sample
