"""A frame with two linear scales, drawn as SVG."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.html import Markup, element, short, together

Array = NDArray[np.float64]

WIDTH, HEIGHT = 460.0, 290.0


@dataclass(frozen=True)
class Axes:
    """A frame with two linear scales.

    Attributes
    ----------
    x, y
        (low, high) of each scale, in the unit of the data.
    x_label, y_label
        What they are, with the unit.
    box
        (left, top, right, bottom) of the frame on the paper.
    x_ticks
        Where the x axis is marked, if not at round numbers, and what is written there.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    x_label: str
    y_label: str
    box: tuple[float, float, float, float] = (52.0, 12.0, WIDTH - 22, HEIGHT - 42)
    x_ticks: tuple[tuple[float, str], ...] | None = None

    def at(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Give the places (N, 2) on the paper of points; NaN stays NaN."""
        left, top, right, bottom = self.box
        across = left + (np.asarray(x, float) - self.x[0]) / (self.x[1] - self.x[0]) * (right - left)
        down = bottom - (np.asarray(y, float) - self.y[0]) / (self.y[1] - self.y[0]) * (bottom - top)
        return np.stack(np.broadcast_arrays(across, down), -1)

    def frame(self) -> Markup:
        """Draw grid, ticks and labels."""
        left, top, right, bottom = self.box
        parts = [element("rect", x=left, y=top, width=right - left, height=bottom - top, class_="frame")]
        for value, said in self.x_ticks or [(tick, _said(tick)) for tick in ticks(*self.x)]:
            at = float(self.at(value, self.y[0])[0])
            parts += [
                element("path", d=f"M{short(at)} {short(top)}V{short(bottom)}", class_="grid"),
                element("text", said, x=at, y=bottom + 16, text_anchor="middle"),
            ]
        for value in ticks(*self.y, about=5):
            at = float(self.at(self.x[0], value)[1])
            parts += [
                element("path", d=f"M{short(left)} {short(at)}H{short(right)}", class_="grid"),
                element("text", _said(value), x=left - 6, y=at + 4, text_anchor="end"),
            ]
        middle = (top + bottom) / 2
        turn = f"rotate(-90 12 {short(middle)})"
        return together(
            *parts,
            element("text", self.x_label, x=(left + right) / 2, y=bottom + 34, text_anchor="middle", class_="label"),
            element("text", self.y_label, x=12.0, y=middle + 4, text_anchor="middle", class_="label", transform=turn),
        )

    def inside(self, *content: Markup) -> Markup:
        """Clip what is drawn to the frame."""
        left, top, right, bottom = self.box
        width, height = right - left, bottom - top
        view = " ".join(map(short, (left, top, width, height)))
        return element("svg", *content, x=left, y=top, width=width, height=height, viewBox=view)

    def line(self, x: ArrayLike, y: ArrayLike, class_: str) -> Markup:
        """Draw a line; NaN interrupts it."""
        return element("path", d=path_of(self.at(x, y)), class_=f"line {class_}")

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, class_: str) -> Markup:
        """Fill what lies between two lines; NaN is passed over."""
        upper, lower = self.at(x, high), self.at(x, low)
        known = np.isfinite(upper).all(1) & np.isfinite(lower).all(1)
        return element("path", d=path_of(np.concatenate([upper[known], lower[known][::-1]])), class_=class_)

    def strip(self, low: float, high: float, class_: str) -> Markup:
        """Fill what lies between two values of x."""
        return self.band([low, high], [self.y[0]] * 2, [self.y[1]] * 2, class_)

    def dots(self, x: ArrayLike, y: ArrayLike, class_: str) -> Markup:
        """Draw a dot at every point that is not NaN."""
        return element("path", d=dots_of(self.at(x, y)), class_=f"dots {class_}")


def chart(*content: Markup, said: str, width: float = WIDTH, height: float = HEIGHT, role: str = "img") -> Markup:
    """Put drawings on a paper of their own; `said` is read out in their place, or before what is in a "group"."""
    size = f"0 0 {short(width)} {short(height)}"
    return element("svg", *content, viewBox=size, role=role, aria_label=said, class_="chart")


def path_of(places: Array) -> str:
    """Give the path through places (N, 2), interrupted by NaN."""
    parts, down = list[str](), False
    for x, y in places:
        known = bool(np.isfinite(x) and np.isfinite(y))
        if known:
            parts.append(f"{'L' if down else 'M'}{short(x)} {short(y)}")
        down = known
    return "".join(parts)


def dots_of(places: Array) -> str:
    """Give a path with a dot, a line of no length with round ends, at every place (N, 2) that is not NaN."""
    known = places[np.isfinite(places).all(1)]
    return "".join(f"M{short(x)} {short(y)}h0" for x, y in known)


def ticks(low: float, high: float, about: int = 7) -> list[float]:
    """Give about so many round numbers, at steps of 1, 2, 3 (of tens: angles), 5, from low to high."""
    rough = (high - low) / about
    unit = 10.0 ** np.floor(np.log10(rough))
    steps = [1.0, 2.0, 3.0, 5.0, 10.0] if unit >= 10 else [1.0, 2.0, 5.0, 10.0]
    step = unit * min((s for s in steps if s * unit >= rough * 0.999), default=10.0)
    first = np.ceil(low / step - 1e-9)
    return [float((first + i) * step) for i in range(int(np.floor(high / step + 1e-9) - first) + 1)]


def round_down(value: float) -> float:
    """Give the largest of 1, 2, 5, 10, 20, 50 ... and 0.5, 0.2 ... that is not above a positive value."""
    unit = 10.0 ** np.floor(np.log10(value))
    return float(max(s for s in (1.0, 2.0, 5.0) if s * unit <= value * (1 + 1e-9)) * unit)


def _said(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")
