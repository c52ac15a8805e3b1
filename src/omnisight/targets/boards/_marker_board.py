"""Boards with square markers: the layout of points and markers that the marker detector takes."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._protocol import Board

Array = NDArray[np.float64]


class MarkerLayout(NamedTuple):
    """Points and markers of a board, all lengths in the unit of its points.

    Attributes
    ----------
    points : (N, 2) array
    marker_corners : (M, 4, 2) array
        Corners of the markers by marker number, in the order of OpenCV's detector.
    pitch : float
        Distance from a marker to the next.
    min_step, max_step : float
        Smallest and largest distance between neighbouring points.
    dictionary : str
        OpenCV's name of the markers' dictionary.
    border : int
        Width of a marker's black border in cells.
    first_marker : int
        Number in the dictionary of the first marker.
    """

    points: Array
    marker_corners: Array
    pitch: float
    min_step: float
    max_step: float
    dictionary: str
    border: int
    first_marker: int


class BoardVariant(NamedTuple):
    """A board that a print may be instead of the requested one.

    Attributes
    ----------
    board : MarkerBoard
    ids : (N,) array of int
        The points of the requested board that are this board's points.
    note : str
        The difference, for the user; empty for the requested board.
    """

    board: "MarkerBoard"
    ids: NDArray[np.int64]
    note: str


@dataclass(frozen=True)
class MarkerBoard(Board):
    """A board whose points are identified by markers around them; a visible part of it is enough.

    Attributes
    ----------
    first_marker : int
        Number in the dictionary of the first marker; several boards in view at the same time need different markers.
    """

    detector: ClassVar[str] = "markers"

    first_marker: int = field(default=0, kw_only=True, metadata={"low": 0})

    @property
    @abstractmethod
    def layout(self) -> MarkerLayout:
        """Points and markers."""

    @property
    @abstractmethod
    def bright_ahead(self) -> NDArray[np.bool_]:
        """Whether the quadrant of each point (N,) towards +x and +y is white."""

    @property
    def is_symmetric(self) -> bool:
        return False

    def variants(self) -> list[BoardVariant]:
        """Return the board itself, then the boards that it is easily confused with."""
        return [BoardVariant(self, np.arange(self.size), "")]
