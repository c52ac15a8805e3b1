"""The unified model of central catadioptric cameras."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np

from omnisight.models._elementwise import sqrt
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array

# The focus of a conic mirror that holds the lens, by its distance from the vertex.
LensFocus = Literal["far", "near"]

# Standard deviation of the prior on xi: mirrors have at most 1 and lenses up to about 4; beyond, the projection is
# almost orthographic and images hardly determine xi.
XI_PRIOR_SIGMA = 10.0


class UnifiedProfile(ProfileCamera):
    """r = sin(theta) / (cos(theta) + xi)."""

    INITIAL_SHAPES: ClassVar = ({"xi": 0.0}, {"xi": 0.5}, {"xi": 1.0}, {"xi": 1.8})
    xi: float

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        return 1.0 / (c + m.xi)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        h = (m.xi + sqrt(1.0 + (1.0 - m.xi * m.xi) * r2)) / (1.0 + r2)
        return h, h - m.xi

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        return -g * g, {"xi": -g * g}

    @property
    def theta_max(self) -> float:
        return float(np.arccos(-self.xi if self.xi <= 1 else -1 / self.xi)) * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        return np.inf if self.xi <= 1 else (self.xi**2 - 1) ** -0.5


@dataclass(frozen=True)
class Unified(UnifiedProfile):
    """Geyer and Daniilidis' unified model: the unit sphere, seen from a point xi behind its centre.

    m = (x, y)/(z + xi |X|),  pixel = K m

    Back, with r = |m|:  z_s = (xi + sqrt(1 + (1 - xi^2) r^2))/(1 + r^2) - xi.

    xi = 0 is a pinhole, 1 a parabolic mirror, between them hyperbolic and elliptical mirrors with the lens in the far
    focus; -1 < xi < 0 are concave mirrors with the lens in the near focus. xi > 1 and xi < 0 also describe lenses.
    Valid where z_s > -xi, and for xi > 1 where z_s > -1/xi and r^2 <= 1/(xi^2 - 1). Geyer and
    Daniilidis, A unifying theory for central panoramic systems, ECCV 2000. The chapter names xi epsilon. A mirror
    flips handedness: the camera's frame looks into the mirror, so the image is the world's mirror image only if
    fx and fy differ in sign.
    """

    in_initial_search: ClassVar[bool] = True

    fx: float = parameter("focal length along x (gamma)", unit="px")
    fy: float = parameter("focal length along y (gamma)", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    xi: float = parameter(
        "distance of the second viewpoint from the sphere's centre", low=-0.999, prior_sigma=XI_PRIOR_SIGMA
    )
    skew: float = parameter("skew of the pixel axes", unit="px", default=0.0, free=False)

    @classmethod
    def example(cls) -> Self:
        return cls(fx=255.0, fy=254.0, cx=512.3, cy=383.1, xi=0.93, skew=0.2)

    @classmethod
    def from_parabola(cls, latus_rectum: float, scale: float, centre: tuple[float, float]) -> Self:
        """Create the camera of a parabolic mirror under an orthographic camera.

        Parameters
        ----------
        latus_rectum
            4 p of the parabola z = (x^2 + y^2)/(4 p) - p, any length.
        scale
            Pixels per that length.
        centre
            Principal point, px.
        """
        positive(latus_rectum=latus_rectum, scale=scale)
        # A ray at theta leaves the mirror at the radius 2 p sin(theta)/(1 + cos(theta)).
        gamma = 0.5 * latus_rectum * scale
        return cls(fx=gamma, fy=gamma, cx=centre[0], cy=centre[1], xi=1.0)

    @classmethod
    def from_hyperbola(
        cls, a: float, c: float, focal: float, centre: tuple[float, float], lens_focus: LensFocus = "far"
    ) -> Self:
        """Create the camera of a hyperbolic mirror seen by a pinhole in one of its foci.

        Parameters
        ----------
        a, c
            Semi-major axis and half the distance between the foci, c > a, in the same length.
        focal
            Focal length of the pinhole, px.
        centre
            Principal point, px.
        lens_focus
            The focus of the pinhole: "far" from the vertex, a + c, for a convex mirror; "near" it, c - a, for a concave
            one.

        Raises
        ------
        ValueError
            If a length is not positive or c <= a.

        Notes
        -----
        xi = 2 e/(1 + e^2) with e = c/a, negative for the near focus: Table 1 of the chapter with L = 2 b^2/a the latus
        rectum and epsilon = d/sqrt(d^2 + L^2/4); as printed it would hold only for a quarter of the latus rectum.
        """
        positive(a=a, c=c, focal=focal)
        if c <= a:
            raise ValueError(f"a hyperbola has c > a, got a = {a}, c = {c}")
        return cls._from_conic(c / a, focal, centre, lens_focus)

    @classmethod
    def from_ellipse(
        cls, a: float, c: float, focal: float, centre: tuple[float, float], lens_focus: LensFocus = "far"
    ) -> Self:
        """Create the camera of an elliptical (concave) mirror seen by a pinhole in one of its foci.

        The mirror also turns its image by 180 degrees about the axis: negate fx and fy to include it.

        Parameters
        ----------
        a, c
            Semi-major axis and half the distance between the foci, c < a, in the same length.
        focal
            Focal length of the pinhole, px.
        centre
            Principal point, px.
        lens_focus
            The focus of the pinhole: "far" from the vertex, a + c, or "near" it, a - c. The near focus gives xi < 0.

        Raises
        ------
        ValueError
            If a length is not positive or c >= a.
        """
        positive(a=a, c=c, focal=focal)
        if c >= a:
            raise ValueError(f"an ellipse has c < a, got a = {a}, c = {c}")
        return cls._from_conic(c / a, focal, centre, lens_focus)

    @classmethod
    def _from_conic(cls, e: float, focal: float, centre: tuple[float, float], lens_focus: LensFocus) -> Self:
        # A ray through the viewpoint at theta has the direction (1 - e^2) sin : 2 e + (1 + e^2) cos at a pinhole in the
        # far focus. Exchanging the foci reverses the axis, which negates e.
        if lens_focus not in ("far", "near"):
            raise ValueError(f"lens_focus must be 'far' or 'near', got {lens_focus!r}")
        gamma = focal * abs(1 - e * e) / (1 + e * e)
        xi = 2 * e / (1 + e * e)
        return cls(fx=gamma, fy=gamma, cx=centre[0], cy=centre[1], xi=xi if lens_focus == "far" else -xi)


def positive(**lengths: float) -> None:
    """Raise ValueError for a length that is not positive."""
    for name, value in lengths.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive, got {value}")
