"""The non-central test: whether a shift of the entrance pupil explains the images better than a central camera."""

import numpy as np

from omnisight.quality.noncentral_test import NonCentralityTest
from omnisight.report.axes import Axes, chart, legend
from omnisight.report.html import Markup, element, join, table
from omnisight.report.number_format import capitalize
from omnisight.report.report_data import MIN_SCALE_PX, ReportData
from omnisight.report.section import Guide, Section

# Line styles of the distances, the nearest first.
LINE_CLASSES = ("other", "curve", "ideal ideal-0")
COLUMNS = ("distance", "rms, px", "max, px", "rms, degrees", "max, degrees")
CONTENT = (
    "All rays of a central camera pass one point. In most fisheye lenses the entrance pupil shifts by millimetres with"
    " the angle, and in mirrors that are not designed for a single viewpoint by more. {} The chart shows the error (rms"
    " over the azimuth) of the best central camera for points at three distances. It is hardly known if the shift is"
    " not larger than its standard deviation."
)


def noncentral_test(data: ReportData) -> Section | None:
    """Draw the error of the central camera over the angle; None if the test was not run.

    Non-central cameras that are not axial are not tested: the test is about a shift along the axis.
    """
    test = data.noncentral_test
    if test is None or (not data.is_central and data.pupil_shift is None):
        return None
    body = join(
        element("p", f"{capitalize(str(test))}.", class_="lead"),
        _chart(test),
        table(COLUMNS, _rows(test), caption="Error of the central camera over the field of view"),
    )
    guide = (
        _central_guide(test) if data.best_central is None else _axial_guide(test, data.best_central.state.model.name)
    )
    return Section("noncentral-test", "Non-central test", body, guide)


def _central_guide(test: NonCentralityTest) -> Guide:
    return Guide(
        CONTENT.format("The same camera was fitted with a shift along its axis."),
        "A held-out error that the shift does not reduce, and errors below the residuals at your working distances.",
        "Calibrate with --model axial if you measure nearer or farther than the boards were. The file then has an"
        " origin and a bearing for each pixel."
        if test.is_noncentral
        else "No action needed if you work at the distances of the boards. To reduce the uncertainty of the shift, add"
        " images with the board very near and far, up to the image circle: only together they separate the shift from"
        " the lens profile.",
    )


def _axial_guide(test: NonCentralityTest, central_name: str) -> Guide:
    return Guide(
        CONTENT.format("This camera has a shift along its axis."),
        "A held-out error that the shift reduces, and errors of the central camera well above the residuals at your"
        " working distances.",
        "Use the file as it is in programs that support rays. For other programs, export the central camera that fits"
        " best at your working distance: omnisight convert --distance."
        if test.is_noncentral or test.is_inconclusive
        else f"Use the central camera, --model {central_name}: these images do not require more, and all programs"
        " support it.",
    )


def _chart(test: NonCentralityTest) -> Markup:
    degrees, error = np.degrees(test.central_error.theta), test.central_error
    top = max(float(np.nanmax(error.pixels, initial=MIN_SCALE_PX)) * 1.12, MIN_SCALE_PX)
    x_range = float(degrees[0]), float(degrees[-1])
    box = (52.0, 26.0, 438.0, 248.0)
    axes = Axes(x_range, (0.0, top), "angle from the axis θ, degrees", "error of the central camera, px", box)
    entries = [(f"line {class_}", test.distance(k)) for k, class_ in enumerate(LINE_CLASSES)]
    values = "; ".join(f"{test.distance(k)}: {error.rms_pixels[k]:.2g} px" for k in range(len(LINE_CLASSES)))
    return chart(
        axes.frame(),
        axes.clip(*(axes.line(degrees, error.pixels[k], class_) for k, class_ in enumerate(LINE_CLASSES))),
        legend(entries, (56.0, 14.0), (130.0, 0.0), None),
        label=f"Error of the central camera over the angle from the axis, rms: {values}.",
    )


def _rows(test: NonCentralityTest) -> list[Markup]:
    error = test.central_error
    columns = (error.rms_pixels, error.max_pixels, np.degrees(error.rms_angles), np.degrees(error.max_angles))
    return [
        element(
            "tr",
            element("th", test.distance(k), scope="row"),
            *(element("td", f"{column[k]:.3f}", class_="number") for column in columns),
        )
        for k in range(len(error.distances))
    ]
