"""Design of a mirror camera from its specification."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from omnisight.display import Displayed
from omnisight.models.pinhole import Pinhole
from omnisight.models.unified import Unified
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.design.shapes import KINDS, MirrorKind
from omnisight.optics.design.specification import FILL_FRACTION, MirrorSpecification
from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.telecentric import Telecentric

# Defaults: half angle of the lens at the rim of the mirror (a common C-mount lens), and diameter of the rim.
DEFAULT_LENS_HALF_ANGLE_RAD = np.radians(20.0)
DEFAULT_DIAMETER_M = 0.06
# Radius of the smallest hole as a share of the rim radius: at its apex, a cone has no slope.
MIN_HOLE_FRACTION = 1e-6
# A hole smaller than this angle is rounding.
MIN_HOLE_RAD = 1e-6
# Half angles of the narrowest and the widest practical lens.
MIN_LENS_HALF_ANGLE_RAD, MAX_LENS_HALF_ANGLE_RAD = np.radians(0.2), np.radians(70.0)


@dataclass(frozen=True)
class MirrorDesign(Displayed):
    """A mirror and its lens.

    Attributes
    ----------
    specification
        The requirements.
    mirror
        Shape, rim and hole, metres. The hole is the part that would show more than `down` below the horizon.
    distance
        From the lens centre (for a telecentric lens: its front) to the mirror's vertex, metres.
    focal
        Focal length of the lens, metres; None for a telecentric lens.
    magnification
        Sensor size over mirror size of a telecentric lens; None otherwise.
    circle
        Radius of the mirror's image, px.
    """

    specification: MirrorSpecification
    mirror: Conic | Cone
    distance: float
    focal: float | None
    magnification: float | None
    circle: float

    @property
    def central(self) -> bool:
        """Whether it has a single viewpoint."""
        return KINDS[self.specification.kind].central

    @property
    def centre(self) -> tuple[float, float]:
        """Pixel of the axis: the centre of the sensor."""
        width, height = self.specification.size
        return (width - 1) / 2, (height - 1) / 2

    def direction(self, rho: float) -> float:
        """Return the angle from straight down, radians, that the mirror shows at a distance from its axis (metres)."""
        # A ray that leaves the lens at beta is reflected by a surface of inclination alpha to 2 alpha + beta.
        slope = 2 * rho * float(self.mirror.profile(np.array(rho * rho))[1])
        return float(2 * np.arctan(slope) + self._lens_angle(rho))

    def image_radius(self, rho: float) -> float:
        """Return the image radius, px, of the mirror's points at a distance from its axis (metres)."""
        size = rho * self.magnification if self.magnification else np.tan(self._lens_angle(rho)) * (self.focal or 0.0)
        return float(size / self.specification.pixel)

    def _lens_angle(self, rho: float) -> float:
        """Return the angle from the axis at which the lens sees a point of the mirror; 0 for a telecentric lens."""
        return 0.0 if self.focal is None else float(np.arctan2(rho, self.distance + float(self.mirror.sag(rho))))

    def system(self, *, across: float = 0.0, along: float = 0.0, tilt: float = 0.0) -> Catadioptric:
        """Return the camera for ray tracing, optionally with a displaced (metres) or tilted (radians) mirror."""
        placed = PlacedMirror(self.mirror, tilt_y=tilt, tx=across, tz=self.distance + along)
        return Catadioptric(self._lens(), (placed,))

    def _lens(self) -> Pinhole | Telecentric:
        if self.magnification is not None:
            scale = self.magnification / self.specification.pixel
            return Telecentric(scale, scale, *self.centre)
        assert self.focal is not None
        focal = self.focal / self.specification.pixel
        return Pinhole(focal, focal, *self.centre)

    def model(self) -> Unified:
        """Return the unified model of a central design, in an unmirrored frame: x right, z down to the lens.

        This is the lens frame rotated by 180 degrees about y, with its origin at the viewpoint. fx is negative, because
        the mirror exchanges left and right.

        Raises
        ------
        ValueError
            If the design has no single viewpoint.
        """
        if not self.central or not isinstance(self.mirror, Conic):
            raise ValueError(
                f"a {self.specification.kind} mirror has no single viewpoint, which the unified model requires: use"
                " system() for ray tracing"
            )
        if self.magnification is not None:
            scale = self.magnification / self.specification.pixel
            unified = Unified.from_parabola(self.mirror.latus_rectum, scale, self.centre)
        else:
            assert self.focal is not None
            e = self.mirror.eccentricity
            unified = Unified.from_hyperbola(1.0, e, self.focal / self.specification.pixel, self.centre)
        return unified.with_params(unified.params * np.array([-1, 1, 1, 1, 1, 1]))


def design_mirror(specification: MirrorSpecification) -> MirrorDesign:
    """Compute the mirror, its lens and their distance.

    Two of focal length, diameter and distance determine the third. With fewer, the lens sees the rim at
    `DEFAULT_LENS_HALF_ANGLE_RAD` (for a cone: at the field of view), and the diameter is `DEFAULT_DIAMETER_M`. With all
    three, the image may be smaller than the sensor.

    Raises
    ------
    ValueError
        If the specification is impossible; the message has the reason and the remedy.
    """
    kind = KINDS[specification.kind]
    beta = 0.0 if kind.parallel else _lens_half_angle(specification, kind)
    _check_rim(specification, beta)
    if specification.diameter is not None:
        rim = specification.diameter / 2
    elif specification.distance is not None and not kind.parallel:
        rim = specification.distance / kind.shape(specification.theta, beta, 1.0)[1]
    else:
        rim = DEFAULT_DIAMETER_M / 2
    mirror, distance = kind.shape(specification.theta, beta, rim)
    image_radius = specification.max_image_radius * FILL_FRACTION
    if kind.parallel:
        distance = specification.distance or distance
        magnification, circle = image_radius / rim, image_radius / specification.pixel
        return _cut_hole(MirrorDesign(specification, mirror, distance, None, magnification, circle))
    focal = specification.focal or image_radius / np.tan(beta)
    circle = float(focal * np.tan(beta) / specification.pixel)
    if circle > specification.max_image_radius / specification.pixel * (1 + 1e-9):
        raise ValueError(
            f"with a focal length of {_mm(focal)} the mirror's image is {2 * circle:.0f} px wide, the sensor"
            f" {min(specification.size)} px: use {_mm(image_radius / np.tan(beta))}, a smaller mirror or a larger"
            " distance"
        )
    return _cut_hole(MirrorDesign(specification, mirror, distance, float(focal), None, circle))


def _cut_hole(design: MirrorDesign) -> MirrorDesign:
    """Return the design without the part of the mirror that shows more than `down` below the horizon."""
    lowest, rim = np.pi / 2 - design.specification.down, design.mirror.rim
    first = MIN_HOLE_FRACTION * rim
    if design.direction(first) > lowest - MIN_HOLE_RAD:
        return design
    hole = float(brentq(lambda rho: design.direction(rho) - lowest, first, rim))  # pyright: ignore[reportArgumentType]
    return replace(design, mirror=replace(design.mirror, hole=hole))


def _lens_half_angle(specification: MirrorSpecification, kind: MirrorKind) -> float:
    """Return the half angle at which the lens sees the rim."""
    if specification.diameter is not None and specification.distance is not None:
        return _half_angle_of_sizes(specification, kind, specification.diameter, specification.distance)
    if specification.focal is not None:
        return float(np.arctan(specification.max_image_radius * FILL_FRACTION / specification.focal))
    if specification.kind == "conical":
        return specification.up + specification.down
    return float(DEFAULT_LENS_HALF_ANGLE_RAD)


def _half_angle_of_sizes(
    specification: MirrorSpecification, kind: MirrorKind, diameter: float, distance: float
) -> float:
    """Return the half angle for which a mirror of a diameter has its lens at a distance; it decreases with distance."""

    def excess(beta: float) -> float:
        return kind.shape(specification.theta, beta, diameter / 2)[1] - distance

    narrowest, theta = MIN_LENS_HALF_ANGLE_RAD, specification.theta
    widest = float(min(MAX_LENS_HALF_ANGLE_RAD, theta * 0.999, (np.pi - theta) * 0.999))
    if excess(narrowest) < 0:
        raise ValueError(f"a distance of {_mm(distance)} is too large for a mirror of {_mm(diameter)}: reduce it")
    if excess(widest) > 0:
        nearest = kind.shape(theta, widest, diameter / 2)[1]
        raise ValueError(
            f"a {specification.kind} mirror of {_mm(diameter)} that shows {_degrees(specification.up)} degrees up needs"
            f" a lens distance of at least {_mm(nearest)}, got {_mm(distance)}: increase the distance or use a smaller"
            " mirror"
        )
    return float(brentq(excess, narrowest, widest, xtol=1e-14, rtol=1e-14))  # pyright: ignore[reportArgumentType]


def _check_rim(specification: MirrorSpecification, beta: float) -> None:
    """Raise if the lens cannot see the rim in the required direction."""
    state = f"the lens sees the rim at {np.degrees(beta):.1f} degrees from the axis"
    remedy = "reduce --up, or use a longer focal length"
    if specification.kind == "conical":
        state = f"the field of a cone equals the half angle of its lens, {np.degrees(beta):.1f} degrees here"
        remedy = "reduce --up or --down; 2 up + down must be less than 90"
    if 0 < beta < MIN_LENS_HALF_ANGLE_RAD:
        raise ValueError(
            f"with a focal length of {_mm(specification.focal)} the mirror fills only {_degrees(2 * beta)} degrees,"
            f" less than {_degrees(2 * MIN_LENS_HALF_ANGLE_RAD)}: use a shorter focal length"
        )
    if specification.theta + beta >= np.pi:
        raise ValueError(
            f"{state}, so no mirror shows more than {90 - np.degrees(beta):.1f} degrees up, --up is"
            f" {_degrees(specification.up)}: {remedy}"
        )
    if specification.theta <= beta:
        raise ValueError(
            f"{state} and would have to show {_degrees(specification.theta)} degrees there, which no convex mirror"
            " does: increase --up, or use a longer focal length"
        )
    field = specification.up + specification.down
    if specification.kind == "conical" and field > beta * (1 + 1e-9):
        raise ValueError(
            f"{state}, but the field is {_degrees(field)} degrees: reduce it, or leave focal length or distance out"
        )


def _mm(metres: Any) -> str:
    return f"{metres * 1e3:.4g}mm"


def _degrees(radians: float) -> str:
    return f"{np.degrees(radians):.4g}"
