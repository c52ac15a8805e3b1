"""The camera's parameters with their standard deviations."""

import numpy as np

from omnisight.report.markup import element, together
from omnisight.report.material import Figure, Material

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
            element("td", p.unit),
            element("td", p.doc),
        )
        for p, value, sigma in zip(model.parameters, model.params, sigmas, strict=True)
    ]
    heads = ("parameter", "value", "± 1 σ", "unit", "what it is")
    table = element(
        "div",
        element(
            "table",
            element("thead", element("tr", *(element("th", head, scope="col") for head in heads))),
            element("tbody", *rows),
        ),
        class_="scroll",
    )
    if len(rows) > MANY:
        table = element("details", element("summary", f"All {len(rows)} parameters of {model.name}"), table)
    bend = m.calibration.state.warp
    board = m.result.search.board
    unit = board.unit if board is not None else "squares"
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
            " else makes pictures disagree, leaves open. A dash stood still and was not estimated.",
            "A centre (cx, cy) known to a fraction of a pixel.",
            "Do not compare two calibrations by their parameters: several sets of them make nearly the same camera. "
            "Compare where they put directions, as the map of the uncertainty does.",
        ),
        "Parameters",
    )


def with_sigma(value: float, sigma: float) -> tuple[str, str]:
    """Write a value and its standard deviation to two digits of the latter; a dash where that is nought or unknown."""
    if not (np.isfinite(sigma) and sigma > 0):
        return _signed(f"{value:.6g}"), "–"
    digits = 1 - int(np.floor(np.log10(sigma)))
    if 0 <= digits <= 7:
        return _signed(f"{value:.{digits}f}"), f"{sigma:.{digits}f}"
    power = int(np.floor(np.log10(max(abs(value), sigma))))
    digits = max(0, digits + power)
    scale = 10.0**power
    return _signed(f"{value / scale:.{digits}f}e{power}"), f"{sigma / scale:.{digits}f}e{power}"


def _signed(text: str) -> str:
    return text.replace("-", "−", 1) if text.startswith("-") else text
