"""Mirror shapes for a field of view: one function per kind.

Parameters of each function: the angle theta, from straight down (towards the lens), of the scene direction reflected at
the rim; the half angle beta at which the lens sees the rim; and the radius of the rim. If the surface is inclined by
alpha to the plane across the axis, a ray that leaves the lens at beta is reflected to

    theta = 2 alpha + beta.

Theta and beta at the rim therefore determine a mirror with one shape parameter. theta + beta must be less than 180
degrees, where the ray grazes the rim.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic


@dataclass(frozen=True)
class MirrorKind:
    """A kind of mirror.

    Attributes
    ----------
    shape
        Function of theta, beta (radians) and the rim radius; returns the mirror and the distance from lens to vertex.
    central
        Whether the camera has a single viewpoint.
    parallel
        Whether the lens is telecentric: beta is 0 and the distance is arbitrary.
    description
        A few words for reports.
    """

    shape: Callable[[float, float, float], tuple[Conic | Cone, float]]
    central: bool
    parallel: bool
    description: str


def hyperbolic(theta: float, beta: float, rim: float) -> tuple[Conic, float]:
    """Return the hyperboloid with the lens in its far focus.

    A ray via both foci has tan(beta/2)/tan(theta/2) = (e - 1)/(e + 1). The surface is at the distance R/(1 + e
    cos(theta)) from the near focus.
    """
    q = np.tan(beta / 2) / np.tan(theta / 2)
    e = (1 + q) / (1 - q)
    radius = rim * (1 + e * np.cos(theta)) / np.sin(theta)
    return Conic(radius=float(radius), eccentricity=float(e), rim=rim), float(radius / (e - 1))


def parabolic(theta: float, beta: float, rim: float) -> tuple[Conic, float]:
    """Return the paraboloid rho = R tan(theta/2). The lens distance is arbitrary; 3 rim radii by default."""
    del beta
    return Conic(radius=float(rim / np.tan(theta / 2)), eccentricity=1.0, rim=rim), 3 * rim


def spherical(theta: float, beta: float, rim: float) -> tuple[Conic, float]:
    """Return the sphere rho = R sin(alpha)."""
    alpha = (theta - beta) / 2
    sag = rim * np.tan(alpha / 2)
    return Conic(radius=float(rim / np.sin(alpha)), eccentricity=0.0, rim=rim), float(rim / np.tan(beta) - sag)


def conical(theta: float, beta: float, rim: float) -> tuple[Cone, float]:
    """Return the cone of constant inclination alpha; its field is theta - beta to theta."""
    alpha = (theta - beta) / 2
    return Cone(half_angle=float(np.pi / 2 - alpha), rim=rim), float(rim / np.tan(beta) - rim * np.tan(alpha))


KINDS = {
    "hyperbolic": MirrorKind(hyperbolic, True, False, "hyperboloid with the lens in its far focus"),
    "parabolic": MirrorKind(parabolic, True, True, "paraboloid with a telecentric lens"),
    "spherical": MirrorKind(spherical, False, False, "sphere, no single viewpoint"),
    "conical": MirrorKind(conical, False, False, "cone, no single viewpoint"),
}
