"""Cross sections of mirrors and rays, drawn as SVG."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.axes import path_of
from omnisight.report.html import Markup, element, short, together

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
.frame { fill: none; stroke: #d8dee7; }
.grid { stroke: #d8dee7; stroke-width: 0.7; }
.line { stroke-width: 2.2; stroke-linejoin: round; }
.line.up { stroke: #1f5fc4; }
.line.around { stroke: #c2571a; }
.line.printed { stroke: #bd2a2a; stroke-dasharray: 6 4; }
.dots { stroke: #18212d; stroke-width: 5; stroke-linecap: round; }
"""


def paper(*content: Markup, width: float, height: float, said: str) -> str:
    """Give the text of an SVG file with drawings on white; `said` is read out in its place."""
    return (
        element(
            "svg",
            element("title", said),
            element("style", Markup(STYLE)),
            element("rect", width=width, height=height, fill="#fff"),
            *content,
            xmlns="http://www.w3.org/2000/svg",
            width=width,
            height=height,
            viewBox=f"0 0 {short(width)} {short(height)}",
            role="img",
        )
        + "\n"
    )


@dataclass(frozen=True)
class Section:
    """A plane through the axis: x to the right, z upwards, as long in both.

    Attributes
    ----------
    middle
        The point (x, z) in the middle of the box, in the unit of the data.
    scale
        px of the paper per that unit.
    box
        (left, top, right, bottom) on the paper.
    """

    middle: tuple[float, float]
    scale: float
    box: tuple[float, float, float, float]

    def at(self, points: ArrayLike) -> Array:
        """Give the places (..., 2) on the paper of points (..., 2)."""
        left, top, right, bottom = self.box
        away = (np.asarray(points, float) - self.middle) * (self.scale, -self.scale)
        return away + np.array([(left + right) / 2, (top + bottom) / 2])

    def line(self, points: ArrayLike, class_: str, **more: str) -> Markup:
        """Draw a line through points (N, 2); NaN interrupts it."""
        return element("path", d=path_of(self.at(points)), class_=class_, **more)

    def area(self, points: ArrayLike, class_: str) -> Markup:
        """Fill what is within points (N, 2)."""
        return element("path", d=path_of(self.at(points)) + "Z", class_=class_)

    def dot(self, point: ArrayLike, class_: str = "", radius: float = 5.0) -> Markup:
        """Draw a dot."""
        x, y = map(float, self.at(point))
        return element("circle", cx=x, cy=y, r=radius, class_=f"dot {class_}")

    def text(
        self, words: str, point: ArrayLike, shift: tuple[float, float] = (0, 0), anchor: str = "start", class_: str = ""
    ) -> Markup:
        """Write words beside a point."""
        x, y = self.at(point) + shift
        return element("text", words, x=float(x), y=float(y), text_anchor=anchor, class_=f"on {class_}")

    def mirror(self, points: ArrayLike, upwards: bool = True) -> Markup:
        """Draw a mirror through points (N, 2), hatched behind."""
        p = self.at(points)
        step = np.diff(p, axis=0)
        run = np.concatenate([[0], np.cumsum(np.linalg.norm(step, axis=1))])
        marks = np.arange(4, run[-1] - 2, 7)
        at = np.stack([np.interp(marks, run, p[:, k]) for k in range(2)], -1)
        slant = np.array([5.0, -6.0]) * (1 if upwards else -1)
        hatch = "".join(path_of(np.stack([q, q + slant])) for q in at)
        return together(element("path", d=hatch, class_="back"), element("path", d=path_of(p), class_="mirror"))

    def camera(self, width: float, lens: float) -> Markup:
        """Draw a camera that looks up from z = 0: its body of that width, and the lens in it."""
        x, y = map(float, self.at((0, 0)))
        w, half = width * self.scale, lens * self.scale / 2
        bulge = min(max(0.35 * half, 5.0), 14.0)
        body = element("rect", x=x - w / 2, y=y, width=w, height=min(max(0.5 * w, 26.0), 70.0), rx=4, class_="body")
        curve = f"M{short(x - half)} {short(y)}Q{short(x)} {short(y - 2 * bulge)} {short(x + half)} {short(y)}"
        curve += f"Q{short(x)} {short(y + 2 * bulge)} {short(x - half)} {short(y)}Z"
        return together(body, element("path", d=curve, class_="lens"))

    def arc(self, centre: ArrayLike, radius: float, first: float, last: float, class_: str = "angle") -> Markup:
        """Draw an arc between two angles (radians from straight down towards +x), its radius on the paper."""
        turn = np.linspace(first, last, max(8, int(abs(last - first) * 24)))
        p = self.at(centre) + radius * np.stack([np.sin(turn), np.cos(turn)], -1)
        return element("path", d=path_of(p), class_=class_)

    def dimension(self, ends: ArrayLike, words: str, shift: tuple[float, float], *, beside: str = "") -> Markup:
        """Draw a length between two points (2, 2), moved aside on the paper, with words at its middle."""
        p, q = self.at(ends)
        a, b = p + shift, q + shift
        along = (b - a) / np.linalg.norm(b - a)
        across = np.array([-along[1], along[0]]) * 4
        tips = "".join(
            path_of(np.stack([e + 7 * s * along + across, e, e + 7 * s * along - across])) for e, s in ((a, 1), (b, -1))
        )
        lines = path_of(np.stack([p, a])) + path_of(np.stack([q, b]))
        x, y = (a + b) / 2
        anchor = {"left": "end", "right": "start"}.get(beside, "middle")
        dx, dy = {"left": (-7, 4), "right": (7, 4), "above": (0, -6)}.get(beside, (0, 16))
        return together(
            element("path", d=lines, class_="guide"),
            element("path", d=path_of(np.stack([a, b])) + tips, class_="dimension"),
            element("text", words, x=float(x + dx), y=float(y + dy), text_anchor=anchor, class_="on dim"),
        )

    def inside(self, *content: Markup) -> Markup:
        """Clip what is drawn to the box."""
        left, top, right, bottom = self.box
        width, height = right - left, bottom - top
        view = " ".join(map(short, (left, top, width, height)))
        return element("svg", *content, x=left, y=top, width=width, height=height, viewBox=view)

    def reach(self, origins: ArrayLike, directions: ArrayLike) -> Array:
        """Give points (N, 2) so far along rays (N, 2) that they lie outside of the box."""
        left, top, right, bottom = self.box
        far = np.hypot(right - left, bottom - top) / self.scale
        return np.asarray(origins, float) + far * np.asarray(directions, float)


def legend(entries: Sequence[tuple[str, str]], at: tuple[float, float]) -> Markup:
    """Name lines: (class, words), one below the other."""
    x, y = at
    return together(
        *(
            together(
                element("path", d=f"M{short(x)} {short(y + 19 * i - 4)}h24", class_=class_),
                element("text", words, x=x + 32, y=y + 19 * i, class_="on"),
            )
            for i, (class_, words) in enumerate(entries)
        )
    )
