"""The report of the calibration of a rig as one HTML page."""

from pathlib import Path

from omnisight.pipeline.rig_calibration.rig_calibration import RigCalibration
from omnisight.report.html import join, write_html
from omnisight.report.json_data import json_element
from omnisight.report.page_frame import Page, render
from omnisight.report.report_data import ReportOptions
from omnisight.report.rigs.cameras import cameras
from omnisight.report.rigs.fields_of_view import fields_of_view
from omnisight.report.rigs.pairs import pairs
from omnisight.report.rigs.rig_downloads import rig_downloads
from omnisight.report.rigs.rig_json import to_dict
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.rigs.rig_residuals import rig_residuals
from omnisight.report.rigs.scene import rig_scene
from omnisight.report.rigs.summary import key_figures, title
from omnisight.report.rigs.uncertainty import uncertainty
from omnisight.report.sections.verdict import verdict

# In the order of the page.
SECTIONS = (rig_scene, cameras, pairs, fields_of_view, uncertainty, rig_residuals, rig_downloads)

# The options of `write_rig_report` by default.
DEFAULT_OPTIONS = ReportOptions(("omnisight", "calibrate-rig"))


def write_rig_report(calibration: RigCalibration, path: str | Path, options: ReportOptions = DEFAULT_OPTIONS) -> None:
    """Write the report of a rig as one HTML file that loads nothing from the network.

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
    text = render_rig_page(RigReportData(calibration, options))
    write_html(path, text)


def render_rig_page(data: RigReportData) -> str:
    """Return the HTML text of the report."""
    return render(
        Page(
            f"Rig calibration: {data.calibration.verdict}, {', '.join(data.rig.names)}",
            title(data),
            join(verdict(data.calibration.verdict), key_figures(data)),
            [make(data) for make in SECTIONS],
            data.quote(data.options.command),
            json_element(to_dict(data)),
            ("scene.js",),
        )
    )
