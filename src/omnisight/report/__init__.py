"""Calibration reports (one HTML file that needs no network) and drawings of results."""

from omnisight.report.page import write_report
from omnisight.report.report_data import ReportOptions

__all__ = ["ReportOptions", "write_report"]
