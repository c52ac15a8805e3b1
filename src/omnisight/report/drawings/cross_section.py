"""Cross sections of mirrors and rays, drawn as SVG documents."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.axes import Box, clip, path_data
from omnisight.report.html import Markup, element, format_coordinate, join

Array = NDArray[np.float64]

STYLE = """
text { font: 13px system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; fill: #18212d; }
text.small, text.tick { font-size: 11.5px; fill: #566173; }
text.title { font-size: 15px; font-weight: 600; }
text.on { paint-order: stroke; stroke: #fff; stroke-width: 4px; stroke-linejoin: round; }
text.view { fill: #c2571a; font-weight: 600; }
text.dim { fill: #566173; }
path { fill: none; }
.mirror { stroke: #18212d; stroke-width: 3; stroke-linecap: round; stroke-linejoin: round; }
.back { stroke: #93a0b3; stroke-width: 1; }
.ray { stroke: #1f5fc4; stroke-width: 1.3; stroke-linejoin: round; }
.fine { stroke: #1f5fc4; stroke-width: 0.55; opacity: 0.75; }
.virtual { stroke: #1f5fc4; stroke-width: 1; stroke-dasharray: 4 3; opacity: 0.75; }
.virtual.fine { stroke-width: 0.5; stroke-dasharray: none; opacity: 0.35; }
.caustic { stroke: #bd2a2a; stroke-width: 2.4; stroke-linejoin: round; stroke-linecap: round; }
.sagittal { stroke: #16774a; stroke-width: 2.4; stroke-linecap: round; }
.axis { stroke: #93a0b3; stroke-width: 1; stroke-dasharray: 8 3 2 3; }
.guide { stroke: #93a0b3; stroke-width: 1; stroke-dasharray: 3 3; }
.dimension { stroke: #566173; stroke-width: 1; }
.angle { stroke: #c2571a; stroke-width: 1.5; }
.field { fill: #dfe9f8; }
.blind { fill: #f6dede; }
.body { fill: #e8ecf2; stroke: #566173; stroke-width: 1.2; }
.lens { fill: #bcd5f5; stroke: #1f5fc4; stroke-width: 1.2; }
.sphere { stroke: #18212d; stroke-width: 1.6; }
.dot { fill: #c2571a; stroke: #fff; stroke-width: 1.5; }
.dot.lens-dot { fill: #1f5fc4; }
.dot.caustic-dot { fill: #bd2a2a; }
.block { fill: none; stroke: #18212d; stroke-width: 1; }
.frame { fill: none; stroke: #d8dee7; }
.grid { stroke: #d8dee7; stroke-width: 0.7; }
.line { stroke-width: 2.2; stroke-linejoin: round; }
.line.up { stroke: #1f5fc4; }
.line.around { stroke: #c2571a; }
.line.calibrated { stroke: #1f5fc4; stroke-width: 3; }
.line.extrapolated { stroke: #bd2a2a; stroke-dasharray: 5 5; }
.line.ideal { stroke: #93a0b3; stroke-width: 1; }
.line.printed { stroke: #bd2a2a; stroke-dasharray: 6 4; }
.dots { stroke: #18212d; stroke-width: 5; stroke-linecap: round; }
"""


def svg_document(*content: Markup, width: float, height: float, title: str, units_per_mm: float | None = None) -> str:
    """Return an SVG document on white; screen readers read `title`. `units_per_mm` gives it a size in millimetres."""
    size = [width, height] if units_per_mm is None else [f"{side / units_per_mm:g}mm" for side in (width, height)]
    return (
        element(
            "svg",
            element("title", title),
            element("style", Markup(STYLE)),
            element("rect", width=width, height=height, fill="#fff"),
            *content,
            xmlns="http://www.w3.org/2000/svg",
            width=size[0],
            height=size[1],
            viewBox=f"0 0 {format_coordinate(width)} {format_coordinate(height)}",
            role="img",
        )
        + "\n"
    )


@dataclass(frozen=True)
class CrossSection:
    """A plane through the axis with equal scales: x to the right, z upwards.

    Attributes
    ----------
    centre
        Point (x, z) at the centre of the box, in the unit of the data.
    scale
        Units of the drawing per unit of the data.
    box
        The area in the drawing.
    """

    centre: tuple[float, float]
    scale: float
    box: Box

    def positions(self, points: ArrayLike) -> Array:
        """Return the positions (..., 2) of points (..., 2) in the drawing."""
        left, top, right, bottom = self.box
        offset = (np.asarray(points, float) - self.centre) * (self.scale, -self.scale)
        return offset + np.array([(left + right) / 2, (top + bottom) / 2])

    def line(self, points: ArrayLike, class_: str) -> Markup:
        """Draw a line through points (N, 2); NaN interrupts it."""
        return element("path", d=path_data(self.positions(points)), class_=class_)

    def area(self, points: ArrayLike, class_: str) -> Markup:
        """Fill the polygon of points (N, 2)."""
        return element("path", d=path_data(self.positions(points)) + "Z", class_=class_)

    def dot(self, point: ArrayLike, class_: str = "", radius: float = 5.0) -> Markup:
        """Draw a dot; its radius is in the units of the drawing."""
        x, y = map(float, self.positions(point))
        return element("circle", cx=x, cy=y, r=radius, class_=f"dot {class_}")

    def text(
        self, text: str, point: ArrayLike, shift: tuple[float, float] = (0, 0), anchor: str = "start", class_: str = ""
    ) -> Markup:
        """Write text beside a point."""
        x, y = self.positions(point) + shift
        return element("text", text, x=float(x), y=float(y), text_anchor=anchor, class_=f"on {class_}")

    def mirror(self, points: ArrayLike, upwards: bool = True) -> Markup:
        """Draw a mirror through points (N, 2), hatched on its back."""
        p = self.positions(points)
        step = np.diff(p, axis=0)
        arc_length = np.concatenate([[0], np.cumsum(np.linalg.norm(step, axis=1))])
        marks = np.arange(4, arc_length[-1] - 2, 7)
        starts = np.stack([np.interp(marks, arc_length, p[:, k]) for k in range(2)], -1)
        slant = np.array([5.0, -6.0]) * (1 if upwards else -1)
        hatch = "".join(path_data(np.stack([q, q + slant])) for q in starts)
        return join(element("path", d=hatch, class_="back"), element("path", d=path_data(p), class_="mirror"))

    def camera(self, width: float, lens: float) -> Markup:
        """Draw a camera at z = 0 that looks up: a body and a lens of given widths."""
        x, y = map(float, self.positions((0, 0)))
        w, half = width * self.scale, lens * self.scale / 2
        bulge = min(max(0.35 * half, 5.0), 14.0)
        body = element("rect", x=x - w / 2, y=y, width=w, height=min(max(0.5 * w, 26.0), 70.0), rx=4, class_="body")
        left, middle, right, upper, centre, lower = map(
            format_coordinate, (x - half, x, x + half, y - 2 * bulge, y, y + 2 * bulge)
        )
        curve = f"M{left} {centre}Q{middle} {upper} {right} {centre}Q{middle} {lower} {left} {centre}Z"
        return join(body, element("path", d=curve, class_="lens"))

    def arc(self, centre: ArrayLike, radius: float, first: float, last: float, class_: str = "angle") -> Markup:
        """Draw an arc between two angles (radians from straight down towards +x) with a radius in the drawing."""
        angles = np.linspace(first, last, max(8, int(abs(last - first) * 24)))
        p = self.positions(centre) + radius * np.stack([np.sin(angles), np.cos(angles)], -1)
        return element("path", d=path_data(p), class_=class_)

    def dimension(self, ends: ArrayLike, text: str, shift: tuple[float, float], *, side: str) -> Markup:
        """Draw a dimension line between two points (2, 2), shifted in the drawing; `side` is that of its text."""
        p, q = self.positions(ends)
        a, b = p + shift, q + shift
        along = (b - a) / np.linalg.norm(b - a)
        across = np.array([-along[1], along[0]]) * 4
        tips = "".join(
            path_data(np.stack([e + 7 * s * along + across, e, e + 7 * s * along - across]))
            for e, s in ((a, 1), (b, -1))
        )
        lines = path_data(np.stack([p, a])) + path_data(np.stack([q, b]))
        x, y = (a + b) / 2
        anchor = {"left": "end", "right": "start"}.get(side, "middle")
        dx, dy = {"left": (-7, 4), "right": (7, 4), "above": (0, -6)}[side]
        return join(
            element("path", d=lines, class_="guide"),
            element("path", d=path_data(np.stack([a, b])) + tips, class_="dimension"),
            element("text", text, x=float(x + dx), y=float(y + dy), text_anchor=anchor, class_="on dim"),
        )

    def clip(self, *content: Markup) -> Markup:
        """Clip drawings to the box."""
        return clip(self.box, *content)

    def extend(self, origins: ArrayLike, directions: ArrayLike) -> Array:
        """Return points (N, 2) along rays (N, 2) that lie outside the box."""
        left, top, right, bottom = self.box
        far = np.hypot(right - left, bottom - top) / self.scale
        return np.asarray(origins, float) + far * np.asarray(directions, float)
