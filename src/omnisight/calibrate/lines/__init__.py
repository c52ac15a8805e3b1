"""Calibration from images of straight lines."""

from omnisight.calibrate.lines.arcs import find_arcs
from omnisight.calibrate.lines.calibration import LinesCalibration, calibrate_lines
from omnisight.calibrate.lines.chains import Chains
from omnisight.calibrate.lines.circles import Circle, fit_circle, parabolic_camera
from omnisight.calibrate.lines.conic import line_conic
from omnisight.calibrate.lines.plumb import Lines, lines_of, refine_lines
from omnisight.calibrate.lines.polylines import read_polylines
from omnisight.calibrate.lines.rival import apart
from omnisight.calibrate.lines.uncertainty import Uncertainty, bearing_deviation

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
