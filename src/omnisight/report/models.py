"""The models that were fitted, and what a spline would explain beside the chosen one."""

import numpy as np

from omnisight.calibrate.candidates import Candidate
from omnisight.calibrate.trust.ceiling import Ceiling
from omnisight.report.axes import Axes, chart
from omnisight.report.markup import Markup, element, short, together
from omnisight.report.material import Figure, Material

# A bar that fills its cell is so many times as long as the shortest.
LONGEST = 2.0


def models(m: Material) -> Figure:
    """Draw the table of the models and, where it is known, the error of the chosen one ring by ring."""
    c = m.calibration
    ceiling = c.trust.ceiling
    chosen = next((candidate for candidate in c.candidates if candidate.state is c.state), None)
    shown = [*c.candidates, *([ceiling.candidate] if ceiling is not None else [])]
    full = LONGEST * min(_judged(candidate) for candidate in shown)
    rows = [_row(candidate, full, candidate is chosen, k >= len(c.candidates)) for k, candidate in enumerate(shown)]
    table = element(
        "table",
        element("caption", "Models, the best on pictures held out first"),
        element("thead", element("tr", *(element("th", t, scope="col") for t in _COLUMNS))),
        element("tbody", *rows),
        class_="models",
    )
    parts = [element("p", c.reason, class_="lead"), element("div", table, class_="scroll")]
    if ceiling is not None:
        parts += [_rings(ceiling, c.camera.model.name), element("p", f"{_capital(str(ceiling))}.", class_="note")]
    return Figure(
        "models",
        "Why this model",
        together(*parts),
        (
            "Each row is a camera model fitted to the same corners. Held out is its error on pictures it was not"
            " calibrated on: five rounds, in each a fifth of the pictures set aside. Of the models that are as good"
            " there as the best, the one with the fewest parameters is taken. A spline, which bends to any lens, is"
            " compared with it ring by ring.",
            "Held out hardly above rms, and the chosen model as low as the spline in every ring.",
            "Held out far above rms: add pictures. A ring in which the spline is clearly lower: calibrate with"
            " --model spline, if you need that part of the picture.",
        ),
        "Models",
    )


_COLUMNS = ("model", "parameters", "rms, px", "held out, px", "")


def _row(candidate: Candidate, full: float, chosen: bool, beside: bool) -> Markup:
    share = _judged(candidate) / full
    # One that is longer than there is room for ends in a point.
    shape = f"M0 2H{short(100 * share)}V10H0Z" if share <= 1 else "M0 2H92L100 6L92 10H0Z"
    bar = element(
        "svg",
        element("path", d=shape, class_="bar"),
        viewBox="0 0 100 12",
        preserveAspectRatio="none",
        class_="cell",
        aria_hidden="true",
    )
    held_out = "" if candidate.held_out_rms is None else f"{candidate.held_out_rms:.4f}"
    name = element("th", candidate.name, element("span", "chosen") if chosen else None, scope="row")
    cells = (str(candidate.parameters), f"{candidate.rms:.4f}", held_out)
    return element(
        "tr",
        name,
        *(element("td", cell) for cell in cells),
        element("td", bar),
        class_="chosen" if chosen else "ceiling" if beside else None,
    )


def _rings(ceiling: Ceiling, name: str) -> Markup:
    """Draw the held-out rms of model and spline in each ring."""
    edges = np.degrees(ceiling.edges)
    top = float(max(ceiling.model_rms.max(), ceiling.spline_rms.max())) * 1.15
    span = float(edges[0]), float(edges[-1])
    axes = Axes(span, (0.0, top), "angle from the axis, degrees", "rms held out, px", box=(52.0, 26.0, 438.0, 168.0))
    steps = np.repeat(edges, 2)[1:-1]
    return chart(
        axes.frame(),
        axes.inside(
            axes.line(steps, np.repeat(ceiling.spline_rms, 2), "other"),
            axes.line(steps, np.repeat(ceiling.model_rms, 2), "curve"),
        ),
        element("path", d="M56 14h18", class_="line curve"),
        element("text", name, x=80, y=18),
        element("path", d="M216 14h18", class_="line other"),
        element("text", "spline", x=240, y=18),
        said=f"Held-out rms in rings of the angle from the axis: {ceiling}",
        height=210,
    )


def _judged(candidate: Candidate) -> float:
    return candidate.held_out_rms or candidate.rms


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]
