"""The single viewpoint: where a lens must stand for it, and how far a camera is from having one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.optics.mirrors import Mirror
from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane
from omnisight.optics.ray_jacobians import HasRays, ray_jacobians

Array = NDArray[np.float64]

# The rays are parallel, as far as a point nearest to them goes, if they differ by less than this (radians, squared).
PARALLEL = 1e-18


@dataclass(frozen=True)
class LensPosition:
    """Where a lens may stand so that all rays seem to meet in one point.

    Attributes
    ----------
    lens
        z of the lens' centre in the mirror's frame (vertex at 0, the lens' side is negative): -inf for a telecentric
        lens, that sees parallel rays; None where any place will do.
    viewpoint
        z of the point where the rays meet; None where it is the lens' mirror image.
    useless
        Why it is of no use; empty where it is of use.
    """

    lens: float | None
    viewpoint: float | None
    useless: str = ""


def lens_positions(mirror: Mirror) -> tuple[LensPosition, ...]:
    """Give every place on the axis where a lens makes the mirror a camera with a single viewpoint.

    All of them by Baker and Nayar, A theory of single-viewpoint catadioptric image formation, IJCV 35(2), 1999: the
    conic sections of revolution with the lens in a focus and the viewpoint in the other, and their limits: plane,
    sphere and cone. An asphere has none, unless it is a conic.
    """
    if isinstance(mirror, Plane):
        return (LensPosition(None, None),)
    if isinstance(mirror, Cone):
        return (LensPosition(0.0, 0.0, "in the cone's tip a lens sees only what grazes the cone"),)
    if isinstance(mirror, Conic):
        return _in_foci(mirror)
    return ()


def _in_foci(mirror: Conic) -> tuple[LensPosition, ...]:
    """Give the places for a conic: its foci."""
    radius, e, (near, far) = mirror.radius, mirror.eccentricity, mirror.foci
    if e == 0:
        inside = "inside the mirror" if radius > 0 else "in the centre of the sphere, where a lens sees only itself"
        return (LensPosition(near, near, inside),)
    if radius > 0:
        if e < 1:
            inside = "inside the mirror: a convex ellipsoid has both foci behind its surface"
            return (LensPosition(far, near, inside), LensPosition(near, far, inside))
        return (LensPosition(far, near),)
    if e == 1:
        return (LensPosition(-np.inf, near), LensPosition(near, -np.inf, "a searchlight: all rays leave along the axis"))
    if e > 1:  # the far focus lies behind the surface, where no lens can stand
        return (LensPosition(near, far),)
    return (LensPosition(far, near), LensPosition(near, far))


@dataclass(frozen=True)
class Viewpoint:
    """The point nearest to all rays of a camera, and how far they pass it.

    Attributes
    ----------
    point
        (3,) in the camera's frame.
    pixels
        (N, 2), those asked for that see anything.
    distances
        (N,) of their rays, as whole lines, from the point, in the unit of the origins.
    px_per_radian
        (N,) how far the image moves for a turn of the ray towards the point.
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
        """Give the error in px (N,) of taking the camera for a central one, for things so far from the viewpoint.

        A ray that passes the viewpoint at a distance p meets what is D away from it under the angle asin(p/D) to the
        direction in which that lies: at infinity nothing, and nearer the more.

        Raises
        ------
        ValueError
            If a ray passes the viewpoint farther off than that.
        """
        if not distance > self.worst:
            raise ValueError(
                f"rays pass the viewpoint at up to {self.worst:.3g}: things {distance:.3g} away lie between them"
            )
        return np.arcsin(self.distances / distance) * self.px_per_radian


def best_viewpoint(camera: HasRays, pixels: ArrayLike) -> Viewpoint:
    """Find the point nearest, in least squares, to the rays of pixels (..., 2).

    Parameters
    ----------
    camera
        Anything with `rays(pixels)`.
    pixels
        Every one counts the same: those of a regular grid weigh the image's area.

    Raises
    ------
    ValueError
        If fewer than two pixels see anything, or all rays are parallel: then every point is as good.
    """
    flat = np.asarray(pixels, float).reshape(-1, 2)
    found = ray_jacobians(camera, flat)
    use = found.rays.valid & np.isfinite(found.d_bearings).all((-1, -2))
    origins, bearings = found.rays.origins[use], found.rays.bearings[use]
    if len(bearings) < 2:
        raise ValueError(f"a viewpoint needs two rays or more; {len(bearings)} of {len(flat)} pixels see anything")
    # The distance of p from a line is |(I - b b^T)(p - o)|; its squares' sum is least where their gradient is nought.
    across = np.eye(3) - bearings[:, :, None] * bearings[:, None, :]
    normal = across.mean(0)
    if np.linalg.eigvalsh(normal)[0] < PARALLEL:
        raise ValueError("all rays are parallel: there is no viewpoint, or it is infinitely far")
    middle = origins.mean(0)  # solved about it, so that a far origin costs no digits
    moments = np.einsum("nij,nj->i", across, origins - middle) / len(origins)
    point = middle + np.linalg.solve(normal, moments)
    away = np.einsum("nij,nj->ni", across, point - origins)
    return Viewpoint(
        point, flat[use], np.linalg.norm(away, axis=1), _px_per_radian(found.d_bearings[use], bearings, away)
    )


def _px_per_radian(d_bearings: Array, bearings: Array, towards: Array) -> Array:
    """Give how far (N,) the image moves for a turn of the bearings (N, 3) in directions (N, 3) across them.

    Where no direction is told, for a ray through the viewpoint, it does not matter: any will do.
    """
    length = np.linalg.norm(towards, axis=1, keepdims=True)
    aside = np.cross(bearings, np.eye(3)[np.abs(bearings).argmin(1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    with np.errstate(all="ignore"):
        turn = np.where(length > 0, towards / length, aside)
    return np.linalg.norm(np.linalg.pinv(d_bearings) @ turn[:, :, None], axis=1)[:, 0]
