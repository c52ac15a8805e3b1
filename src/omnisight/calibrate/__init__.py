"""Calibration from pictures of plane boards."""

from omnisight.calibrate.calibration import Calibration, calibrate_camera
from omnisight.calibrate.candidates import Candidate
from omnisight.calibrate.evaluate import Evaluation, evaluate_camera
from omnisight.calibrate.pictures import PicturesCalibration, calibrate_pictures
from omnisight.calibrate.second_pass import Won
from omnisight.calibrate.views import BoardViews

__all__ = [
    "BoardViews",
    "Calibration",
    "Candidate",
    "Evaluation",
    "PicturesCalibration",
    "Won",
    "calibrate_camera",
    "calibrate_pictures",
    "evaluate_camera",
]
