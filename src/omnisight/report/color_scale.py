"""A logarithmic color scale that is ordered in grayscale and for all kinds of color vision."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.axes import path_data
from omnisight.report.html import Markup, element, join

# Viridis (van der Walt and Smith 2015, public domain): dark blue is low, bright yellow is high.
VIRIDIS = np.array(
    [
        [68, 1, 84],
        [71, 45, 123],
        [59, 82, 139],
        [44, 114, 142],
        [33, 145, 140],
        [40, 174, 128],
        [94, 201, 98],
        [173, 220, 48],
        [253, 231, 37],
    ],
    float,
)
# Uniformly colored rectangles of a color bar.
BAR_STEPS = 32
# Ticks nearer to an end of the bar than this fraction are skipped, because their labels would overlap.
MIN_TICK_GAP = 0.07


@dataclass(frozen=True)
class LogColorScale:
    """Colors of positive values from low to high, by their logarithm."""

    low: float
    high: float

    def fraction(self, value: float) -> float:
        """Return the position of a value between low (0) and high (1), clipped."""
        if self.high <= self.low:
            return 0.0
        return float(np.clip(np.log(max(value, 1e-300) / self.low) / np.log(self.high / self.low), 0, 1))

    def color(self, value: float) -> str:
        """Return the color of a value as #rrggbb."""
        return _color(self.fraction(value))

    def bar(self, position: tuple[float, float], height: float, format_value: Callable[[float], str]) -> Markup:
        """Draw a vertical color bar with its lower left corner at `position`."""
        x, y = position
        step = height / BAR_STEPS
        parts = [
            element("rect", x=x, y=y - (i + 1) * step, width=12, height=step + 0.5, fill=_color((i + 0.5) / BAR_STEPS))
            for i in range(BAR_STEPS)
        ]
        for value in self._ticks():
            tick = y - self.fraction(value) * height
            parts.append(element("path", d=path_data([(x + 12, tick), (x + 16, tick)]), class_="tick"))
            parts.append(element("text", format_value(value), x=x + 19, y=tick + 4))
        return join(*parts)

    def _ticks(self) -> list[float]:
        """Return both ends and round values between them: 1, 2, 5, or decades only over more than 3 decades."""
        first, last = int(np.floor(np.log10(self.low))), int(np.ceil(np.log10(self.high)))
        multiples = (1.0, 2.0, 5.0) if last - first <= 3 else (1.0,)
        values = [m * 10.0**exponent for exponent in range(first, last + 1) for m in multiples]
        inside = [value for value in values if MIN_TICK_GAP < self.fraction(value) < 1 - MIN_TICK_GAP]
        return [self.low, *inside, self.high]


def viridis(fractions: ArrayLike) -> NDArray[np.uint8]:
    """Return the RGB colors (..., 3) of fractions (...) from 0, dark blue, to 1, yellow; NaN counts as 0."""
    position = np.clip(np.nan_to_num(np.asarray(fractions, float)), 0, 1) * (len(VIRIDIS) - 1)
    channels = [np.interp(position, np.arange(len(VIRIDIS)), VIRIDIS[:, k]) for k in range(3)]
    return np.rint(np.stack(channels, -1)).astype(np.uint8)


def _color(fraction: float) -> str:
    red, green, blue = viridis(fraction).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"
