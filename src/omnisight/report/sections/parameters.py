"""The camera parameters with their standard deviations."""

import numpy as np

from omnisight.optics.models.axial import Axial
from omnisight.report.html import Markup, element, join, table
from omnisight.report.number_format import format_with_sigma
from omnisight.report.report_data import ReportData
from omnisight.report.section import Guide, Section

# Longer tables are collapsed.
MAX_ROWS = 24
COLUMNS = ("parameter", "value", "± 1σ", "unit", "description")


def parameters(data: ReportData) -> Section:
    """List the parameters."""
    model, covariance = data.camera.model, data.camera.covariance
    sigmas = np.sqrt(np.diag(covariance)) if covariance is not None else np.full(model.params.shape, np.nan)
    rows = [
        element(
            "tr",
            element("th", parameter.name, scope="row"),
            *(element("td", cell, class_="number") for cell in format_with_sigma(float(value), float(sigma))),
            element("td", data.unit if parameter.unit == "m" else parameter.unit),
            element("td", parameter.doc),
        )
        for parameter, value, sigma in zip(model.parameters, model.params, sigmas, strict=True)
    ]
    body = table(COLUMNS, rows)
    if len(rows) > MAX_ROWS:
        # The few parameters of the entrance pupil stay visible.
        pupil = table(COLUMNS, rows[model.lens.params.size :]) if isinstance(model, Axial) else None
        body = join(pupil, element("details", element("summary", f"All {len(rows)} parameters of {model.name}"), body))
    return Section(
        "parameters",
        "Parameters",
        join(body, _board_warp(data)),
        Guide(
            "The parameters in the camera file, with one standard deviation estimated from the residuals. A dash marks "
            "a parameter that was held fixed.",
            "A principal point (cx, cy) with a standard deviation below one pixel.",
            "Do not compare calibrations by their parameters: different parameters can describe nearly the same "
            "camera. Compare projections instead, as the projection uncertainty does.",
        ),
    )


def _board_warp(data: ReportData) -> Markup | None:
    scale, unit = data.display_unit
    warp = scale * data.state.warp
    if not warp.any():
        return None
    text = (
        f"Board warp: its centre is {warp[0]:+.3g} {unit} (horizontal bend) and {warp[1]:+.3g} {unit} (vertical bend)"
    )
    return element("p", f"{text} off the plane of its edges.", class_="note")
