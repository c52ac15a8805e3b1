"""What is held in front of a camera to calibrate it, and how it is found in pictures."""

from .boards import Board, board_class, board_kinds
from .boards.checkerboard import Checkerboard
from .detection import Detection
from .find import BoardSearch, PictureDetection, find_boards
from .given import GivenTarget
from .length import parse_length
from .placing import detect_checkerboard

__all__ = [
    "Board",
    "BoardSearch",
    "Checkerboard",
    "Detection",
    "GivenTarget",
    "PictureDetection",
    "board_class",
    "board_kinds",
    "detect_checkerboard",
    "find_boards",
    "parse_length",
]
