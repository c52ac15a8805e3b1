"""Coverage of the field of view by corners, in rings of the angle from the axis and sectors of the azimuth."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.images import ImageField
from omnisight.quality.wording import MAX_NAMED
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Width of a ring, and number of sectors: a cell is about as large as a board.
RING_DEG, SECTORS = 20.0, 8
# Samples per cell and direction, and share of them inside the image that makes a cell visible.
SAMPLES, MIN_VISIBLE_SHARE = 4, 0.5
# Least angle of the corners (radians) above which, without an image field, the centre is the blind spot of a mirror.
MIN_BLIND_SPOT_RAD = np.radians(30.0)
# Corners that cover a cell.
MIN_CORNERS = 3
SIDES = ("right", "lower right", "bottom", "lower left", "left", "upper left", "top", "upper right")


@dataclass(frozen=True)
class Coverage(Displayed):
    """Number of corners in each cell of the field of view.

    Attributes
    ----------
    edges
        (R + 1,) angles from the axis that bound the rings, radians.
    corners
        (R, S) corners in each ring and sector; sector k is centred on the azimuth 2 pi k/S, 0 to the right and pi/2
        down in the image. The innermost ring is one cell: all its sectors have the same count.
    visible
        (R, S) whether the cell is visible in the image.
    """

    edges: Array
    corners: NDArray[np.intp]
    visible: NDArray[np.bool_]

    @classmethod
    def of(cls, camera: Camera, state: State, observations: Observations) -> Self:
        """Count the corners per cell."""
        field = observations.field
        reach = max(camera.image_theta_max() if field is None else _reach(camera, field), camera.theta_max or 0.0)
        rings = max(int(np.ceil(np.degrees(reach) / RING_DEG - 0.25)), 2)
        edges = np.linspace(0, reach, rings + 1)
        points, _ = state.points(observations)
        theta = angle_from_axis(points)
        ring = np.clip(np.searchsorted(edges, theta) - 1, 0, rings - 1)
        sector = np.round(np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi / SECTORS)).astype(int) % SECTORS
        corners = np.zeros((rings, SECTORS), np.intp)
        np.add.at(corners, (ring, sector), 1)
        corners[0] = corners[0].sum()
        visible = _visible(camera, edges, field)
        if field is None and camera.theta_min > MIN_BLIND_SPOT_RAD:
            visible[edges[1:] <= camera.theta_min] = False
        return cls(edges, corners, visible)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(R, S) whether enough corners lie in the cell."""
        return self.corners >= MIN_CORNERS

    @property
    def share(self) -> float:
        """Share of the visible cells that are covered, by solid angle."""
        weight = np.diff(-np.cos(self.edges))[:, None] * self.visible
        return float((weight * self.covered).sum() / weight.sum()) if weight.any() else 0.0

    @property
    def gap(self) -> float:
        """Widest range of visible azimuths (radians) without corners outside the innermost ring."""
        sectors = np.flatnonzero(self.covered[1:].any(0) | ~self.visible[1:].any(0))
        if not len(sectors):
            return 2 * np.pi
        steps = np.diff(np.append(sectors, sectors[0] + SECTORS))
        return float((steps.max() - 1) * 2 * np.pi / SECTORS)

    def empty_side(self) -> str:
        """Return the sectors without corners outside the innermost ring: 'the lower left, left and upper left'."""
        empty = np.asarray(~self.covered[1:].any(0) & self.visible[1:].any(0))
        return "the " + _and([SIDES[k] for k in _run(empty)]) if empty.any() else ""

    def missing(self) -> str:
        """Return the largest regions without corners: '40° to 60° off-axis at the upper left'."""
        empty = self.visible & ~self.covered
        named: list[tuple[int, str]] = []
        for i, row in enumerate(empty):
            if not row.any():
                continue
            where = "all around" if row.sum() >= SECTORS - 1 else "at the " + _and([SIDES[k] for k in _run(row)])
            low, high = np.degrees(self.edges[i : i + 2])
            named.append((int(row.sum()), f"{low:.0f}° to {high:.0f}° off-axis {where}"))
        named.sort(key=lambda part: -part[0])
        return "; ".join(text for _, text in named[:MAX_NAMED])


def _reach(camera: Camera, field: ImageField) -> float:
    """Return the largest angle from the axis (radians) of a pixel inside the image field."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 65), np.linspace(0, camera.height - 1, 65))
    pixels = np.stack([u.ravel(), v.ravel()], -1)
    angles = angle_from_axis(camera.model.unproject_numpy(pixels[field.contains(pixels)])[0])
    return float(np.nanmax(angles)) if np.isfinite(angles).any() else camera.model.theta_max


def _visible(camera: Camera, edges: Array, field: ImageField | None) -> NDArray[np.bool_]:
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES
    theta = (edges[:-1, None] + np.diff(edges)[:, None] * steps)[:, None, :, None]
    phi = ((np.arange(SECTORS)[:, None] + steps - 0.5) * 2 * np.pi / SECTORS)[None, :, None, :]
    bearings = polar(*np.broadcast_arrays(theta, phi))
    pixels, valid = camera.model.project_numpy(bearings.reshape(-1, 3))
    seen = valid & (camera.in_image(pixels) if field is None else field.contains(pixels))
    return seen.reshape(bearings.shape[:-1]).mean((2, 3)) >= MIN_VISIBLE_SHARE


def _run(row: NDArray[np.bool_]) -> list[int]:
    """Return the sectors in order around the circle, starting after a gap."""
    first = next((k for k in range(SECTORS) if row[k] and not row[k - 1]), 0)
    return [k % SECTORS for k in range(first, first + SECTORS) if row[k % SECTORS]]


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def side_name(theta: float, phi: float) -> str:
    """Return where a direction is in the image: "at the lower left"."""
    return "in the middle" if theta < 1e-6 else f"at the {SIDES[round(phi / (2 * np.pi / SECTORS)) % SECTORS]}"
