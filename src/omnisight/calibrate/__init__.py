"""Calibration from pictures of plane boards."""

from omnisight.calibrate.calibration import Calibration, calibrate_camera
from omnisight.calibrate.candidates import Candidate
from omnisight.calibrate.views import BoardViews

__all__ = ["BoardViews", "Calibration", "Candidate", "calibrate_camera"]
