"""Linear axes, paths and legends of charts, drawn as SVG."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.html import Markup, element, format_coordinate, join

Array = NDArray[np.float64]
# (left, top, right, bottom) in the drawing.
Box = tuple[float, float, float, float]

# Default size of a chart in the units of its drawing.
CHART_WIDTH, CHART_HEIGHT = 460.0, 290.0


@dataclass(frozen=True)
class Axes:
    """A frame with two linear scales.

    Attributes
    ----------
    x_range, y_range
        (low, high) of each scale, in the unit of the data.
    x_label, y_label
        Quantity and unit.
    box
        The frame in the drawing.
    x_ticks
        Position and text of the ticks of the x axis; round numbers by default.
    """

    x_range: tuple[float, float]
    y_range: tuple[float, float]
    x_label: str
    y_label: str
    box: Box = (52.0, 12.0, CHART_WIDTH - 22, CHART_HEIGHT - 42)
    x_ticks: tuple[tuple[float, str], ...] | None = None

    def positions(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the positions (N, 2) of data points in the drawing; NaN stays NaN."""
        left, top, right, bottom = self.box
        horizontal = left + (np.asarray(x, float) - self.x_range[0]) / np.ptp(self.x_range) * (right - left)
        vertical = bottom - (np.asarray(y, float) - self.y_range[0]) / np.ptp(self.y_range) * (bottom - top)
        return np.stack(np.broadcast_arrays(horizontal, vertical), -1)

    def frame(self) -> Markup:
        """Draw grid, ticks and labels."""
        left, top, right, bottom = self.box
        parts = [element("rect", x=left, y=top, width=right - left, height=bottom - top, class_="frame")]
        for value, text in self.x_ticks or [(tick, _tick_text(tick)) for tick in nice_ticks(*self.x_range)]:
            x = float(self.positions(value, self.y_range[0])[0])
            parts.append(element("path", d=path_data([(x, top), (x, bottom)]), class_="grid"))
            parts.append(element("text", text, x=x, y=bottom + 16, text_anchor="middle"))
        for value in nice_ticks(*self.y_range, count=5):
            y = float(self.positions(self.x_range[0], value)[1])
            parts.append(element("path", d=path_data([(left, y), (right, y)]), class_="grid"))
            parts.append(element("text", _tick_text(value), x=left - 6, y=y + 4, text_anchor="end"))
        x, y = (left + right) / 2, (top + bottom) / 2
        rotation = f"rotate(-90 {format_coordinate(left - 40)} {format_coordinate(y)})"
        label = {"text_anchor": "middle", "class_": "label"}
        return join(
            *parts,
            element("text", self.x_label, x=x, y=bottom + 34, **label),
            element("text", self.y_label, x=left - 40, y=y + 4, transform=rotation, **label),
        )

    def clip(self, *content: Markup) -> Markup:
        """Clip drawings to the frame."""
        return clip(self.box, *content)

    def line(self, x: ArrayLike, y: ArrayLike, class_: str) -> Markup:
        """Draw a line; NaN interrupts it."""
        return element("path", d=path_data(self.positions(x, y)), class_=f"line {class_}")

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, class_: str) -> Markup:
        """Fill the area between two lines; NaN is skipped."""
        upper, lower = self.positions(x, high), self.positions(x, low)
        finite = np.isfinite(upper).all(1) & np.isfinite(lower).all(1)
        return element("path", d=path_data(np.concatenate([upper[finite], lower[finite][::-1]])), class_=class_)

    def x_span(self, low: float, high: float, class_: str) -> Markup:
        """Fill the area between two values of x."""
        return self.band([low, high], [self.y_range[0]] * 2, [self.y_range[1]] * 2, class_)

    def dots(self, x: ArrayLike, y: ArrayLike, class_: str) -> Markup:
        """Draw a dot at every data point that is not NaN."""
        return element("path", d=dot_path_data(self.positions(x, y)), class_=f"dots {class_}")


def chart(
    *content: Markup, label: str, width: float = CHART_WIDTH, height: float = CHART_HEIGHT, role: str = "img"
) -> Markup:
    """Return an SVG drawing; screen readers read `label` instead of an "img" or before the parts of a "group"."""
    size = f"0 0 {format_coordinate(width)} {format_coordinate(height)}"
    return element("svg", *content, viewBox=size, role=role, aria_label=label, class_="chart")


def clip(box: Box, *content: Markup) -> Markup:
    """Clip drawings to a box."""
    left, top, right, bottom = box
    width, height = right - left, bottom - top
    view = " ".join(map(format_coordinate, (left, top, width, height)))
    return element("svg", *content, x=left, y=top, width=width, height=height, viewBox=view)


def legend(
    entries: Sequence[tuple[str, str]],
    position: tuple[float, float],
    step: tuple[float, float] = (0.0, 15.0),
    text_class: str | None = "on",
) -> Markup:
    """Draw legend entries (class of the line, text), `step` apart."""
    parts = list[Markup]()
    for i, (class_, text) in enumerate(entries):
        x, y = (start + i * delta for start, delta in zip(position, step, strict=True))
        parts.append(element("path", d=path_data([(x, y), (x + 22, y)]), class_=class_))
        parts.append(element("text", text, x=x + 28, y=y + 4, class_=text_class))
    return join(*parts)


def path_data(points: ArrayLike) -> str:
    """Return SVG path data of a line through points (N, 2), interrupted by NaN."""
    parts, drawing = list[str](), False
    for x, y in np.asarray(points, float):
        finite = bool(np.isfinite(x) and np.isfinite(y))
        if finite:
            parts.append(f"{'L' if drawing else 'M'}{format_coordinate(x)} {format_coordinate(y)}")
        drawing = finite
    return "".join(parts)


def dot_path_data(points: Array) -> str:
    """Return SVG path data of a dot (a line of zero length with round caps) at every finite point (N, 2)."""
    finite = points[np.isfinite(points).all(1)]
    return "".join(f"M{format_coordinate(x)} {format_coordinate(y)}h0" for x, y in finite)


def segment_path_data(starts: Array, vectors: Array) -> str:
    """Return SVG path data of line segments from points (N, 2) along vectors (N, 2)."""
    return "".join(
        f"M{format_coordinate(u)} {format_coordinate(v)}l{format_coordinate(du)} {format_coordinate(dv)}"
        for (u, v), (du, dv) in zip(starts, vectors, strict=True)
    )


def nice_ticks(low: float, high: float, count: int = 7) -> list[float]:
    """Return about `count` round numbers from low to high, with steps of 1, 2, 5 (and 30 for angles)."""
    min_step = (high - low) / count
    decade = 10.0 ** np.floor(np.log10(min_step))
    multiples = [1.0, 2.0, 3.0, 5.0, 10.0] if decade >= 10 else [1.0, 2.0, 5.0, 10.0]
    step = decade * min((m for m in multiples if m * decade >= min_step * 0.999), default=10.0)
    first = np.ceil(low / step - 1e-9)
    return [float((first + i) * step) for i in range(int(np.floor(high / step + 1e-9) - first) + 1)]


def nice_floor(value: float) -> float:
    """Return the largest of ... 0.1, 0.2, 0.5, 1, 2, 5, 10 ... that does not exceed a positive value."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(max(m for m in (1.0, 2.0, 5.0) if m * decade <= value * (1 + 1e-9)) * decade)


def _tick_text(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")
