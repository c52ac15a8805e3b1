"""Calibration from images of straight lines."""

from omnisight.calibration.lines.arc_detection import deduplicate_static_arcs, detect_arcs
from omnisight.calibration.lines.estimation import LineEstimationOptions
from omnisight.calibration.lines.line_conics import Circle, fit_circle, line_conic, parabolic_camera
from omnisight.calibration.lines.observations import LineObservations, detect_lines, read_drawn_lines
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.plumb_line import PlumbLineState, fit_line_planes, refine_plumb_lines
from omnisight.calibration.lines.polyline_file import read_polylines
from omnisight.calibration.lines.result import LinesCalibration
from omnisight.calibration.lines.uncertainty import LinesUncertainty, bearing_difference, bearing_sigma

__all__ = [
    "Circle",
    "LineEstimationOptions",
    "LineObservations",
    "LinesCalibration",
    "LinesUncertainty",
    "PixelChains",
    "PlumbLineState",
    "bearing_difference",
    "bearing_sigma",
    "deduplicate_static_arcs",
    "detect_arcs",
    "detect_lines",
    "fit_circle",
    "fit_line_planes",
    "line_conic",
    "parabolic_camera",
    "read_drawn_lines",
    "read_polylines",
    "refine_plumb_lines",
]
