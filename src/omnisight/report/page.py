"""The calibration report as one HTML page: verdict and key figures, then one section per topic."""

from pathlib import Path

from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.report.html import Markup, element, join, write_html
from omnisight.report.json_data import json_element, to_dict
from omnisight.report.page_frame import Page, render
from omnisight.report.report_data import ReportData, ReportOptions
from omnisight.report.sections.board_poses import board_poses
from omnisight.report.sections.coverage import coverage
from omnisight.report.sections.downloads import downloads
from omnisight.report.sections.images import definitions, images
from omnisight.report.sections.model_comparison import model_comparison
from omnisight.report.sections.noncentral_test import noncentral_test
from omnisight.report.sections.parameters import parameters
from omnisight.report.sections.projection_uncertainty import projection_uncertainty
from omnisight.report.sections.pupil_shift import pupil_shift
from omnisight.report.sections.radial_profile import radial_profile
from omnisight.report.sections.residuals import residuals
from omnisight.report.sections.verdict import key_figures, title, verdict

# In the order of the page.
SECTIONS = (
    images,
    coverage,
    radial_profile,
    pupil_shift,
    projection_uncertainty,
    residuals,
    model_comparison,
    noncentral_test,
    board_poses,
    parameters,
    downloads,
)


# The options of `write_report` by default.
DEFAULT_OPTIONS = ReportOptions()


def write_report(calibration: Calibration, path: str | Path, options: ReportOptions = DEFAULT_OPTIONS) -> None:
    """Write a calibration report as one HTML file that loads nothing from the network.

    The images are read again and embedded at reduced size, at most 9 megapixels in all, which makes a file of some MB.

    Parameters
    ----------
    calibration
        The calibration.
    path
        The file, which is written atomically. Its folder must exist.
    options
        Options of the report.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = render_page(ReportData(calibration, options))
    write_html(path, text)


def render_page(data: ReportData) -> str:
    """Return the HTML text of the report."""
    sections = [section for make in SECTIONS if (section := make(data)) is not None]
    return render(
        Page(
            f"Calibration: {data.verdict}, {data.camera.model.name}",
            title(data),
            join(verdict(data.verdict), key_figures(data)),
            sections,
            data.quote(data.options.command),
            json_element(to_dict(data)),
            ("script.js", "scene.js"),
            before=join(_hatch_patterns(), _drop_bar(data)),
            after=element(
                "dialog", element("div"), element("button", "Close", type="button"), aria_label="Enlarged image"
            ),
        )
    )


def _drop_bar(data: ReportData) -> Markup:
    """Return the bar with the command that calibrates without the dropped images; the script shows it."""
    return element(
        "div",
        element("p", element("b", "", id="dropped-count"), " Command to calibrate without them:", id="dropped-text"),
        element("code", "", id="dropped-command", tabindex=0),
        element(
            "p",
            element("button", "Copy command", type="button", id="dropped-copy"),
            element("button", "Restore all", type="button", id="dropped-none"),
        ),
        id="dropped",
        hidden=True,
        role="status",
        data_command=data.quote(data.options.command),
    )


def _hatch_patterns() -> Markup:
    """Define the hatch patterns that figures share."""
    gray = element("path", d="M0 0V6", class_="hatching", stroke_width=1.4)
    orange = element("path", d="M0 0V6", class_="hatching missing-line", stroke_width=2)
    common = {"width": 6, "height": 6, "patternUnits": "userSpaceOnUse", "patternTransform": "rotate(45)"}
    patterns = (("hatch", gray), ("hatch-missing", orange))
    return definitions(*(element("pattern", line, id=name, **common) for name, line in patterns))
