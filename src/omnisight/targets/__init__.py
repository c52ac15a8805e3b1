"""Calibration targets: boards, their printing, and their detection in images."""

from omnisight.targets.boards import Board, board_class, board_kinds
from omnisight.targets.boards.checkerboard import Checkerboard
from omnisight.targets.detection import detect_boards, detect_checkerboard
from omnisight.targets.detections import Detection, Detections, ImageDetection
from omnisight.targets.detectors import detect
from omnisight.targets.length import parse_length
from omnisight.targets.point_target import PointTarget

__all__ = [
    "Board",
    "Checkerboard",
    "Detection",
    "Detections",
    "ImageDetection",
    "PointTarget",
    "board_class",
    "board_kinds",
    "detect",
    "detect_boards",
    "detect_checkerboard",
    "parse_length",
]
