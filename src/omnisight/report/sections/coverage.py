"""Coverage of the field of view by corners."""

import numpy as np

from omnisight.quality.coverage import MIN_CORNERS, SECTORS, SIDES
from omnisight.report.axes import chart
from omnisight.report.html import element
from omnisight.report.polar_axes import SIDE, PolarAxes
from omnisight.report.report_data import ReportData
from omnisight.report.section import Guide, Section


def coverage(data: ReportData) -> Section:
    """Draw covered and missing cells on a disc of directions."""
    result = data.coverage
    disc = PolarAxes(float(result.edges[-1]))
    sector = 2 * np.pi / SECTORS
    cells = [
        element(
            "path",
            element("title", _cell_text(low, high, SIDES[k] if i else "all sides", int(result.corners[i, k]))),
            d=disc.cell((low, high), ((k - 0.5) * sector, (k + 0.5) * sector)),
            class_="covered" if result.covered[i, k] else "missing",
        )
        for i, (low, high) in enumerate(zip(result.edges[:-1], result.edges[1:], strict=True))
        for k in range(SECTORS)
        if result.visible[i, k] or result.covered[i, k]
    ]
    missing = result.missing()
    return Section(
        "coverage",
        "Coverage",
        chart(
            *cells,
            disc.dots(data.theta, data.phi, "corner"),
            disc.rings(),
            label=f"Corners cover {result.share:.0%} of the field of view. Missing: {missing or 'nothing'}.",
            width=SIDE + 30,
            height=SIDE,
        ),
        Guide(
            "The field of view: the radius is the angle from the optical axis, the direction is the side of the image. "
            f"Each dot is a corner. Blue cells have at least {MIN_CORNERS} corners, orange hatched cells are in the "
            "image but have fewer, blank cells are outside the image.",
            "Blue cells on all sides up to the image circle. The calibration is only tested where there are corners.",
            f"Add images with the board at {missing}{data.next_view_hint}."
            if missing
            else "No action needed: nothing is missing.",
        ),
    )


def _cell_text(low: float, high: float, side: str, corners: int) -> str:
    return f"{np.degrees(low):.0f}° to {np.degrees(high):.0f}° off-axis, {side}: {corners} corners"
