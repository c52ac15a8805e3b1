"""Compiled homographies between bearings of points on a plane, and their decomposition into poses and normals.

The plane n.x = d of camera a gives x_b = H x_a with H = R + t n^T/d. A homography maps bearings to directions, so its
sign is known, unlike that of a homography between image points.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.optim._eigen_kernel import symmetric_eigen
from omnisight.twoview._alignment_kernel import multiply, orthonormalize, rotation_between
from omnisight.twoview._small_vectors_kernel import copy_elements

# Difference of squared singular values below which the translation is zero.
MIN_STRETCH = 1e-14


@njit_helper
def four_point_homography(a, b, homographies):
    """Compute the homography of four pairs of bearings; return the number, 0 or 1.

    With a_4 = sum alpha_i a_i and b_4 = sum beta_i b_i, H maps a_i to (beta_i/alpha_i) b_i for i = 1, 2, 3.

    Parameters
    ----------
    a, b
        (4, 3) bearings of both cameras.
    homographies
        (1, 3, 3), receives H with the middle singular value 1; all b are along H a, not opposite.
    """
    h = homographies[0]
    h[:] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        factor = _determinant(b[3], b[j], b[k]) / _determinant(b[0], b[1], b[2]) / _determinant(a[3], a[j], a[k])
        factor *= _determinant(a[0], a[1], a[2])
        if not 0.0 < factor < np.inf:
            return 0
        factor /= _determinant(a[0], a[1], a[2])
        for m in range(3):
            after, last = (m + 1) % 3, (m + 2) % 3
            dual = factor * (a[j, after] * a[k, last] - a[j, last] * a[k, after])
            for n in range(3):
                h[n, m] += b[i, n] * dual
    values, vectors = np.empty(3), np.empty((3, 3))
    symmetric_eigen(multiply(h.T, h), values, vectors)
    if not 0.0 < values[1] < np.inf:
        return 0
    h /= np.sqrt(values[1])
    return 1


@njit_helper
def poses_from_homography(h, a, poses, normals):
    """Decompose a homography into the poses with all points in front of both cameras; return their number.

    Z. Zhang and A. R. Hanson, 3D reconstruction based on homography mapping, 1996: H is a rotation for the vectors in
    the plane, which are v_2 and sqrt(1 - s_3^2) v_1 +- sqrt(s_1^2 - 1) v_3 for the singular vectors v and values s. A
    transparent plane between the cameras, det H < 0, is no exception.

    Parameters
    ----------
    h
        (3, 3) homography with the middle singular value 1.
    a
        (N, 3) bearings of points of the plane in camera a.
    poses
        (2, 3, 4), receives [R | t/d].
    normals
        (2, 3), receives the unit normals towards the plane, n.a > 0; zero if the translation is zero.
    """
    values, v = np.empty(3), np.empty((3, 3))
    symmetric_eigen(multiply(h.T, h), values, v)
    if not values[2] - values[0] > MIN_STRETCH:
        copy_elements(poses[0], h)
        poses[0, :, 3] = normals[0] = 0.0
        orthonormalize(poses[0])
        return 1 if _determinant(h[0], h[1], h[2]) > 0.0 else 0
    along = np.empty((2, 3))
    count = 0
    for k in range(2):
        low, high = np.sqrt(max(1.0 - values[0], 0.0)), np.sqrt(max(values[2] - 1.0, 0.0))
        along[0], along[1] = v[1], low * v[2] + (high if k == 0 else -high) * v[0]
        moved = multiply(along, h.T)
        pose, n = poses[count], normals[count]
        _normal(along[0], along[1], n)
        sign = _common_sign(a, n)
        if sign != 0.0 and rotation_between(along[0], along[1], moved[0], moved[1], pose):
            n *= sign
            for i in range(3):
                pose[i, 3] = 0.0
                for j in range(3):
                    pose[i, 3] += (h[i, j] - pose[i, j]) * n[j]
            count += 1
    return count


@njit_helper
def _normal(u, v, normal):
    """Compute the unit vector along u x v."""
    normal[0], normal[1], normal[2] = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    normal /= np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)


@njit_helper
def _common_sign(vectors, normal):
    """Return the sign of the products of vectors with a normal, 0 if they have several."""
    positive, negative = 0, 0
    for n in range(len(vectors)):
        product = vectors[n, 0] * normal[0] + vectors[n, 1] * normal[1] + vectors[n, 2] * normal[2]
        positive += product > 0.0
        negative += product < 0.0
    return 1.0 if positive == len(vectors) else (-1.0 if negative == len(vectors) else 0.0)


@njit_helper
def _determinant(u, v, w):
    x, y, z = v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]
    return u[0] * x + u[1] * y + u[2] * z
