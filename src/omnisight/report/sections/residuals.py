"""What is left between the corners and the model, against angle, azimuth and place: structure is the model's error."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.report.axes import WIDTH, Axes, chart, round_down
from omnisight.report.html import Markup, element, short, together
from omnisight.report.report_data import Figure, Material

Array = NDArray[np.float64]

RINGS, SECTORS = 14, 16
# Where corners begin farther from the axis than this, degrees, the frame does so too.
INNER = 10.0
# Corners that a mean is taken of.
ENOUGH = 6
# Half the height of the frames in standard deviations, and how many standard errors the bars of a mean reach.
SIGMAS, ERRORS = 4.0, 2.0
# At most so many corners are drawn as dots; means are of all.
MOST = 3000
HEIGHT = 230.0
# Cells of the image along its width, and how long the mean arrow is drawn, cells.
CELLS, LONG = 16, 0.7
SIDES = ((0.0, "right"), (90.0, "bottom"), (180.0, "left"), (270.0, "top"), (360.0, "right"))


@dataclass(frozen=True)
class Against:
    """What residuals are drawn against.

    Attributes
    ----------
    label
        What it is.
    values
        (N,) of every corner, degrees.
    edges
        Of the parts over which means are taken, degrees.
    ticks
        As in `Axes`.
    """

    label: str
    values: Array
    edges: Array
    ticks: tuple[tuple[float, str], ...] | None = None

    def means(self, residuals: Array, usable: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """Give the middle (degrees), mean and standard error (px) of each part that has corners enough."""
        part = np.searchsorted(self.edges, self.values[usable], side="right") - 1
        part = np.clip(part, 0, len(self.edges) - 2)
        given = [(self.values[usable][part == k], residuals[usable][part == k]) for k in range(len(self.edges) - 1)]
        found = [(x.mean(), r.mean(), r.std(ddof=1) / np.sqrt(len(r))) for x, r in given if len(r) >= ENOUGH]
        middle, mean, error = np.array(found).reshape(-1, 3).T
        return middle, mean, error


def residuals(m: Material) -> Figure:
    """Draw residuals along and across the radius, and their mean all over the image."""
    along, across = m.along_and_across
    degrees = np.degrees(m.theta)
    rings = np.quantile(degrees[m.usable], np.linspace(0, 1, RINGS + 1))
    by_angle = Against("angle from the axis, degrees", degrees, rings)
    by_azimuth = Against("side of the image", np.degrees(m.phi) % 360, np.linspace(0, 360, SECTORS + 1), SIDES)
    panels = [
        _panel(m, against, value, label)
        for value, label in ((along, "along the radius, px"), (across, "across the radius, px"))
        for against in (by_angle, by_azimuth)
    ]
    arrows, times = _arrows(m)
    largest = max(float(np.abs(by_angle.means(value, m.usable)[1]).max(initial=0.0)) for value in (along, across))
    return Figure(
        "residuals",
        "What the model leaves",
        together(
            element("div", *panels, class_="pair"),
            element("div", arrows, class_="alone"),
            element(
                "p",
                f"Mean residuals of parts of the image, {times:g} times as long as they are.",
                class_="note middle",
            ),
        ),
        (
            "Dots are residuals: where the camera puts a corner minus where it was seen, split into the part along the "
            "radius (up is outwards) and the part across it. The line is their mean, its bars two standard errors. "
            "Below is the mean residual of each part of the image as an arrow.",
            "Means that stay on zero and arrows in all directions; then only noise is left. "
            f"Here the largest mean of a ring is {largest:.3f} px, beside a spread of {m.sigma:.2f} px.",
            "A wave along the angle, or arrows that turn together, is what the model cannot follow: "
            f"{_instead(m)}. A wave around the image hints at a tilted lens, or at a board"
            " that is not as flat or as regular as it is taken for.",
        ),
        "Residuals",
        wide=True,
    )


def _instead(m: Material) -> str:
    """Say what to do about a model that cannot follow its lens."""
    if isinstance(m.camera, Camera) and m.camera.model.name != "spline":
        return "try --model spline, and see the comparison of the models"
    return "see how large it is beside the spread of the dots, which is what it costs"


def _panel(m: Material, against: Against, residuals: Array, label: str) -> Markup:
    box = (52.0, 12.0, WIDTH - 22, HEIGHT - 42)
    height = SIGMAS * m.sigma
    low, high = float(against.edges[0]), float(against.edges[-1])
    span = (low, high) if against.ticks else (low if low > INNER else 0.0, high * 1.02)
    axes = Axes(span, (-height, height), against.label, label, box, against.ticks)
    middle, mean, error = against.means(residuals, m.usable)
    rows = np.flatnonzero(m.usable)
    rows = rows[:: max(1, int(np.ceil(len(rows) / MOST)))]
    bars = [
        axes.line([x, x], [y - ERRORS * e, y + ERRORS * e], "error")
        for x, y, e in zip(middle, mean, error, strict=True)
    ]
    return chart(
        axes.frame(),
        axes.inside(
            axes.dots(against.values[rows], residuals[rows], "residual-dot"),
            axes.line(span, (0.0, 0.0), "zero"),
            *bars,
            axes.line(middle, mean, "mean"),
            axes.dots(middle, mean, "mean-dot"),
        ),
        said=f"Residuals {label}, against {against.label}; the largest mean is {np.abs(mean).max(initial=0):.3f} px.",
        height=HEIGHT,
    )


def _arrows(m: Material) -> tuple[Markup, float]:
    """Draw the mean residual in each cell of the image, and say how many times longer than it is."""
    width, height = m.camera.size
    step = width / CELLS
    pixels, left = m.calibration.views.pixels[m.usable], m.residuals[m.usable]
    cells = np.floor((pixels + 0.5) / step).astype(int)
    places, means = list[Array](), list[Array]()
    for cell in np.unique(cells, axis=0):
        own = (cells == cell).all(1)
        if own.sum() >= ENOUGH:
            places.append(pixels[own].mean(0))
            means.append(left[own].mean(0))
    at, mean = np.array(places).reshape(-1, 2), np.array(means).reshape(-1, 2)
    typical = float(np.sqrt((mean**2).sum(1).mean())) if len(mean) else 1.0
    times = max(1.0, round_down(LONG * step / max(typical, 1e-9)))
    lines = "".join(
        f"M{short(u)} {short(v)}l{short(a)} {short(b)}" for (u, v), (a, b) in zip(at, mean * times, strict=True)
    )
    heads = "".join(_head(p, d, step / 6) for p, d in zip(at, mean * times, strict=True))
    drawing = element(
        "svg",
        element("rect", x=-0.5, y=-0.5, width=width, height=height, class_="paper"),
        element("use", href="#beyond"),
        element("path", d=lines, class_="arrow"),
        element("path", d=heads, class_="head"),
        viewBox=f"-0.5 -0.5 {width} {height}",
        role="img",
        aria_label=f"Mean residuals over the image, {times:g} times as long as they are",
        class_="image arrows",
    )
    return drawing, times


def _head(at: Array, drawn: Array, size: float) -> str:
    """Give the path of an arrow's head."""
    length = float(np.linalg.norm(drawn))
    if length == 0:
        return ""
    along = drawn / length * min(size, length)
    across = np.array([-along[1], along[0]]) * 0.45
    (x, y), (a, b), (c, d) = at + drawn, at + drawn - along + across, at + drawn - along - across
    return f"M{short(x)} {short(y)}L{short(a)} {short(b)}L{short(c)} {short(d)}Z"
