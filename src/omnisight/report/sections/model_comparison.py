"""The fitted models, and the selected one compared with a reference over the angle from the axis."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.state import MIN_OUTSIDE_COST_PX
from omnisight.quality.spline_baseline import RINGS
from omnisight.report.axes import Axes, chart, legend, path_data
from omnisight.report.html import Markup, element, join, table
from omnisight.report.number_format import capitalize
from omnisight.report.report_data import ReportData
from omnisight.report.section import Guide, Section

Array = NDArray[np.float64]

# A full bar of the table stands for this multiple of the smallest error; longer bars end in a point.
MAX_BAR_RATIO = 2.0
COLUMNS = ("model", "held-out rms, px", "rms, px", "parameters", "probability", "")
HELD_OUT = (
    "The held-out error is the error on images that the camera was not fitted to, by 5-fold cross-validation. The"
    " probability is that of predicting further images best. The model with the fewest parameters among those of the"
    " least expected error is selected; the uncertainty includes the disagreement of all models above 1 %."
)


@dataclass(frozen=True)
class Comparison:
    """Held-out errors of the selected model and of a reference, over the angle from the axis.

    Attributes
    ----------
    reference
        The reference.
    name
        Its name.
    edges
        (R + 1,) edges of the rings, radians.
    selected_rms, reference_rms
        (R,) held-out rms in each ring, px.
    summary
        The result in one sentence.
    """

    reference: Candidate
    name: str
    edges: Array
    selected_rms: Array
    reference_rms: Array
    summary: str


def model_comparison(data: ReportData) -> Section:
    """List the fitted models, and draw the held-out error of the selected one over the angle."""
    comparison = _spline_comparison(data) if data.best_central is None else _central_comparison(data, data.best_central)
    candidates = [*data.candidates, *([comparison.reference] if comparison is not None else [])]
    full = MAX_BAR_RATIO * min(_error(candidate) for candidate in candidates)
    rows = [_row(one.name, one, full, None if i else "selected") for i, one in enumerate(data.candidates)]
    if comparison is not None:
        rows.append(_row(comparison.name, comparison.reference, full, "reference"))
    caption = "Fitted models: the selected one, then the others by held-out error"
    reason = f"{data.selected.name}: {data.selection_reason}."
    parts = [element("p", reason, class_="lead"), table(COLUMNS, rows, caption=caption, class_="models")]
    held_out = data.selected.held_out_rms
    if held_out is not None and held_out < data.selected.rms and data.outliers.any():
        outliers = f"outliers ({int(data.outliers.sum())} of {len(data.outliers)} corners)"
        note = f"The held-out error is below the rms because it leaves out {outliers}, which the rms includes."
        parts.append(element("p", note, class_="note"))
    if comparison is not None:
        parts.append(_ring_chart(comparison, data.camera.model.name))
        parts.append(element("p", comparison.summary, class_="note"))
    guide = _spline_guide() if data.best_central is None else _central_guide(data.best_central)
    return Section("models", "Models compared", join(*parts), guide)


def _spline_guide() -> Guide:
    return Guide(
        f"Camera models fitted to the same corners. {HELD_OUT} The reference is a spline, which can represent any"
        " lens; the chart compares both over the angle from the axis.",
        "A held-out error close to the rms, and no ring in which the spline is clearly better.",
        "If the held-out error is much larger than the rms, add images. The verdict advises --model spline if the"
        " spline is significantly better.",
    )


def _central_guide(central: Candidate) -> Guide:
    return Guide(
        "Cameras fitted to the same corners. An axial camera is named after its lens model and its number of pupil"
        f" coefficients. {HELD_OUT} The reference in the last row is the best central camera; the chart compares both"
        " over the angle from the axis.",
        "A held-out error close to the rms, and lower than that of the central camera, mostly far off-axis.",
        "If the held-out error is much larger than the rms, add images. If the central camera is equivalent in every"
        f" ring, use it (--model {central.state.model.name}): it needs no distance, and all programs support it.",
    )


def _spline_comparison(data: ReportData) -> Comparison | None:
    """Compare a central camera with the spline baseline."""
    baseline = data.spline_baseline
    if baseline is None:
        return None
    rms = baseline.model_rms, baseline.spline_rms
    return Comparison(baseline.candidate, "spline", baseline.edges, *rms, f"{capitalize(str(baseline))}.")


def _central_comparison(data: ReportData, central: Candidate) -> Comparison | None:
    """Compare a non-central camera with the best central one."""
    lengths = data.selected.held_out_lengths, central.held_out_lengths
    if lengths[0] is None or lengths[1] is None:
        return None
    use = data.inliers & (lengths[0] < MIN_OUTSIDE_COST_PX) & (lengths[1] < MIN_OUTSIDE_COST_PX)
    edges = np.quantile(data.theta[use], np.linspace(0, 1, RINGS + 1))
    ring = np.clip(np.searchsorted(edges, data.theta[use]) - 1, 0, RINGS - 1)
    count = np.maximum(np.bincount(ring, minlength=RINGS), 1)
    selected, reference = (
        np.sqrt(np.bincount(ring, one[use] ** 2, RINGS) / count) for one in lengths if one is not None
    )
    k = int(np.argmax(reference**2 - selected**2))
    low, high = np.degrees(edges[k : k + 2])
    summary = (
        f"Held-out error: {data.selected.held_out_rms:.3f} px, central {central.name} {central.held_out_rms:.3f} px."
        f" The largest difference is {low:.0f}° to {high:.0f}° off-axis ({selected[k]:.3f} and {reference[k]:.3f} px)."
    )
    return Comparison(central, f"central {central.name}", edges, selected, reference, summary)


def _row(name: str, candidate: Candidate, full: float, kind: str | None) -> Markup:
    fraction = _error(candidate) / full
    points = [(0, 2), (100 * fraction, 2), (100 * fraction, 10), (0, 10)]
    if fraction > 1:
        points = [(0, 2), (92, 2), (100, 6), (92, 10), (0, 10)]
    bar = element(
        "svg",
        element("path", d=path_data(points) + "Z", class_="bar"),
        viewBox="0 0 100 12",
        preserveAspectRatio="none",
        class_="cell",
        aria_hidden="true",
    )
    held_out = "" if candidate.held_out_rms is None else f"{candidate.held_out_rms:.4f}"
    badge = element("span", kind) if kind == "selected" else None
    probability = "" if candidate.probability is None else f"{candidate.probability:.0%}"
    cells = (held_out, f"{candidate.rms:.4f}", str(candidate.parameters), probability, bar)
    return element("tr", element("th", name, badge, scope="row"), *(element("td", cell) for cell in cells), class_=kind)


def _ring_chart(comparison: Comparison, name: str) -> Markup:
    edges = np.degrees(comparison.edges)
    top = float(max(comparison.selected_rms.max(), comparison.reference_rms.max())) * 1.15
    box = (52.0, 26.0, 438.0, 168.0)
    x_range = float(edges[0]), float(edges[-1])
    axes = Axes(x_range, (0.0, top), "angle from the axis, degrees", "held-out rms, px", box)
    x = np.repeat(edges, 2)[1:-1]
    entries = (("line curve", name), ("line other", comparison.name))
    return chart(
        axes.frame(),
        axes.clip(
            axes.line(x, np.repeat(comparison.reference_rms, 2), "other"),
            axes.line(x, np.repeat(comparison.selected_rms, 2), "curve"),
        ),
        legend(entries, (56.0, 14.0), (160.0, 0.0), None),
        label=f"Held-out rms of {name} and {comparison.name} over the angle from the axis. {comparison.summary}",
        height=210,
    )


def _error(candidate: Candidate) -> float:
    return candidate.held_out_rms or candidate.rms
