"""A scale of colours that stays in order in gray and for every kind of eye."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnisight.report.html import Markup, element, short, together

# Stops of viridis (van der Walt and Smith 2015, public domain): dark and blue is little, bright and yellow is much.
STOPS = np.array(
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
PIECES = 32
# Values nearer to an end of the scale than this share of it are not said.
APART = 0.07


@dataclass(frozen=True)
class LogScale:
    """Colours for positive values from low to high, by their logarithm."""

    low: float
    high: float

    def share(self, value: float) -> float:
        """Give where a value lies between low (0) and high (1), held within."""
        if self.high <= self.low:
            return 0.0
        return float(np.clip(np.log(max(value, 1e-300) / self.low) / np.log(self.high / self.low), 0, 1))

    def colour(self, value: float) -> str:
        """Give the colour of a value."""
        return _colour(self.share(value))

    def bar(self, at: tuple[float, float], height: float, said: Callable[[float], str]) -> Markup:
        """Draw the scale upright, its lower left end at a place, with values beside it."""
        x, y = at
        step = height / PIECES
        pieces = [
            element("rect", x=x, y=y - (i + 1) * step, width=12, height=step + 0.5, fill=_colour((i + 0.5) / PIECES))
            for i in range(PIECES)
        ]
        marks = list[Markup]()
        for value in self._marks():
            up = y - self.share(value) * height
            marks.append(element("path", d=f"M{short(x + 12)} {short(up)}h4", class_="tick"))
            marks.append(element("text", said(value), x=x + 19, y=up + 4))
        return together(*pieces, *marks)

    def _marks(self) -> list[float]:
        """Give the ends and round values between: 1, 2, 5, or the decades alone where there are many."""
        first, last = int(np.floor(np.log10(self.low))), int(np.ceil(np.log10(self.high)))
        steps = (1.0, 2.0, 5.0) if last - first <= 3 else (1.0,)
        values = [s * 10.0**e for e in range(first, last + 1) for s in steps]
        inside = [v for v in values if APART < self.share(v) < 1 - APART]
        return [self.low, *inside, self.high]


def _colour(share: float) -> str:
    place = share * (len(STOPS) - 1)
    red, green, blue = (round(float(np.interp(place, np.arange(len(STOPS)), STOPS[:, k]))) for k in range(3))
    return f"#{red:02x}{green:02x}{blue:02x}"
