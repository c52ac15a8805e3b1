"""What is held in front of a camera to calibrate it, and how it is found in images."""

from .boards import Board, board_class, board_kinds
from .boards.checkerboard import Checkerboard
from .detection import Detection
from .find import Detections, ImageDetection, detect_boards
from .given import PointTarget
from .length import parse_length
from .placing import detect_checkerboard

__all__ = [
    "Board",
    "Checkerboard",
    "Detection",
    "Detections",
    "ImageDetection",
    "PointTarget",
    "board_class",
    "board_kinds",
    "detect_boards",
    "detect_checkerboard",
    "parse_length",
]
