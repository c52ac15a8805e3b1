"""Where in the field of view corners were seen."""

import numpy as np

from omnisight.quality.coverage import ENOUGH, SECTORS, SIDES
from omnisight.report.axes import chart
from omnisight.report.html import element
from omnisight.report.report_data import Figure, Material
from omnisight.report.polar_axes import SIDE, Polar


def coverage(m: Material) -> Figure:
    """Draw it on a disc of angles."""
    seen = m.calibration.trust.coverage
    disc = Polar(float(seen.edges[-1]))
    cells = [
        element(
            "path",
            element("title", _said(low, high, SIDES[k] if i else "all around", int(seen.corners[i, k]))),
            d=disc.cell((low, high), ((k - 0.5) * 2 * np.pi / SECTORS, (k + 0.5) * 2 * np.pi / SECTORS)),
            class_="seen" if seen.covered[i, k] else "missing",
        )
        for i, (low, high) in enumerate(zip(seen.edges[:-1], seen.edges[1:], strict=True))
        for k in range(SECTORS)
        if seen.shown[i, k] or seen.covered[i, k]
    ]
    missing = seen.missing()
    more = f"Put the board {missing}, and add these images{m.where_best}."
    said = f"Corners were seen in {seen.share:.0%} of what the image shows. Missing: {missing or 'nothing'}."
    return Figure(
        "coverage",
        "Where the board was seen",
        chart(
            *cells,
            disc.dots(m.theta, m.phi, "corner"),
            disc.rings(),
            said=said,
            width=SIDE + 30,
            height=SIDE,
        ),
        (
            "The whole field of view as a disc: the middle is the axis of the camera, the distance from it the angle "
            "from the axis, and the sides are those of the image. Each dot is a corner of the board. Blue parts have "
            f"at least {ENOUGH} corners; orange hatched parts are in the image and have none; blank parts are not.",
            "Blue all around and out to the rim. A camera is only known where it was tested.",
            more if missing else "Nothing is missing here.",
        ),
        "Coverage",
    )


def _said(low: float, high: float, side: str, corners: int) -> str:
    return f"{np.degrees(low):.0f}° to {np.degrees(high):.0f}° from the axis, {side}: {corners} corners"
