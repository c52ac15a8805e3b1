"""The caustic: the surface that the rays of a camera touch, where a single viewpoint would be a point."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.optics.congruence import SeesAlongRays, congruence

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Caustic:
    """The two sheets of a caustic, by pixel: where a ray meets its neighbours.

    Attributes
    ----------
    tangential
        (..., 3) where it meets those before and after it in its meridional plane: the envelope that a cross section
        shows. NaN where there is none, or at infinity.
    sagittal
        (..., 3) where it meets those beside it: of a camera that is one of revolution, a point of the axis.
    along
        (..., 2) how far along the ray they are, tangential and sagittal; negative behind its origin, where the light
        of a mirror only seems to come from.
    """

    tangential: Array
    sagittal: Array
    along: Array


def caustic(camera: SeesAlongRays, pixels: ArrayLike) -> Caustic:
    """Find the caustic of the rays of pixels (..., 2).

    The points o + t b of a ray and of its neighbours at pixels u + du meet where

        (A + t B) du  is parallel to b,   A = d o/d u,  B = d b/d u.

    Across b, that is A B^-1 y = -t y with y = B du: the eigenvalues of a 2 x 2 matrix (the vanishing Jacobian of
    Swaminathan, Grossberg and Nayar, Non-single viewpoint catadioptric cameras, IJCV 66(3), 2006). They are real
    wherever the rays have wavefronts, as those that one lens sends out have; others have no caustic: NaN.

    Parameters
    ----------
    camera
        Anything with `rays(pixels)`. The axis of what is meridional is z.
    pixels
        (..., 2).
    """
    found = congruence(camera, pixels)
    origins, bearings, valid = found.rays
    meridional, beside = _across(bearings)
    basis = np.stack([meridional, beside], -2)
    with np.errstate(all="ignore"):
        a, b = basis @ found.d_origins, basis @ found.d_bearings
        matrix = -a @ _inverse(b)
        p, q, r, s = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1]
        # From differences of the entries, not from trace and determinant: a central camera has two equal roots.
        half = (p - s) / 2
        root = np.sqrt(half**2 + q * r)
        # The root whose eigenvector lies nearer to the meridional plane is the one that p tends to.
        root = np.where(half < 0, -root, root)
        middle = (p + s) / 2
        along = np.where(valid[..., None], np.stack([middle + root, middle - root], -1), np.nan)
        along[~np.isfinite(along)] = np.nan
        points = origins[..., None, :] + along[..., None] * bearings[..., None, :]
    return Caustic(points[..., 0, :], points[..., 1, :], along)


def _across(bearings: Array) -> tuple[Array, Array]:
    """Give unit vectors (..., 3) across bearings: one in the plane of the z axis, one beside it."""
    axis = np.array([0.0, 0.0, 1.0])
    beside = np.cross(axis, bearings)
    length = np.linalg.norm(beside, axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        beside = np.where(length > 1e-12, beside / length, np.array([0.0, 1.0, 0.0]))
    meridional = np.cross(beside, bearings)
    return meridional, beside


def _inverse(matrices: Array) -> Array:
    """Give the inverses of matrices (..., 2, 2); where there is none, no finite number."""
    (a, b), (c, d) = np.moveaxis(matrices, (-2, -1), (0, 1))
    adjugate = np.stack([d, -b, -c, a], -1).reshape(matrices.shape)
    return adjugate / (a * d - b * c)[..., None, None]
