"""Calibration from images of straight lines."""

from omnisight.calibration.lines.arcs import find_arcs
from omnisight.calibration.lines.calibration import LinesCalibration, calibrate_lines
from omnisight.calibration.lines.chains import Chains
from omnisight.calibration.lines.circles import Circle, fit_circle, parabolic_camera
from omnisight.calibration.lines.conic import line_conic
from omnisight.calibration.lines.plumb import Lines, lines_of, refine_lines
from omnisight.calibration.lines.polylines import read_polylines
from omnisight.calibration.lines.rival import apart
from omnisight.calibration.lines.uncertainty import Uncertainty, bearing_deviation

__all__ = [
    "Chains",
    "Circle",
    "Lines",
    "LinesCalibration",
    "Uncertainty",
    "apart",
    "bearing_deviation",
    "calibrate_lines",
    "find_arcs",
    "fit_circle",
    "line_conic",
    "lines_of",
    "parabolic_camera",
    "read_polylines",
    "refine_lines",
]
