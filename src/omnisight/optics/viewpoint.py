"""The single viewpoint: lens positions that give one, and the best viewpoint of any camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed
from omnisight.optics.mirrors import Mirror
from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane
from omnisight.optics.ray_jacobians import HasRays, ray_jacobians

Array = NDArray[np.float64]

# Rays count as parallel if the normal matrix of the nearest point has a smaller eigenvalue (mean squared angle, rad^2):
# below it the viewpoint is undetermined in double precision.
MIN_SQUARED_PARALLAX_RAD2 = 1e-18


@dataclass(frozen=True)
class LensPosition:
    """A position of the lens for which all rays meet in one point.

    Attributes
    ----------
    lens
        z of the lens centre in the mirror frame (vertex at 0, lens side negative). -inf for a telecentric lens; None if
        any position works.
    viewpoint
        z of the point where the rays meet; None if it is the mirror image of the lens centre.
    unusable_because
        Why the position cannot be used in practice; empty if it can.
    """

    lens: float | None
    viewpoint: float | None
    unusable_because: str = ""


def lens_positions(mirror: Mirror) -> tuple[LensPosition, ...]:
    """Return every position on the axis where a lens gives the mirror a single viewpoint.

    The complete set by Baker and Nayar, A theory of single-viewpoint catadioptric image formation, IJCV 35(2), 1999:
    conic sections of revolution with the lens in one focus and the viewpoint in the other, and their limits (plane,
    sphere, cone). An asphere has none.
    """
    if isinstance(mirror, Plane):
        return (LensPosition(None, None),)
    if isinstance(mirror, Cone):
        return (LensPosition(0.0, 0.0, "at the apex of the cone a lens sees only rays that graze the cone"),)
    if isinstance(mirror, Conic):
        return _foci_positions(mirror)
    return ()


def _foci_positions(mirror: Conic) -> tuple[LensPosition, ...]:
    """Return the positions for a conic: its foci."""
    radius, e, (near, far) = mirror.radius, mirror.eccentricity, mirror.foci
    if e == 0:
        inside = "inside the mirror" if radius > 0 else "at the centre of the sphere a lens sees only itself"
        return (LensPosition(near, near, inside),)
    if radius > 0:
        if e < 1:
            inside = "inside the mirror: a convex ellipsoid has both foci behind its surface"
            return (LensPosition(far, near, inside), LensPosition(near, far, inside))
        return (LensPosition(far, near),)
    if e == 1:
        return (LensPosition(-np.inf, near), LensPosition(near, -np.inf, "all rays leave parallel to the axis"))
    if e > 1:  # the far focus is behind the reflecting surface
        return (LensPosition(near, far),)
    return (LensPosition(far, near), LensPosition(near, far))


@dataclass(frozen=True)
class Viewpoint(Displayed):
    """The point nearest to all rays of a camera, and the distances of the rays from it.

    Attributes
    ----------
    point
        (3,) in the camera frame.
    pixels
        (N, 2), the pixels that have a valid ray.
    distances
        (N,) of their rays, as infinite lines, from the point, in the unit of the origins.
    px_per_radian
        (N,) image displacement per rotation of the ray towards the point.
    """

    point: Array
    pixels: Array
    distances: Array
    px_per_radian: Array

    @property
    def rms(self) -> float:
        """Root mean square of the distances."""
        return float(np.sqrt(np.mean(self.distances**2)))

    @property
    def worst(self) -> float:
        """The largest distance."""
        return float(self.distances.max())

    def parallax(self, distance: float) -> Array:
        """Return the error (N,), px, of a central model for scene points at a distance from the viewpoint.

        A ray at distance p from the viewpoint meets points at distance D at the angle asin(p/D) to their direction.
        The error vanishes at infinity and grows with 1/D.

        Raises
        ------
        ValueError
            If a ray is farther from the viewpoint than `distance`.
        """
        if not distance > self.worst:
            raise ValueError(
                f"rays miss the viewpoint by up to {self.worst:.3g}, more than the scene distance {distance:.3g}: use a"
                " larger distance"
            )
        return np.arcsin(self.distances / distance) * self.px_per_radian


def best_viewpoint(camera: HasRays, pixels: ArrayLike) -> Viewpoint:
    """Estimate the point nearest to the rays of pixels (..., 2) in least squares.

    Parameters
    ----------
    camera
        Any object with `rays(pixels)`.
    pixels
        All pixels have equal weight; a regular grid weights the image by area.

    Raises
    ------
    ValueError
        If fewer than two pixels have valid rays, or all rays are parallel.
    """
    flat = np.asarray(pixels, float).reshape(-1, 2)
    jacobians = ray_jacobians(camera, flat)
    use = jacobians.rays.valid & np.isfinite(jacobians.d_bearings).all((-1, -2))
    origins, bearings = jacobians.rays.origins[use], jacobians.rays.bearings[use]
    if len(bearings) < 2:
        raise ValueError(f"a viewpoint needs at least two rays; {len(bearings)} of {len(flat)} pixels have one")
    # The distance of p from a line is |(I - b b^T)(p - o)|; the normal equations of the sum of its squares are linear.
    projectors = np.eye(3) - bearings[:, :, None] * bearings[:, None, :]
    normal = projectors.mean(0)
    if np.linalg.eigvalsh(normal)[0] < MIN_SQUARED_PARALLAX_RAD2:
        raise ValueError("all rays are parallel: there is no viewpoint at a finite distance")
    centre = origins.mean(0)  # centred, because distant origins lose digits
    moments = np.einsum("nij,nj->i", projectors, origins - centre) / len(origins)
    point = centre + np.linalg.solve(normal, moments)
    offsets = np.einsum("nij,nj->ni", projectors, point - origins)
    scale = _px_per_radian(jacobians.d_bearings[use], bearings, offsets)
    return Viewpoint(point, flat[use], np.linalg.norm(offsets, axis=1), scale)


def _px_per_radian(d_bearings: Array, bearings: Array, towards: Array) -> Array:
    """Return the image displacement (N,) per rotation of bearings (N, 3) towards transverse directions (N, 3).

    Any transverse direction serves if the given one is zero (a ray through the viewpoint): its parallax is zero.
    """
    length = np.linalg.norm(towards, axis=1, keepdims=True)
    transverse = np.cross(bearings, np.eye(3)[np.abs(bearings).argmin(1)])
    transverse /= np.linalg.norm(transverse, axis=1, keepdims=True)
    with np.errstate(all="ignore"):
        direction = np.where(length > 0, towards / length, transverse)
    return np.linalg.norm(np.linalg.pinv(d_bearings) @ direction[:, :, None], axis=1)[:, 0]
