"""Kalibr's AprilGrid: a grid of AprilTags; any part of it is enough."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._aruco import cell_shapes, marker_cells, marker_count
from omnisight.targets.boards._marker_board import MarkerBoard, MarkerLayout
from omnisight.targets.boards._protocol import MAX_WINDOW_SHARE
from omnisight.targets.printing.drawing import Shape, rectangle


@dataclass(frozen=True)
class AprilGrid(MarkerBoard):
    """A grid of tags of family 36h11, as `kalibr_create_target_pdf --type apriltag` prints it; four points per tag.

    Tags and points are numbered as in Kalibr, from the BOTTOM left of the print: tags row by row upwards; points row
    by row, two rows per row of tags. For 2 x 2 tags:

        12-----13  14-----15
        | TAG 2 |  | TAG 3 |
         8------9  10-----11
         4------5   6------7
        | TAG 0 |  | TAG 1 |
         0------1   2------3

    The origin is point 0, as in Kalibr. Kalibr's y points up the print and its z out of the paper; here y points down
    and z into the paper, so all y are zero or negative. A point (x, y, z) here is (x, -y, -z) in Kalibr's frame: a
    rotation by 180° about x.

    Each tag has a black border of two cells (OpenCV: `markerBorderBits = 2`), and a black square touches each of its
    corners in the gaps: a point is where two squares meet, as on a checkerboard.

    Attributes
    ----------
    columns, rows : int
        Tags along the board's x and y; Kalibr's tagCols, tagRows.
    tag : float
        Side of a tag with its black border, in metres; Kalibr's tagSize.
    spacing : float
        Gap between two tags over the side of a tag; Kalibr's tagSpacing.
    """

    kind: ClassVar[str] = "aprilgrid"
    dictionary: ClassVar[str] = "DICT_APRILTAG_36h11"
    border: ClassVar[int] = 2

    tag: float = field(metadata={"length": True})
    spacing: float = field(metadata={"default": (0.3, None)})

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 1:
            raise ValueError(f"an aprilgrid needs 1x1 tags or more, got {self.columns}x{self.rows}")
        if not 0 < self.tag < np.inf:
            raise ValueError(f"a tag needs a positive side in metres, got {self.tag}")
        if not 0 < self.spacing <= 1:
            raise ValueError(
                f"spacing is {self.spacing:g}: expected the gap between tags over a tag's side, above 0 and at most 1,"
                " such as 0.3"
            )
        needed, available = self.first_marker + self.columns * self.rows, marker_count(self.dictionary)
        if needed > available:
            first = f" from number {self.first_marker}" if self.first_marker else ""
            raise ValueError(f"an aprilgrid of {self}{first} needs {needed} tags; the family 36h11 has {available}")

    @property
    def pitch(self) -> float:
        """Distance in metres from a tag to the next, edge to like edge."""
        return (1 + self.spacing) * self.tag

    @property
    def quiet_zone(self) -> float:
        return self.spacing * self.tag

    @property
    def size(self) -> int:
        return 4 * self.columns * self.rows

    @property
    def points(self) -> NDArray[np.float64]:
        """Corners of the tags (4 x tags, 3) in metres, numbered as in the class's figure; y is zero or negative."""
        j, i = np.mgrid[: 2 * self.rows, : 2 * self.columns]
        x, y = (n // 2 * self.pitch + n % 2 * self.tag for n in (i.ravel(), j.ravel()))
        return np.stack([x, 0.0 - y, np.zeros(x.size)], axis=1)

    @property
    def corners(self) -> NDArray[np.int64]:
        """Points (tags, 4) at the corners of each tag, in the order of OpenCV's detector.

        OpenCV's tags of this family are upside down relative to Kalibr's print: their first corner, the top left, is
        the bottom right of the printed tag; the others follow clockwise.
        """
        tag = np.arange(self.columns * self.rows)
        width = 2 * self.columns
        bottom_left = tag // self.columns * 2 * width + tag % self.columns * 2
        return bottom_left[:, None] + np.array([1, 0, width, width + 1])

    @property
    def layout(self) -> MarkerLayout:
        points = self.points[:, :2]
        gap = self.spacing * self.tag
        return MarkerLayout(
            points, points[self.corners], self.pitch, gap, self.tag, self.dictionary, self.border, self.first_marker
        )

    @property
    def window_step(self) -> float:
        """Step of the window, in metres: the tag's black border and the squares between tags limit it."""
        cells = len(marker_cells(self.dictionary, 0, border=self.border))
        return min(self.border / cells, self.spacing) * self.tag / MAX_WINDOW_SHARE

    @property
    def bright_ahead(self) -> NDArray[np.bool_]:
        """Whether the quadrant of each point (N,) towards +x and +y is white: neither its tag nor a square."""
        j, i = np.mgrid[: 2 * self.rows, : 2 * self.columns]
        return ((i + j) % 2 == 0).ravel()

    @property
    def extent(self) -> tuple[float, float, float, float]:
        gap = self.spacing * self.tag
        return -gap, -self.rows * self.pitch, self.columns * self.pitch, gap

    def drawing(self) -> list[Shape]:
        """Return the tags and the squares at their corners."""
        gap = self.spacing * self.tag
        shapes: list[Shape] = [
            rectangle(i * self.pitch - gap, -j * self.pitch, gap, gap)
            for j in range(self.rows + 1)
            for i in range(self.columns + 1)
        ]
        for tag in range(self.columns * self.rows):
            row, column = divmod(tag, self.columns)
            upright = marker_cells(self.dictionary, self.first_marker + tag, border=self.border)[::-1, ::-1]
            shapes += cell_shapes(upright, column * self.pitch, -row * self.pitch - self.tag, self.tag)
        return shapes
