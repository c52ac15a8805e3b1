"""Projection uncertainty of the camera over the field of view, in pixels and degrees."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from omnisight.display import rounded
from omnisight.quality.checks.uncertainty import MAX_UNCERTAINTY_PX
from omnisight.report.axes import chart
from omnisight.report.color_scale import LogColorScale
from omnisight.report.html import Markup, element
from omnisight.report.polar_axes import SIDE, PolarAxes
from omnisight.report.report_data import ReportData
from omnisight.report.section import Guide, Section

Array = NDArray[np.float64]

# The color scale ends at this multiple of the largest calibrated value: extrapolation must not dominate it.
MAX_EXTRAPOLATED_RATIO = 2.0
# Cells overlap their outer neighbours by this fraction of a cell to leave no visible gap between them.
CELL_OVERLAP = 0.03


def projection_uncertainty(data: ReportData) -> Section:
    """Draw maps of the standard deviation of projected points and of pixel directions."""
    result = data.uncertainty
    limit_px = MAX_UNCERTAINTY_PX[0] * data.central_limit.px_unit
    max_px, max_rad, theta, _ = result.worst()
    largest = (
        f" The largest values are {rounded(max_px)} px ({np.degrees(theta):.0f}° off-axis) and"
        f" {rounded(np.degrees(max_rad))}°."
        if np.isfinite(max_px)
        else ""
    )
    maps = [
        _map(data, result.pixels, "pixels", lambda value: f"{rounded(value)} px"),
        _map(data, np.degrees(result.angles), "degrees", lambda value: f"{rounded(value)}°"),
    ]
    return Section(
        "uncertainty",
        "Projection uncertainty",
        element("div", *maps, class_="pair"),
        Guide(
            "Standard deviation (1σ) of the projection of a point at infinity (left, px) and of the bearing of a pixel "
            "(right, degrees), after the rotation of the camera frame that fits best. Hatched directions beyond the "
            "dashed circle are extrapolated: there are no corners, and the values hold only if the model does.",
            f"Uniform values below {rounded(limit_px)} px inside the dashed circle.{largest}",
            f"Add images with the board in bright areas inside the circle, tilted by 30° to 45°{data.next_view_hint}.",
        ),
        wide=True,
    )


def _map(data: ReportData, values: Array, unit: str, format_value: Callable[[float], str]) -> Markup:
    result = data.uncertainty
    known = result.visible & np.isfinite(values) & (values > 0)
    calibrated = values[known & result.calibrated[:, None]]
    if not len(calibrated):
        return element("p", f"Uncertainty in {unit} is unknown: not enough images.", class_="note")
    top = float(calibrated.max())
    high = float(np.clip(values[known].max(), top, MAX_EXTRAPOLATED_RATIO * top)) * 1.001
    scale = LogColorScale(float(calibrated.min()), high)
    half_step, half_sector = (result.theta[1] - result.theta[0]) / 2, np.pi / len(result.phi)
    disc = PolarAxes(float(result.theta[known.any(1)].max() + half_step))
    overlap = 1 + 2 * CELL_OVERLAP
    cells, extrapolated = list[Markup](), list[str]()
    for i, k in np.argwhere(known):
        theta, phi, value = float(result.theta[i]), float(result.phi[k]), float(values[i, k])
        if not result.calibrated[i]:
            extrapolated.append(
                disc.cell((theta - half_step, theta + half_step), (phi - half_sector, phi + half_sector))
            )
        if i == 0 and k > 0:
            # The axis is one cell, drawn as a full circle.
            continue
        sector = (phi - half_sector, phi + overlap * half_sector) if i else (0.0, 2 * np.pi)
        text = f"{np.degrees(theta):.0f}° off-axis, azimuth {np.degrees(phi):.0f}°: {format_value(value)}"
        path = disc.cell((theta - half_step, theta + overlap * half_step), sector)
        cells.append(element("path", element("title", text), d=path, fill=scale.color(value), class_="heat"))
    return chart(
        *cells,
        element("path", d="".join(extrapolated), class_="extrapolated over") if extrapolated else Markup(),
        disc.circle(data.max_theta, "calibrated-edge"),
        disc.rings(),
        scale.bar((SIDE + 42, SIDE - 70), SIDE - 140, format_value),
        label=f"Uncertainty in {unit}: {format_value(float(calibrated.min()))} to {format_value(top)} within the"
        " calibrated field of view.",
        width=SIDE + 125,
        height=SIDE,
    )
