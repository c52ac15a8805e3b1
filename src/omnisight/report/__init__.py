"""Reports and viewers (HTML files that need no network) and drawings of results."""

from omnisight.report.page import write_report
from omnisight.report.report_data import ReportOptions
from omnisight.report.rigs.page import write_rig_report
from omnisight.report.viewer import write_viewer

__all__ = ["ReportOptions", "write_report", "write_rig_report", "write_viewer"]
