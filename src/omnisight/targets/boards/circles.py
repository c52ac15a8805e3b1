"""The asymmetric circle grid: discs in rows, every second row shifted by half a step."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._protocol import Board
from omnisight.targets.printing.drawing import Disc, Shape

Array = NDArray[np.float64]

MIN_COLUMNS, MIN_ROWS = 2, 3
# Vertices of the polygon that stands for a circle.
OUTLINE_VERTICES = 64


@dataclass(frozen=True)
class CircleGrid(Board):
    """A grid of black discs like OpenCV's `CALIB_CB_ASYMMETRIC_GRID`; its points are their centres.

    Disc `row * columns + column` lies at x = (2 column + row mod 2) spacing, y = row spacing: 4x11 is OpenCV's
    `Size(4, 11)`. The centre of a disc's image is not the image of its centre, more so for a wide lens and near its
    edge, so a board with corners measures better.

    Attributes
    ----------
    columns, rows : int
        Discs in a row, and rows.
    spacing : float
        Distance in metres from a row to the next; discs of one row are twice as far apart.
    diameter : float or None
        Of a disc, in metres; None if unknown: it is needed to draw the board, not to detect it.
    """

    kind: ClassVar[str] = "circles"
    detector: ClassVar[str] = "circles"
    # Whether every second row is shifted by half a step.
    is_staggered: ClassVar[bool] = True

    spacing: float = field(metadata={"length": True})
    diameter: float | None = field(default=None, metadata={"length": True, "default": (1.0, "spacing")})

    def __post_init__(self) -> None:
        if self.columns < MIN_COLUMNS or self.rows < MIN_ROWS:
            raise ValueError(f"a grid of circles needs {MIN_COLUMNS} columns and {MIN_ROWS} rows or more, got {self}")
        if not 0 < self.spacing < np.inf:
            raise ValueError(f"a grid of circles needs a positive spacing in metres, got {self.spacing}")
        if self.diameter is not None and not 0 < self.diameter < self.pitch:
            raise ValueError(
                f"circles of {self.diameter * 1e3:g} mm that are {self.pitch * 1e3:.4g} mm apart: the diameter must be"
                " positive, and less than that"
            )

    @property
    def pitch(self) -> float:
        """Distance of a disc's centre from the nearest one."""
        return self.spacing * 2**0.5

    @property
    def is_symmetric(self) -> bool:
        """Whether it looks the same upside-down: with an even number of rows."""
        return self.rows % 2 == 0

    @property
    def quiet_zone(self) -> float:
        return self.spacing

    @property
    def points(self) -> Array:
        """Centres of the discs (N, 3) in metres: x runs fastest, z = 0."""
        row, column = np.mgrid[: self.rows, : self.columns]
        x, y = 2 * column + row % 2, row
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * self.spacing

    @property
    def window_step(self) -> float:
        return self.spacing

    def measurement_offset(self, project: Callable[[Array], Array]) -> Array:
        if self.diameter is None:
            return super().measurement_offset(project)
        return disc_centroid_offset(project, self.points, self.diameter / 2)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        radius = self._known_radius()
        right, bottom, _ = self.points.max(axis=0).tolist()
        return -radius, -radius, right + radius, bottom + radius

    def drawing(self) -> list[Shape]:
        """Return the discs."""
        radius = self._known_radius()
        return [Disc((x, y), radius) for x, y, _ in self.points.tolist()]

    def _known_radius(self) -> float:
        if self.diameter is None:
            raise ValueError(f"the diameter of the circles of the {self} board is unknown: specify it, such as 20mm")
        return self.diameter / 2


def disc_centroid_offset(project: Callable[[Array], Array], points: Array, radius: float) -> Array:
    """Return the offset of the centroid of a disc's image from the image of the disc's centre.

    The detector measures the centroid of the area that a disc covers in the image. Where the scale varies across the
    disc, by perspective or by the lens, that is not where its centre is seen.

    Parameters
    ----------
    project : callable
        Maps points (N, 3) of the board to pixels (N, 2).
    points : (N, 3) array
        Centres on the board, z = 0.
    radius : float
        In the unit of `points`.

    Returns
    -------
    (N, 2) array
        In px: subtract it from the measured pixels.
    """
    turn = (np.arange(OUTLINE_VERTICES) + 0.5) * (2 * np.pi / OUTLINE_VERTICES)
    rim = radius * np.stack([np.cos(turn), np.sin(turn), np.zeros(OUTLINE_VERTICES)], axis=1)
    centre = project(points)
    outline = project((points[:, None] + rim).reshape(-1, 3)).reshape(-1, OUTLINE_VERTICES, 2) - centre[:, None]
    # By Green's theorem the integral over an area is one along its border: for a polygon, a sum over its sides.
    following = np.roll(outline, -1, axis=1)
    area = outline[..., 0] * following[..., 1] - outline[..., 1] * following[..., 0]
    return ((outline + following) * area[..., None]).sum(axis=1) / (3 * area.sum(axis=1))[:, None]
