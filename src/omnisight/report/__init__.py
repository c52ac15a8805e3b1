"""A calibration as one page: a single HTML file that needs no network, for whoever has to judge or use the camera."""

from omnisight.report.page import write_report

__all__ = ["write_report"]
