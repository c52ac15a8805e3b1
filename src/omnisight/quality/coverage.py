"""Where in the field of view corners were seen: rings of the angle from the axis, sectors of the azimuth."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.images import ImageField
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

RING_DEG = 20.0
SECTORS = 8
# Directions asked for in a cell, each way, and the part of them that must fall in the image for it to count.
FINE = 4
SEEN = 0.5
# Where it is not known what is shown, corners that begin so far from the axis (radians) leave a mirror's blind middle.
BLIND = np.radians(30.0)
# Corners that make a cell covered.
ENOUGH = 3
SIDES = ("right", "lower right", "bottom", "lower left", "left", "upper left", "top", "upper right")


@dataclass(frozen=True)
class Coverage:
    """How many corners lie in each part of the field of view.

    Attributes
    ----------
    edges
        (R + 1,) angles from the axis between the rings, radians.
    corners
        (R, S) corners in each ring and sector; sector k is centred on the azimuth 2 pi k/S, 0 to the right and pi/2
        down in the image. The innermost ring counts as one: all its sectors have all its corners.
    shown
        (R, S) whether the image shows that part.
    """

    edges: Array
    corners: NDArray[np.intp]
    shown: NDArray[np.bool_]

    @classmethod
    def of(cls, camera: Camera, state: State, views: Observations, field: ImageField | None = None) -> Self:
        """Count the corners of views; `field` is where the images show anything."""
        reach = max(camera.image_theta_max() if field is None else _reach(camera, field), camera.theta_max or 0.0)
        rings = max(int(np.ceil(np.degrees(reach) / RING_DEG - 0.25)), 2)
        edges = np.linspace(0, reach, rings + 1)
        points, _ = state.points(views)
        theta = angle_from_axis(points)
        ring = np.clip(np.searchsorted(edges, theta) - 1, 0, rings - 1)
        sector = np.round(np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi / SECTORS)).astype(int) % SECTORS
        corners = np.zeros((rings, SECTORS), np.intp)
        np.add.at(corners, (ring, sector), 1)
        corners[0] = corners[0].sum()
        shown = _shown(camera, edges, field)
        if field is None and camera.theta_min > BLIND:
            shown[edges[1:] <= camera.theta_min] = False
        return cls(edges, corners, shown)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(R, S) whether corners were seen there."""
        return self.corners >= ENOUGH

    @property
    def share(self) -> float:
        """The part of the cells that the image shows in which corners were seen, by solid angle."""
        weight = np.diff(-np.cos(self.edges))[:, None] * self.shown
        return float((weight * self.covered).sum() / weight.sum()) if weight.any() else 0.0

    @property
    def gap(self) -> float:
        """The widest range of azimuths (radians) that are shown without a corner, beyond the innermost ring."""
        if not (self.covered & self.shown)[1:].any():
            return 2 * np.pi
        sectors = np.flatnonzero(self.covered[1:].any(0) | ~self.shown[1:].any(0))
        steps = np.diff(np.append(sectors, sectors[0] + SECTORS))
        return float((steps.max() - 1) * 2 * np.pi / SECTORS)

    def empty_side(self) -> str:
        """Name the sectors without a corner in any ring but the innermost: 'the lower left, left and upper left'."""
        empty = np.asarray(~self.covered[1:].any(0) & self.shown[1:].any(0))
        return "the " + _and([SIDES[k] for k in _run(empty)]) if empty.any() else ""

    def missing(self, most: int = 3) -> str:
        """Name the largest parts without corners: '40 to 60 degrees from the axis at the upper left'."""
        empty = self.shown & ~self.covered
        named: list[tuple[int, str]] = []
        for i, row in enumerate(empty):
            if not row.any():
                continue
            where = "all around" if row.sum() >= SECTORS - 1 else "at the " + _and([SIDES[k] for k in _run(row)])
            low, high = np.degrees(self.edges[i : i + 2])
            named.append((int(row.sum()), f"{low:.0f} to {high:.0f} degrees from the axis {where}"))
        named.sort(key=lambda part: -part[0])
        return "; ".join(text for _, text in named[:most])


def _reach(camera: Camera, field: ImageField) -> float:
    """Give the largest angle (radians) from the axis of a pixel that shows anything."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 65), np.linspace(0, camera.height - 1, 65))
    pixels = np.stack([u.ravel(), v.ravel()], -1)
    angles = angle_from_axis(camera.model.unproject_numpy(pixels[field.contains(pixels)])[0])
    return float(np.nanmax(angles)) if np.isfinite(angles).any() else camera.model.theta_max


def _shown(camera: Camera, edges: Array, field: ImageField | None) -> NDArray[np.bool_]:
    steps = (np.arange(FINE) + 0.5) / FINE
    theta = (edges[:-1, None] + np.diff(edges)[:, None] * steps)[:, None, :, None]
    phi = ((np.arange(SECTORS)[:, None] + steps - 0.5) * 2 * np.pi / SECTORS)[None, :, None, :]
    bearings = polar(*np.broadcast_arrays(theta, phi))
    pixels, valid = camera.model.project_numpy(bearings.reshape(-1, 3))
    seen = valid & (camera.in_image(pixels) if field is None else field.contains(pixels))
    return seen.reshape(bearings.shape[:-1]).mean((2, 3)) >= SEEN


def _run(row: NDArray[np.bool_]) -> list[int]:
    """Give the sectors in order around the circle, beginning after a gap."""
    first = next((k for k in range(SECTORS) if row[k] and not row[k - 1]), 0)
    return [k % SECTORS for k in range(first, first + SECTORS) if row[k % SECTORS]]


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
