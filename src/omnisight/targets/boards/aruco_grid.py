"""OpenCV's GridBoard: a grid of separate ArUco markers on white; any part of it is enough."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._aruco import cell_shapes, marker_cells, marker_count
from omnisight.targets.boards._protocol import MAX_WINDOW_SHARE, Board
from omnisight.targets.printing.drawing import Shape

# Largest gap between markers over the side of one: markers that are farther apart do not confirm each other.
MAX_SEPARATION_SIDES = 2.0


@dataclass(frozen=True)
class ArucoGrid(Board):
    """A grid of markers with nothing between them, as OpenCV's `cv2.aruco.GridBoard`; its points are their corners.

    Markers are numbered from `first_marker`, row by row from the top left. Point `4 n + k` is corner k of marker n of
    the board: top left, top right, bottom right, bottom left, as in `GridBoard.getObjPoints`. The origin is point 0.

    A corner of a marker is measured less accurately than a point where two squares meet: for a new board, use ChArUco
    or an AprilGrid.

    Attributes
    ----------
    columns, rows : int
        Markers along the board's x and y.
    marker, separation : float
        Side of a marker with its black border, and gap between two markers, in metres.
    dictionary : str
        OpenCV's name of the markers' dictionary, such as DICT_6X6_250.
    first_marker : int
        Number in the dictionary of the first marker; several boards in view at the same time need different markers.
    """

    kind: ClassVar[str] = "aruco_grid"
    detector: ClassVar[str] = "separate_markers"

    marker: float = field(metadata={"length": True})
    separation: float = field(metadata={"length": True, "default": (0.25, "marker")})
    dictionary: str = "DICT_6X6_250"
    first_marker: int = field(default=0, kw_only=True, metadata={"low": 0})

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 1:
            raise ValueError(f"an aruco_grid needs 1x1 markers or more, got {self.columns}x{self.rows}")
        if not 0 < self.marker < np.inf:
            raise ValueError(f"a marker needs a positive side in metres, got {self.marker}")
        if not 0 < self.separation <= MAX_SEPARATION_SIDES * self.marker:
            raise ValueError(
                f"markers of {self.marker * 1e3:g} mm that are {self.separation * 1e3:g} mm apart: the separation must"
                f" be positive, and at most {MAX_SEPARATION_SIDES:g} sides of a marker"
            )
        needed, available = self.first_marker + self.columns * self.rows, marker_count(self.dictionary)
        if needed > available:
            first = f" from number {self.first_marker}" if self.first_marker else ""
            raise ValueError(
                f"an aruco_grid of {self}{first} needs {needed} markers; {self.dictionary} has {available}"
            )

    @property
    def pitch(self) -> float:
        """Distance in metres from a marker to the next, edge to like edge."""
        return self.marker + self.separation

    @property
    def cell(self) -> float:
        """Side of a cell of a marker, in metres."""
        return self.marker / len(marker_cells(self.dictionary, 0))

    @property
    def quiet_zone(self) -> float:
        return max(self.separation, 2 * self.cell)

    @property
    def is_symmetric(self) -> bool:
        return False

    @property
    def size(self) -> int:
        return 4 * self.columns * self.rows

    @property
    def marker_corners(self) -> NDArray[np.float64]:
        """Corners (markers, 4, 2) of the markers, in metres."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        top_left = np.stack([column, row], axis=1) * self.pitch
        return top_left[:, None] + np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * self.marker

    @property
    def points(self) -> NDArray[np.float64]:
        """Corners of the markers (4 x markers, 3) in metres, z = 0."""
        return np.pad(self.marker_corners.reshape(-1, 2), [(0, 0), (0, 1)])

    @property
    def window_step(self) -> float:
        """Step of the window, in metres: a marker's black border and the gap limit it."""
        return min(self.cell, self.separation) / MAX_WINDOW_SHARE

    @property
    def extent(self) -> tuple[float, float, float, float]:
        return 0.0, 0.0, self.columns * self.pitch - self.separation, self.rows * self.pitch - self.separation

    def drawing(self) -> list[Shape]:
        """Return the markers."""
        return [
            shape
            for marker, (left, top) in enumerate(self.marker_corners[:, 0].tolist())
            for shape in cell_shapes(marker_cells(self.dictionary, self.first_marker + marker), left, top, self.marker)
        ]
