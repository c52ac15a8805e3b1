"""The field of view on a disc: distance from the middle is the angle from the axis, around it runs the azimuth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.axes import dots_of, path_of, ticks
from omnisight.report.html import Markup, element, short, together

Array = NDArray[np.float64]

SIDE = 340.0
MARGIN = 30.0
# Radians of an arc that one straight piece stands for.
PIECE = np.radians(6.0)
SIDES = ((0.0, "right", "start"), (90.0, "bottom", "middle"), (180.0, "left", "end"), (270.0, "top", "middle"))


@dataclass(frozen=True)
class Polar:
    """A disc of angles: azimuth 0 is to the right and pi/2 down, as in the image.

    Attributes
    ----------
    reach
        The angle from the axis (radians) of its rim.
    centre, radius
        Where it lies on the paper.
    """

    reach: float
    centre: tuple[float, float] = (SIDE / 2 + 12, SIDE / 2)
    radius: float = SIDE / 2 - MARGIN

    def at(self, theta: ArrayLike, phi: ArrayLike) -> Array:
        """Give the places (N, 2) on the paper of directions, radians."""
        away = np.asarray(theta, float) / self.reach * self.radius
        x, y = away * np.cos(phi), away * np.sin(phi)
        return np.stack([x, y], -1) + self.centre

    def cell(self, theta: tuple[float, float], phi: tuple[float, float]) -> str:
        """Give the path around a piece between two angles and two azimuths, radians."""
        around = np.linspace(*phi, max(2, int(np.ceil((phi[1] - phi[0]) / PIECE)) + 1))
        outer = self.at(min(theta[1], self.reach), around)
        inner = self.at(max(theta[0], 0.0), around[::-1])
        return path_of(np.concatenate([outer, inner])) + "Z"

    def outside(self, theta: float) -> str:
        """Give the path (to be filled even-odd) around all beyond an angle, radians."""
        return self._circle(self.reach) + self._circle(theta)

    def rings(self) -> Markup:
        """Draw circles of equal angle with their degrees, and the names of the sides."""
        parts = list[Markup]()
        degrees = ticks(0.0, float(np.degrees(self.reach)), about=4)[1:]
        for degree in degrees:
            theta = np.radians(degree)
            x, y = self.at(theta, np.radians(-68.0))
            parts += [
                element("path", d=self._circle(float(theta)), class_="ring"),
                element("text", f"{degree:g}°", x=float(x), y=float(y) + 4, text_anchor="middle", class_="on"),
            ]
        rim = self.radius + 8
        for degree, name, anchor in SIDES:
            x = self.centre[0] + rim * np.cos(np.radians(degree))
            y = self.centre[1] + rim * np.sin(np.radians(degree)) + {"bottom": 10, "top": 0}.get(name, 4)
            parts.append(element("text", name, x=float(x), y=float(y), text_anchor=anchor, class_="label"))
        return together(element("path", d=self._circle(self.reach), class_="ring"), *parts)

    def dots(self, theta: ArrayLike, phi: ArrayLike, class_: str) -> Markup:
        """Draw a dot for every direction."""
        return element("path", d=dots_of(self.at(theta, phi)), class_=f"dots {class_}")

    def circle(self, theta: float, class_: str) -> Markup:
        """Draw a circle of equal angle."""
        return element("path", d=self._circle(theta), class_=class_)

    def _circle(self, theta: float) -> str:
        x, y = self.centre
        r = short(min(theta, self.reach) / self.reach * self.radius)
        left, right = short(x - float(r)), short(x + float(r))
        return f"M{left} {short(y)}A{r} {r} 0 1 1 {right} {short(y)}A{r} {r} 0 1 1 {left} {short(y)}Z"
