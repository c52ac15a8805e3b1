"""Non-central cameras: a model whose rays need not meet in a point, and its image."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import BaseCamera, Camera, FieldOfView
from omnisight.geometry.rays import Rays
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel, model_class
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.central_limit import CentralLimit
from omnisight.optics.ray_model import RayModel
from omnisight.optics.viewpoint import best_viewpoint

Array = NDArray[np.float64]

# Pixels along each side of the grid that a central camera is fitted to, and how many of them must be valid.
GRID_SIZE, MIN_VALID_PIXELS = 33, 16
# Distances, in any unit, whose square is a finite number.
MAX_DISTANCE = 1e100
UNITS = ("m", "squares")


@dataclass(frozen=True, eq=False)
class RayCamera(BaseCamera[RayModel]):
    """A non-central camera: each pixel has a ray with its own origin and bearing, so the distance of a point matters.

    There is no `unproject`, because a bearing alone does not determine what a pixel sees.

    Attributes
    ----------
    model, size, theta_max, calibration, covariance, provenance, extra, theta_min
        As in `BaseCamera`.
    unit
        Unit of the lengths of the model and of points: "m", or "squares" of a board of unknown size.
    """

    unit: str = "m"

    def __post_init__(self) -> None:
        """Check the size and the unit."""
        super().__post_init__()
        if self.unit not in UNITS:
            raise ValueError(f"unit must be {' or '.join(UNITS)}, got {self.unit!r}")

    @cached_property
    def central_limit(self) -> Camera:
        """The central camera that this one is for a distant scene, with its calibrated cone and covariance.

        Its directions are those of the rays, whose origins do not matter at infinity. Behind an odd number of mirrors z
        is reversed, as in `central`.
        """
        model = CentralLimit(self.model)
        theta_min, theta_max = self.theta_min, self.theta_max
        if model.axes[2] < 0:  # the axis is reversed, so the greatest angle becomes the least
            theta_min, theta_max = (
                0.0 if theta_max is None else np.pi - theta_max,
                None if theta_min == 0 else np.pi - theta_min,
            )
        return Camera(model, self.size, theta_max=theta_max, theta_min=theta_min, covariance=self.covariance)

    @property
    def fov(self) -> FieldOfView:
        """Field of view in degrees of a distant scene; see `Camera.fov`."""
        return self.central_limit.fov

    @property
    def focal(self) -> float:
        """Focal length on the axis for a distant scene: px per radian."""
        return self.central_limit.focal

    @property
    def K(self) -> Array:
        """Not defined for a non-central camera: it depends on the distance of the scene.

        Raises
        ------
        AttributeError
            Always; the message names the central camera to use.
        """
        raise AttributeError(
            "a non-central camera has no camera matrix K, because the pixel of a direction depends on the distance: use"
            " camera.central(distance)[0].K, with distance=inf for a distant scene"
        )

    def rays(self, pixels: ArrayLike) -> Rays:
        return self.model.rays(pixels)

    def points_at(self, pixels: ArrayLike, distance: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return the points (..., 3) that pixels (..., 2) see at a distance from the origin, and their validity.

        A point is where the ray, going outwards, intersects the sphere of that radius about the origin.

        Raises
        ------
        ValueError
            If the distance is not a positive length.
        """
        if not 0 < distance < MAX_DISTANCE:
            raise ValueError(f"distance must be a positive length, got {distance!r}")
        return _intersect_sphere(self.rays(pixels), distance)

    def central(self, distance: float, model: str | None = None) -> tuple[Camera, float]:
        """Return the central camera that agrees best with this one for points at a distance.

        Its frame is that of this camera. For a lens that looks into mirrors, the frame is moved to the point nearest to
        all rays, from which the distance is measured; behind an odd number of mirrors z is reversed, away from the
        viewing direction of the lens. A lens model can then fit the camera, but left and right of the world are
        exchanged, as in the image and in every central camera calibrated through a mirror.

        Parameters
        ----------
        distance
            In `unit`; infinity for a distant scene.
        model
            Name of a central camera model. By default that of the lens for an axial camera, else spline.

        Returns
        -------
        camera
            Central camera of the same images.
        error
            Largest difference between the two cameras at that distance, px.

        Raises
        ------
        ValueError
            If no central camera of that model can be fitted, or the distance is not positive.
        """
        if not (0 < distance < MAX_DISTANCE or distance == np.inf):
            raise ValueError(f"distance must be positive, got {distance!r}")
        if not all(self.size):
            raise ValueError("the image size is unknown: set it with dataclasses.replace(camera, size=...)")
        mirrors = self.model.mirrors if isinstance(self.model, Catadioptric) else ()
        bearings, pixels = self._directions(distance, has_mirrors=bool(mirrors))
        theta_min, theta_max = self.theta_min, self.theta_max
        if mirrored := len(mirrors) % 2 == 1:
            bearings = bearings * (1.0, 1.0, -1.0)
            theta_min, theta_max = np.pi - (theta_max or np.pi), np.pi - theta_min if theta_min else None
        lens = getattr(self.model, "lens", None)
        name = model or (lens.name if isinstance(lens, CameraModel) and not mirrors else "spline")
        fitted = model_class(name).fit(bearings, pixels)
        projected, valid = fitted.project(bearings)
        error = float(np.linalg.norm(projected - pixels, axis=1).max()) if valid.all() else float("inf")
        origin: dict[str, Any] = {
            "model": self.model.name,
            "distance": distance if distance < np.inf else "inf",
            "length_unit": self.unit,
            "differs_px": error,
        }
        provenance = {**self.provenance, "central_of": origin | ({"mirrored": True} if mirrored else {})}
        camera = Camera(fitted, self.size, theta_max=theta_max, theta_min=theta_min, provenance=provenance)
        return camera, error

    def _directions(self, distance: float, *, has_mirrors: bool) -> tuple[Array, Array]:
        """Return the directions (N, 3) of what a grid of pixels (N, 2) sees at a distance, from the best viewpoint."""
        u, v = (np.linspace(0, side - 1, GRID_SIZE) for side in self.size)
        pixels = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
        rays = self.rays(pixels)
        angle = angle_from_axis(rays.bearings)
        with np.errstate(invalid="ignore"):
            use = rays.valid & (angle >= self.theta_min) & (angle <= (self.theta_max or np.pi))
        if has_mirrors and use.any():
            rays = rays._replace(origins=rays.origins - best_viewpoint(self.model, pixels[use]).point)
        directions, valid = _intersect_sphere(rays, distance) if distance < np.inf else (rays.bearings, rays.valid)
        use &= valid
        if use.sum() < MIN_VALID_PIXELS:
            raise ValueError(f"only {use.sum()} of {use.size} pixels all over the image see a point {distance:g} away")
        return directions[use], pixels[use]


def _intersect_sphere(rays: Rays, radius: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return where outgoing rays intersect the sphere about the origin: points (..., 3), and their validity."""
    origins, bearings, valid = rays
    with np.errstate(invalid="ignore"):
        closest = (origins * bearings).sum(-1)
        square = radius**2 - (origins**2).sum(-1) + closest**2
        distance = np.sqrt(np.where(square >= 0, square, np.nan)) - closest
        valid = valid & (distance > 0)
    return np.where(valid[..., None], origins + distance[..., None] * bearings, np.nan), valid
