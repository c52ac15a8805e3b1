"""The shapes of mirrors by the field they show: one function per kind.

Every one is told the angle theta, from the axis towards the lens, at which the rim shows the world, the half angle beta
under which the lens sees the rim, and the rim's radius. At a mirror whose surface leans by alpha against the plane
across the axis, a ray that leaves the lens at beta goes out at

    theta = 2 alpha + beta,

so that theta and beta at the rim settle a mirror that has one parameter beside its size. All show the rim as long as
theta + beta < 180 degrees: there the ray grazes it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic


@dataclass(frozen=True)
class Kind:
    """A kind of mirror.

    Attributes
    ----------
    shape
        From theta and beta, radians, and the rim's radius to the mirror and the distance of the lens from its vertex.
    central
        Whether it has a single viewpoint.
    parallel
        Whether its lens is telecentric: beta is 0, and the distance is free.
    said
        What it is, in a few words.
    """

    shape: Callable[[float, float, float], tuple[Conic | Cone, float]]
    central: bool
    parallel: bool
    said: str


def hyperbolic(theta: float, beta: float, rim: float) -> tuple[Conic, float]:
    """Give the hyperboloid with the lens in its far focus.

    A ray from focus to focus keeps tan(beta/2)/tan(theta/2) = (e - 1)/(e + 1); from the near focus the surface is
    R/(1 + e cos(theta)) away.
    """
    q = np.tan(beta / 2) / np.tan(theta / 2)
    e = (1 + q) / (1 - q)
    radius = rim * (1 + e * np.cos(theta)) / np.sin(theta)
    return Conic(radius=float(radius), eccentricity=float(e), rim=rim), float(radius / (e - 1))


def parabolic(theta: float, beta: float, rim: float) -> tuple[Conic, float]:
    """Give the paraboloid, rho = R tan(theta/2); the lens may stand anywhere, three rims away for a start."""
    del beta
    return Conic(radius=float(rim / np.tan(theta / 2)), eccentricity=1.0, rim=rim), 3 * rim


def spherical(theta: float, beta: float, rim: float) -> tuple[Conic, float]:
    """Give the sphere, rho = R sin(alpha)."""
    alpha = (theta - beta) / 2
    sag = rim * np.tan(alpha / 2)
    return Conic(radius=float(rim / np.sin(alpha)), eccentricity=0.0, rim=rim), float(rim / np.tan(beta) - sag)


def conical(theta: float, beta: float, rim: float) -> tuple[Cone, float]:
    """Give the cone, that leans by alpha everywhere: it shows from theta - beta to theta, as much as the lens sees."""
    alpha = (theta - beta) / 2
    return Cone(half_angle=float(np.pi / 2 - alpha), rim=rim), float(rim / np.tan(beta) - rim * np.tan(alpha))


KINDS = {
    "hyperbolic": Kind(hyperbolic, True, False, "a hyperboloid, the lens in its far focus"),
    "parabolic": Kind(parabolic, True, True, "a paraboloid under a telecentric lens"),
    "spherical": Kind(spherical, False, False, "a sphere, without a single viewpoint"),
    "conical": Kind(conical, False, False, "a cone, without a single viewpoint"),
}
