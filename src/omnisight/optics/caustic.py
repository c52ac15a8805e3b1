"""The caustic of a camera: the envelope of its rays, which is a single point for a central camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.optics.ray_jacobians import HasRays, ray_jacobians

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Caustic:
    """The two sheets of a caustic: for each pixel, the points where its ray meets neighbouring rays.

    Attributes
    ----------
    tangential
        (..., 3) intersection with neighbours in the meridional plane: the envelope in a cross section. NaN where
        undefined or at infinity.
    sagittal
        (..., 3) intersection with neighbours across the meridional plane. For a camera of revolution it lies on the
        axis.
    along
        (..., 2) signed distances along the ray to the tangential and sagittal point. Negative values lie behind the
        ray's origin, where a mirror's virtual image is.
    """

    tangential: Array
    sagittal: Array
    along: Array


def caustic(camera: HasRays, pixels: ArrayLike) -> Caustic:
    """Compute the caustic of the rays of pixels (..., 2).

    The point o + t b of a ray also lies on the neighbouring ray at pixel u + du if

        (A + t B) du  is parallel to b,   A = d o/d u,  B = d b/d u.

    Projected onto the plane across b this is A B^-1 y = -t y with y = B du: t follows from the eigenvalues of a 2 x 2
    matrix (the vanishing Jacobian of Swaminathan, Grossberg and Nayar, Non-single viewpoint catadioptric cameras,
    IJCV 66(3), 2006). The eigenvalues are real if the rays have wavefronts, as rays from one lens do. Otherwise there
    is no caustic and the result is NaN.

    Parameters
    ----------
    camera
        Any object with `rays(pixels)`. Meridional planes contain its z axis.
    pixels
        (..., 2).
    """
    jacobians = ray_jacobians(camera, pixels)
    origins, bearings, valid = jacobians.rays
    basis = np.stack(_transverse_basis(bearings), -2)
    with np.errstate(all="ignore"):
        a, b = basis @ jacobians.d_origins, basis @ jacobians.d_bearings
        matrix = -a @ _inverse(b)
        p, q, r, s = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1]
        # Entry differences are more accurate than trace and determinant: a central camera has two equal eigenvalues.
        half = (p - s) / 2
        root = np.sqrt(half**2 + q * r)
        # p tends to the eigenvalue whose eigenvector is closer to the meridional plane.
        root = np.where(half < 0, -root, root)
        middle = (p + s) / 2
        along = np.where(valid[..., None], np.stack([middle + root, middle - root], -1), np.nan)
        along[~np.isfinite(along)] = np.nan
        points = origins[..., None, :] + along[..., None] * bearings[..., None, :]
    return Caustic(points[..., 0, :], points[..., 1, :], along)


def _transverse_basis(bearings: Array) -> tuple[Array, Array]:
    """Return unit vectors (..., 3) orthogonal to bearings: one in the meridional plane, one normal to it."""
    axis = np.array([0.0, 0.0, 1.0])
    sagittal = np.cross(axis, bearings)
    length = np.linalg.norm(sagittal, axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        sagittal = np.where(length > 1e-12, sagittal / length, np.array([0.0, 1.0, 0.0]))
    return np.cross(sagittal, bearings), sagittal


def _inverse(matrices: Array) -> Array:
    """Return the inverses of matrices (..., 2, 2); singular matrices give non-finite entries."""
    (a, b), (c, d) = np.moveaxis(matrices, (-2, -1), (0, 1))
    adjugate = np.stack([d, -b, -c, a], -1).reshape(matrices.shape)
    return adjugate / (a * d - b * c)[..., None, None]
