"""The camera's parameters with their standard deviations."""

import numpy as np

from omnisight.optics.models.axial import Axial
from omnisight.report.html import Markup, element, together
from omnisight.report.report_data import Figure, Material
from omnisight.report.number_format import with_sigma

# More rows than this are folded away.
MANY = 24


def parameters(m: Material) -> Figure:
    """Draw the table."""
    model, covariance = m.camera.model, m.camera.covariance
    sigmas = np.sqrt(np.diag(covariance)) if covariance is not None else np.full(model.params.shape, np.nan)
    rows = [
        element(
            "tr",
            element("th", p.name, scope="row"),
            *(element("td", cell, class_="number") for cell in with_sigma(float(value), float(sigma))),
            element("td", m.unit if p.unit == "m" else p.unit),
            element("td", p.doc),
        )
        for p, value, sigma in zip(model.parameters, model.params, sigmas, strict=True)
    ]
    table = _table(rows)
    if len(rows) > MANY:
        # Those of the lens are many, those of the place on its axis are few.
        own = _table(rows[model.lens.params.size :]) if isinstance(model, Axial) else None
        folded = element("details", element("summary", f"All {len(rows)} parameters of {model.name}"), table)
        table = together(own, folded)
    scale, unit = m.drawn_length
    bend = scale * m.calibration.state.warp
    bent = (
        f"The board is bent: its middle stands {bend[0]:+.3g} {unit} across and {bend[1]:+.3g} {unit} down off the"
        " plane of its edges."
    )
    return Figure(
        "parameters",
        "The parameters",
        together(table, element("p", bent, class_="note") if bend.any() else None),
        (
            "What the camera's file holds, with one standard deviation of each: what noise in the corners, and whatever"
            " else makes images disagree, leaves open. A dash stood still and was not estimated.",
            "A centre (cx, cy) known to a fraction of a pixel.",
            "Do not compare two calibrations by their parameters: several sets of them make nearly the same camera. "
            "Compare where they put directions, as the map of the uncertainty does.",
        ),
        "Parameters",
    )


def _table(rows: list[Markup]) -> Markup:
    heads = ("parameter", "value", "± 1 σ", "unit", "what it is")
    head = element("thead", element("tr", *(element("th", head, scope="col") for head in heads)))
    return element("div", element("table", head, element("tbody", *rows)), class_="scroll")
