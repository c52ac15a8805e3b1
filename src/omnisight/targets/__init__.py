"""What is held in front of a camera to calibrate it, and how it is found in pictures."""

from .board import Board, parse_length
from .checkerboard import detect_checkerboard, guess_pattern
from .detection import Detection
from .find import PictureDetection, find_boards, pattern_hint

__all__ = [
    "Board",
    "Detection",
    "PictureDetection",
    "detect_checkerboard",
    "find_boards",
    "guess_pattern",
    "parse_length",
    "pattern_hint",
]
