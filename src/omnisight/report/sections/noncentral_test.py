"""Whether the rays meet in a point, and what a camera that says so leaves near and far."""

import numpy as np

from omnisight.calibration.candidate import Candidate
from omnisight.pipeline.noncentral import RaysCalibration
from omnisight.quality.noncentral_test import NonCentralityTest
from omnisight.ray_camera import RayCamera
from omnisight.report.axes import Axes, chart
from omnisight.report.html import Markup, element, together
from omnisight.report.report_data import LEAST, Figure, Material

# How the distances are drawn, the nearest first.
LINES = ("other", "curve", "ideal ideal-0")


def viewpoint(m: Material) -> Figure | None:
    """Draw the error of the central camera over the angle at each distance; nothing where it was not asked.

    Nor beside a camera of rays that has no axis: what is asked is a viewpoint that moves along one.
    """
    asked = m.asked
    if asked is None or (isinstance(m.camera, RayCamera) and m.travel is None):
        return None
    sentence, c = str(asked), m.calibration
    return Figure(
        "viewpoint",
        "Whether the rays meet in a point",
        together(
            element("p", f"{sentence[:1].upper()}{sentence[1:]}.", class_="lead"),
            _chart(asked),
            element("div", _table(asked), class_="scroll"),
        ),
        _how_to_leave(asked, c.central) if isinstance(c, RaysCalibration) else _how_to_take(asked),
        "Viewpoint",
    )


SHOWN = (
    "A central camera has one point that all rays pass. In most fisheyes that point moves with the angle, by"
    " millimetres, and in mirrors that are not made and mounted for it, by more. {} drawn is by how much the central"
    " camera then puts a point beside its place, root mean square around the axis, for points at three distances. It"
    " stands where it agrees best with the boards. What it leaves is hardly known where the travel is no larger than"
    " its standard deviation."
)


def _how_to_take(asked: NonCentralityTest) -> tuple[str, str, str]:
    """Say how to read it beside a central camera."""
    return (
        SHOWN.format("The same camera was fitted with a viewpoint that moves along its axis;"),
        "Images held out that are explained no better by a viewpoint that moves, and errors below the residuals"
        " themselves at the distances you work at.",
        "Calibrate with --model axial if you measure nearer or farther than the boards were: the file then has a ray,"
        " place and bearing, for each pixel."
        if asked.needed or asked.open
        else "Nothing, as long as you work at the distances of the boards. To be surer of the travel, hold boards very"
        " near and far, out to the rim: only the two together tell a viewpoint that moves from a lens.",
    )


def _how_to_leave(asked: NonCentralityTest, central: Candidate) -> tuple[str, str, str]:
    """Say how to read it beside an axial camera."""
    return (
        SHOWN.format("That of this camera moves along its axis;"),
        "Images held out that are explained better by a viewpoint that moves, and errors of the central camera well"
        " above the residuals at the distances you work at: there this camera is worth its distance.",
        "Give programs that take rays the file as it is. Those that take central cameras only get the one that fits at"
        " the distance you work at: omnisight convert --distance."
        if asked.needed or asked.open
        else f"Take the central camera, --model {central.state.model.name}: these images ask for no more, and every"
        " program reads it.",
    )


def _chart(asked: NonCentralityTest) -> Markup:
    degrees, left = np.degrees(asked.left.theta), asked.left
    top = max(float(np.nanmax(left.pixels, initial=LEAST)) * 1.12, LEAST)
    axes = Axes(
        (float(degrees[0]), float(degrees[-1])),
        (0.0, top),
        "angle from the axis θ, degrees",
        "error of the central camera, px",
        box=(52.0, 26.0, 438.0, 248.0),
    )
    legend = [
        together(
            element("path", d=f"M{56 + 130 * k} 14h18", class_=f"line {line}"),
            element("text", asked.distance(k), x=80 + 130 * k, y=18),
        )
        for k, line in enumerate(LINES)
    ]
    said = "; ".join(f"{asked.distance(k)}: {left.rms_pixels[k]:.2g} px" for k in range(len(LINES)))
    return chart(
        axes.frame(),
        axes.inside(*(axes.line(degrees, left.pixels[k], line) for k, line in enumerate(LINES))),
        *legend,
        said=f"Error of the central camera over the angle from the axis, root mean square: {said}.",
    )


def _table(asked: NonCentralityTest) -> Markup:
    left = asked.left
    rows = [
        element(
            "tr",
            element("th", asked.distance(k), scope="row"),
            element("td", f"{left.rms_pixels[k]:.3f}", class_="number"),
            element("td", f"{left.worst_pixels[k]:.3f}", class_="number"),
            element("td", f"{np.degrees(left.rms_angles[k]):.3f}", class_="number"),
            element("td", f"{np.degrees(left.worst_angles[k]):.3f}", class_="number"),
        )
        for k in range(len(left.distances))
    ]
    columns = ("distance", "rms, px", "worst, px", "rms, degrees", "worst, degrees")
    return element(
        "table",
        element("caption", "What the central camera leaves over the field"),
        element(
            "thead",
            element(
                "tr", *(element("th", t, scope="col", class_="number" if k else None) for k, t in enumerate(columns))
            ),
        ),
        element("tbody", *rows),
    )
