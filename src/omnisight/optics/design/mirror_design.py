"""Makes a mirror camera to order."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from omnisight.models.pinhole import Pinhole
from omnisight.models.unified import Unified
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.design.shapes import KINDS, Kind
from omnisight.optics.design.specification import FILL, MirrorSpecification
from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.telecentric import Telecentric

# Taken where the order leaves it open: the half angle under which the lens sees the rim, and the rim's diameter.
BETA = np.radians(20.0)
DIAMETER = 0.06
# The narrowest and the widest lens that is thought of, half angles.
NARROW, WIDE = np.radians(0.2), np.radians(70.0)


@dataclass(frozen=True)
class MirrorDesign:
    """A mirror and its lens.

    Attributes
    ----------
    order
        What was asked for.
    mirror
        In metres, its rim included.
    distance
        From the lens' centre (of a telecentric lens: its front) to the mirror's vertex, metres.
    focal
        Of the lens, metres; None of a telecentric one.
    magnification
        Of a telecentric lens, sensor over mirror; None of another.
    circle
        Radius of the mirror's image, px.
    """

    order: MirrorSpecification
    mirror: Conic | Cone
    distance: float
    focal: float | None
    magnification: float | None
    circle: float

    @property
    def central(self) -> bool:
        """Whether it has a single viewpoint."""
        return KINDS[self.order.kind].central

    @property
    def centre(self) -> tuple[float, float]:
        """The pixel of the axis: the middle of the sensor."""
        width, height = self.order.size
        return (width - 1) / 2, (height - 1) / 2

    def system(self, *, across: float = 0.0, along: float = 0.0, tilt: float = 0.0) -> Catadioptric:
        """Give the camera to trace; its mirror may be moved (metres), or tilted about its vertex (radians)."""
        placed = PlacedMirror(self.mirror, tilt_y=tilt, tx=across, tz=self.distance + along)
        return Catadioptric(self._lens(), (placed,))

    def _lens(self) -> Pinhole | Telecentric:
        if self.magnification is not None:
            scale = self.magnification / self.order.pixel
            return Telecentric(scale, scale, *self.centre)
        assert self.focal is not None
        focal = self.focal / self.order.pixel
        return Pinhole(focal, focal, *self.centre)

    def model(self) -> Unified:
        """Give the unified model of a central design, in a frame that does not flip: x right, z down to the lens.

        That is the lens' frame turned by 180 degrees about y, its origin in the viewpoint: fx is negative, as a mirror
        exchanges left and right.

        Raises
        ------
        ValueError
            If the design has no single viewpoint.
        """
        if not self.central or not isinstance(self.mirror, Conic):
            raise ValueError(
                f"a {self.order.kind} mirror has no single viewpoint, and the unified model is of such that have one:"
                " trace its system()"
            )
        if self.magnification is not None:
            scale = self.magnification / self.order.pixel
            found = Unified.from_parabola(self.mirror.latus_rectum, scale, self.centre)
        else:
            assert self.focal is not None
            e = self.mirror.eccentricity
            found = Unified.from_hyperbola(1.0, e, self.focal / self.order.pixel, self.centre)
        return found.with_params(found.params * np.array([-1, 1, 1, 1, 1, 1]))


def design_mirror(order: MirrorSpecification) -> MirrorDesign:
    """Find the mirror, its lens and their distance.

    What the order leaves open of focal length, diameter and distance follows from the rest: two of them settle the
    third. With fewer, the lens sees the rim under `BETA` (a cone: under the field asked for), and the rim is `DIAMETER`
    wide. With all three the sensor is filled as far as they go.

    Raises
    ------
    ValueError
        If it cannot be, with the reason and what to change.
    """
    kind = KINDS[order.kind]
    beta = 0.0 if kind.parallel else _half_angle(order, kind)
    _must_show(order, beta)
    if order.diameter is not None:
        rim = order.diameter / 2
    elif order.distance is not None and not kind.parallel:
        rim = order.distance / kind.shape(order.theta, beta, 1.0)[1]
    else:
        rim = DIAMETER / 2
    mirror, distance = kind.shape(order.theta, beta, rim)
    if kind.parallel:
        size = order.half * FILL
        distance = order.distance or distance
        return MirrorDesign(order, mirror, distance, None, size / rim, size / order.pixel)
    focal = order.focal or order.half * FILL / np.tan(beta)
    circle = float(focal * np.tan(beta) / order.pixel)
    if circle > order.half / order.pixel * (1 + 1e-9):
        raise ValueError(
            f"with a focal length of {_mm(focal)} the mirror's image is {2 * circle:.0f} px wide, the sensor"
            f" {min(order.size)}: take {_mm(order.half * FILL / np.tan(beta))}, a smaller mirror, or more distance"
        )
    return MirrorDesign(order, mirror, distance, float(focal), None, circle)


def _half_angle(order: MirrorSpecification, kind: Kind) -> float:
    """Give the half angle under which the lens sees the rim."""
    if order.diameter is not None and order.distance is not None:
        return _angle_of_sizes(order, kind, order.diameter, order.distance)
    if order.focal is not None:
        return float(np.arctan(order.half * FILL / order.focal))
    return order.up + order.down if order.kind == "conical" else float(BETA)


def _angle_of_sizes(order: MirrorSpecification, kind: Kind, diameter: float, distance: float) -> float:
    """Find the half angle at which a mirror so wide has its lens so far away: the narrower, the farther."""

    def excess(beta: float) -> float:
        return kind.shape(order.theta, beta, diameter / 2)[1] - distance

    widest = float(min(WIDE, order.theta * 0.999, (np.pi - order.theta) * 0.999))
    if excess(NARROW) < 0:
        raise ValueError(f"a distance of {_mm(distance)} is too far for a mirror of {_mm(diameter)}")
    if excess(widest) > 0:
        nearest = kind.shape(order.theta, widest, diameter / 2)[1]
        raise ValueError(
            f"a {order.kind} mirror of {_mm(diameter)} that shows {_degrees(order.up)} degrees up needs a lens"
            f" {_mm(nearest)} away or farther, got {_mm(distance)}: give more distance or a smaller mirror"
        )
    return float(brentq(excess, NARROW, widest, xtol=1e-14, rtol=1e-14))  # pyright: ignore[reportArgumentType]


def _must_show(order: MirrorSpecification, beta: float) -> None:
    """Refuse a rim that the lens could not see, or would see the wrong way round."""
    said = f"the lens sees the rim at {np.degrees(beta):.1f} degrees from the axis"
    mend = "ask for less up, or for a longer lens"
    if order.kind == "conical":
        said = f"a cone shows as many degrees of elevation as half its lens, {np.degrees(beta):.1f} here"
        mend = "ask for less up or down; twice up and once down make less than 90"
    if 0 < beta < NARROW:
        raise ValueError(
            f"with a focal length of {_mm(order.focal)} the lens sees the mirror within {_degrees(2 * beta)} degrees,"
            f" less than the {_degrees(2 * NARROW)} that are thought of: choose a shorter one"
        )
    if order.theta + beta >= np.pi:
        most = 90 - np.degrees(beta)
        raise ValueError(
            f"{said}, and no mirror shows more than {most:.1f} degrees up to it, --up is {_degrees(order.up)}: {mend}"
        )
    if order.theta <= beta:
        raise ValueError(
            f"{said}, and is to show {_degrees(order.theta)} degrees there: that takes no convex mirror, but a lens"
        )
    if order.kind == "conical" and order.up + order.down > beta * (1 + 1e-9):
        raise ValueError(
            f"{said}, and {_degrees(order.up + order.down)} are asked for: ask for less, or leave focal length or"
            " distance open"
        )


def _mm(metres: Any) -> str:
    return f"{metres * 1e3:.4g}mm"


def _degrees(radians: float) -> str:
    return f"{np.degrees(radians):.4g}"
