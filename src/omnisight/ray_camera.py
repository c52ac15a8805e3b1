"""A camera whose rays need not meet in a point: a model of rays, the size of its images, and what is known of it."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera, HasImageSize
from omnisight.geometry.rays import Rays
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel, model_class
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.ray_model import RayModel
from omnisight.optics.viewpoint import best_viewpoint

Array = NDArray[np.float64]

# Pixels along each side of the image that a central camera is fitted to.
SAMPLES = 33
# And how many of them at least must see something.
FEWEST = 16
# Farther than any length, in any unit: its square is a number still.
FARTHEST = 1e100
UNITS = ("m", "squares")


@dataclass(frozen=True)
class RayCamera(HasImageSize):
    """A non-central camera with its image: what `Camera` is to a central one.

    Every pixel has a ray of its own, a place and a bearing, so that the distance of what is seen matters. There is no
    `unproject`: a bearing alone does not say what a pixel sees.

    Attributes
    ----------
    model
        Pixels to rays, and points to pixels.
    size
        (width, height) of the image, px; (0, 0) where it is not known.
    unit
        Of the model's lengths and of points: "m", or "squares" of a board whose size was not given.
    theta_max, theta_min
        The angles from the axis (radians) between which corners were seen in calibration; None and 0 where that is not
        known.
    calibration
        Figures of the calibration (rms, held_out_rms, views, corners ...), by name.
    covariance
        (P, P) of the parameters, or None.
    provenance
        Where it came from: file, format, tool, date.
    extra
        What its file held beside that, kept for the next writer.
    """

    model: RayModel
    size: tuple[int, int]
    unit: str = "m"
    theta_max: float | None = None
    calibration: Mapping[str, Any] = field(default_factory=dict[str, Any])
    covariance: Array | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    extra: Mapping[str, Any] = field(default_factory=dict[str, Any])
    theta_min: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a size or a unit that is none."""
        super().__post_init__()
        if self.unit not in UNITS:
            raise ValueError(f"unit must be {' or '.join(UNITS)}, got {self.unit!r}")

    def rays(self, pixels: ArrayLike) -> Rays:
        """Give the rays of pixels (..., 2) in the camera's frame."""
        return self.model.rays(pixels)

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3), in `unit`, to pixels (..., 2) and their validity; see `RayModel.project`."""
        return self.model.project(points)

    def scaled(self, factor: float) -> "RayCamera":
        """Give the camera of the image resized by a factor; a pixel centre c goes to (c + 1/2) factor - 1/2."""
        size = (round(self.width * factor), round(self.height * factor))
        return dataclasses.replace(self, model=self.model.rescaled(factor), size=size, covariance=None)

    def points_at(self, pixels: ArrayLike, distance: float) -> tuple[Array, NDArray[np.bool_]]:
        """Give what pixels (..., 2) see at a distance from the frame's origin: points (..., 3), and which see any.

        Where its ray meets the sphere of that radius about the origin, going outwards.

        Raises
        ------
        ValueError
            If the distance is no length.
        """
        if not 0 < distance < FARTHEST:
            raise ValueError(f"distance must be a positive length, got {distance!r}")
        return _met(self.rays(pixels), distance)

    def central(self, distance: float, model: str | None = None) -> tuple[Camera, float]:
        """Give the central camera that agrees with it about what is so far away.

        Its frame is this one's. That of a lens which looks into mirrors is not: it stands in the point nearest to all
        rays, from which the distance counts, and behind an odd number of mirrors its z is turned round, away from
        where the lens looks. So a model of a lens fits it; but as the image, it then has the world's left and right
        exchanged, as every central camera calibrated through a mirror has.

        Parameters
        ----------
        distance
            In `unit`; infinity for a far scene.
        model
            A central camera model; that of its lens where its viewpoint moves along the axis, spline otherwise.

        Returns
        -------
        camera
            Central, with the same images.
        error
            By how much, px, the two differ at that distance at most.

        Raises
        ------
        ValueError
            If no central camera of that model comes near, or the distance is none.
        """
        if not (0 < distance < FARTHEST or distance == np.inf):
            raise ValueError(f"distance must be positive, got {distance!r}")
        if not all(self.size):
            raise ValueError(
                "the size of the image is not known: give the camera one, dataclasses.replace(camera, size=...)"
            )
        u, v = (np.linspace(0, side - 1, SAMPLES) for side in self.size)
        pixels = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
        rays = self.rays(pixels)
        angle = angle_from_axis(rays.bearings)
        with np.errstate(invalid="ignore"):
            use = rays.valid & (angle >= self.theta_min) & (angle <= (self.theta_max or np.pi))
        mirrors = self.model.mirrors if isinstance(self.model, Catadioptric) else ()
        if mirrors and use.any():
            rays = rays._replace(origins=rays.origins - best_viewpoint(self.model, pixels[use]).point)
        seen, valid = _met(rays, distance) if distance < np.inf else (rays.bearings, rays.valid)
        use &= valid
        if use.sum() < FEWEST:
            raise ValueError(f"{use.sum()} of {use.size} pixels, all over the image, see anything {distance:g} away")
        cone = self.theta_min, self.theta_max
        if mirrored := len(mirrors) % 2 == 1:
            seen = seen * (1.0, 1.0, -1.0)
            cone = np.pi - (self.theta_max or np.pi), np.pi - self.theta_min if self.theta_min else None
        lens = getattr(self.model, "lens", None)
        name = model or (lens.name if isinstance(lens, CameraModel) and not mirrors else "spline")
        found = model_class(name).fit(seen[use], pixels[use])
        again, back = found.project(seen[use])
        error = float(np.linalg.norm(again - pixels[use], axis=1).max()) if back.all() else float("inf")
        figures = {"distance": distance if distance < np.inf else "inf", "length_unit": self.unit, "differs_px": error}
        said = {"model": self.model.name, **figures, **({"mirrored": True} if mirrored else {})}
        provenance = {**self.provenance, "central_of": said}
        return Camera(found, self.size, theta_max=cone[1], theta_min=cone[0], provenance=provenance), error


def _met(rays: Rays, distance: float) -> tuple[Array, NDArray[np.bool_]]:
    """Give where rays going outwards meet the sphere about the origin: points (..., 3), and which do."""
    origins, bearings, valid = rays
    with np.errstate(invalid="ignore"):
        middle = (origins * bearings).sum(-1)
        square = distance**2 - (origins**2).sum(-1) + middle**2
        along = np.sqrt(np.where(square >= 0, square, np.nan)) - middle
        valid = valid & (along > 0)
    return np.where(valid[..., None], origins + along[..., None] * bearings, np.nan), valid
