"""The field of view as a disc: the radius is the angle from the axis, the polar angle is the azimuth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.axes import dot_path_data, nice_ticks, path_data
from omnisight.report.html import Markup, element, format_coordinate, join

Array = NDArray[np.float64]

# Side of the drawing and its margin, in the units of the drawing.
SIDE, MARGIN = 340.0, 30.0
# Longest arc that is drawn as a straight segment, radians.
MAX_SEGMENT_RAD = np.radians(6.0)
# Azimuth at which the angles of the rings are labelled, degrees: between the axes, where there are few dots.
RING_LABEL_AZIMUTH_DEG = -68.0
# Azimuth (degrees), name and text anchor of the sides of the image.
SIDES = ((0.0, "right", "start"), (90.0, "bottom", "middle"), (180.0, "left", "end"), (270.0, "top", "middle"))


@dataclass(frozen=True)
class PolarAxes:
    """A disc of directions: azimuth 0 is right and pi/2 is down, as in the image.

    Attributes
    ----------
    max_theta
        Angle from the axis of the disc's boundary, radians.
    centre, radius
        Of the disc in the drawing.
    """

    max_theta: float
    centre: tuple[float, float] = (SIDE / 2 + 12, SIDE / 2)
    radius: float = SIDE / 2 - MARGIN

    def positions(self, theta: ArrayLike, phi: ArrayLike) -> Array:
        """Return the positions (N, 2) of directions (radians) in the drawing."""
        radius = np.asarray(theta, float) / self.max_theta * self.radius
        return np.stack([radius * np.cos(phi), radius * np.sin(phi)], -1) + self.centre

    def cell(self, theta: tuple[float, float], phi: tuple[float, float]) -> str:
        """Return SVG path data of a cell between two angles and two azimuths, radians."""
        azimuths = np.linspace(*phi, max(2, int(np.ceil((phi[1] - phi[0]) / MAX_SEGMENT_RAD)) + 1))
        outer = self.positions(min(theta[1], self.max_theta), azimuths)
        inner = self.positions(max(theta[0], 0.0), azimuths[::-1])
        return path_data(np.concatenate([outer, inner])) + "Z"

    def rings(self) -> Markup:
        """Draw circles of equal angle with labels in degrees, and the names of the sides."""
        parts = [self.circle(self.max_theta, "ring")]
        for degrees in nice_ticks(0.0, float(np.degrees(self.max_theta)), count=4)[1:]:
            theta = float(np.radians(degrees))
            x, y = self.positions(theta, np.radians(RING_LABEL_AZIMUTH_DEG))
            label = {"x": float(x), "y": float(y) + 4, "text_anchor": "middle", "class_": "on"}
            parts += [self.circle(theta, "ring"), element("text", f"{degrees:g}°", **label)]
        for degrees, name, anchor in SIDES:
            x = self.centre[0] + (self.radius + 8) * np.cos(np.radians(degrees))
            y = self.centre[1] + (self.radius + 8) * np.sin(np.radians(degrees)) + {"bottom": 10, "top": 0}.get(name, 4)
            parts.append(element("text", name, x=float(x), y=float(y), text_anchor=anchor, class_="label"))
        return join(*parts)

    def dots(self, theta: ArrayLike, phi: ArrayLike, class_: str) -> Markup:
        """Draw a dot for every direction."""
        return element("path", d=dot_path_data(self.positions(theta, phi)), class_=f"dots {class_}")

    def circle(self, theta: float, class_: str) -> Markup:
        """Draw a circle of equal angle."""
        x, y = self.centre
        radius = min(theta, self.max_theta) / self.max_theta * self.radius
        left, right, middle, r = map(format_coordinate, (x - radius, x + radius, y, radius))
        return element(
            "path", d=f"M{left} {middle}A{r} {r} 0 1 1 {right} {middle}A{r} {r} 0 1 1 {left} {middle}Z", class_=class_
        )
