"""The models that were fitted, and another one beside the chosen one, ring by ring."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.state import MIN_OUTSIDE_COST_PX
from omnisight.pipeline.noncentral import RaysCalibration
from omnisight.quality.spline_baseline import RINGS, SplineBaseline
from omnisight.report.axes import Axes, chart
from omnisight.report.html import Markup, element, short, together
from omnisight.report.report_data import Figure, Material

Array = NDArray[np.float64]

# A bar that fills its cell is so many times as long as the shortest.
LONGEST = 2.0
HELD_OUT = (
    "Held out is its error on images it was not calibrated on: five rounds, in each a fifth of the images set"
    " aside. Of the models that are as good there as the best, the one with the fewest parameters is taken."
)
# How to read what is compared with a spline.
SPLINE = (
    f"Each row is a camera model fitted to the same corners. {HELD_OUT} A spline, which bends to any lens, is compared"
    " with it ring by ring.",
    "Held out hardly above rms, and the chosen model as low as the spline in every ring.",
    "Held out far above rms: add images. A ring in which the spline is clearly lower: calibrate with --model spline,"
    " if you need that part of the image.",
)


@dataclass(frozen=True)
class Beside:
    """What the chosen camera is compared with, both on corners that they were not calibrated on.

    Attributes
    ----------
    candidate
        The other camera.
    name
        What it is called.
    edges
        (R + 1,) angles from the axis, radians, between rings.
    own, other
        (R,) rms, px, of the chosen camera and of the other in each ring.
    sentence
        What comes of it.
    """

    candidate: Candidate
    name: str
    edges: Array
    own: Array
    other: Array
    sentence: str


def models(m: Material) -> Figure:
    """Draw the table of the models and, where it is known, the error of the chosen one ring by ring."""
    c = m.calibration
    rays = isinstance(c, RaysCalibration)
    beside, how = (_central(m, c), _how(c.central)) if rays else (_spline(c.trust.spline_baseline), SPLINE)
    shown = [*c.candidates, *([beside.candidate] if beside is not None else [])]
    full = LONGEST * min(_judged(candidate) for candidate in shown)
    rows = [_row(one.name, one, full, None if i else "chosen") for i, one in enumerate(c.candidates)]
    if beside is not None:
        rows.append(_row(beside.name, beside.candidate, full, "ceiling"))
    table = element(
        "table",
        element("caption", "Models, the chosen one first, then the best on images held out"),
        element("thead", element("tr", *(element("th", t, scope="col") for t in _COLUMNS))),
        element("tbody", *rows),
        class_="models",
    )
    parts = [element("p", c.reason, class_="lead"), element("div", table, class_="scroll")]
    if beside is not None:
        parts += [_rings(beside, c.camera.model.name), element("p", beside.sentence, class_="note")]
    return Figure("models", "Why this model", together(*parts), how, "Models")


def _spline(ceiling: SplineBaseline | None) -> Beside | None:
    """Compare a central camera with a spline, which bends to any lens."""
    if ceiling is None:
        return None
    sentence = f"{_capital(str(ceiling))}."
    return Beside(ceiling.candidate, "spline", ceiling.edges, ceiling.model_rms, ceiling.spline_rms, sentence)


def _central(m: Material, c: RaysCalibration) -> Beside | None:
    """Compare a camera of rays with the best central one."""
    own, other = c.chosen.held_out_lengths, c.central.held_out_lengths
    if own is None or other is None:
        return None
    use = m.usable & (own < MIN_OUTSIDE_COST_PX) & (other < MIN_OUTSIDE_COST_PX)
    edges = np.quantile(m.theta[use], np.linspace(0, 1, RINGS + 1))
    ring = np.clip(np.searchsorted(edges, m.theta[use]) - 1, 0, RINGS - 1)
    count = np.maximum(np.bincount(ring, minlength=RINGS), 1)
    rms = [np.sqrt(np.bincount(ring, lengths[use] ** 2, RINGS) / count) for lengths in (own, other)]
    most = int(np.argmax(rms[1] ** 2 - rms[0] ** 2))
    low, high = np.degrees(edges[most : most + 2])
    sentence = (
        f"The central {c.central.name} has {c.central.held_out_rms:.3f} px on images held out, this camera"
        f" {c.held_out_rms:.3f} px; they differ most {low:.0f} to {high:.0f} degrees from the axis"
        f" ({rms[1][most]:.3f} against {rms[0][most]:.3f} px)."
    )
    return Beside(c.central, f"central {c.central.name}", edges, rms[0], rms[1], sentence)


def _how(central: Candidate) -> tuple[str, str, str]:
    """Say how to read what is compared with a central camera."""
    return (
        f"Each row is a camera fitted to the same corners: an axial one is named by its lens and by how many"
        f" coefficients the place of its viewpoint has. {HELD_OUT} The last row is the best central camera, whose rays"
        " meet in one point; the two are compared ring by ring.",
        "Held out hardly above rms, and the chosen camera lower than the central one, most so far from the axis.",
        "Held out far above rms: add images. Where the central camera is as low in every ring, take that one"
        f" (--model {central.state.model.name}): it asks for no distance, and every program reads it.",
    )


_COLUMNS = ("model", "parameters", "rms, px", "held out, px", "")


def _row(called: str, candidate: Candidate, full: float, kind: str | None) -> Markup:
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
    name = element("th", called, element("span", kind) if kind == "chosen" else None, scope="row")
    cells = (str(candidate.parameters), f"{candidate.rms:.4f}", held_out)
    return element(
        "tr",
        name,
        *(element("td", cell) for cell in cells),
        element("td", bar),
        class_=kind,
    )


def _rings(beside: Beside, name: str) -> Markup:
    """Draw the held-out rms of both in each ring."""
    edges, other = np.degrees(beside.edges), beside.name
    top = float(max(beside.own.max(), beside.other.max())) * 1.15
    span = float(edges[0]), float(edges[-1])
    axes = Axes(span, (0.0, top), "angle from the axis, degrees", "rms held out, px", box=(52.0, 26.0, 438.0, 168.0))
    steps = np.repeat(edges, 2)[1:-1]
    return chart(
        axes.frame(),
        axes.inside(
            axes.line(steps, np.repeat(beside.other, 2), "other"),
            axes.line(steps, np.repeat(beside.own, 2), "curve"),
        ),
        element("path", d="M56 14h18", class_="line curve"),
        element("text", name, x=80, y=18),
        element("path", d="M216 14h18", class_="line other"),
        element("text", other, x=240, y=18),
        said=f"Held-out rms of {name} and of {other} in rings of the angle from the axis. {beside.sentence}",
        height=210,
    )


def _judged(candidate: Candidate) -> float:
    return candidate.held_out_rms or candidate.rms


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]
