"""Stereo rectification of two central cameras: rows of both rectified images are epipolar curves."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.models.cassini import Cassini
from omnisight.views.maps import extrapolation_mask, resolution
from omnisight.views.remapper import Interpolation, remap

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Resolution of the sphere on which the field of view of both cameras is determined: half a degree.
GRID_PX_PER_RAD = 360 / np.pi
# Directions at which the resolution of the cameras is computed.
RESOLUTION_SAMPLES = 2000
# Angle from the plane perpendicular to the baseline, radians, up to which images are rectified. Nearer to the epipoles
# the parallax is less than a sixth, and the rectified images are stretched by more than six.
MAX_LATITUDE = np.radians(80.0)
# A viewing direction within this sine of the baseline does not determine the direction of the rectified images.
MIN_SINE = 0.1


@dataclass(frozen=True, eq=False)
class Rectification(Displayed):
    """The rectified images of two cameras.

    The baseline is the x axis of both rectified frames. The column of a direction is its angle from the baseline, the
    row its angle about it: a point has the same row in both images, and a larger column in the first one.

    Attributes
    ----------
    cameras
        The cameras a and b.
    masks
        For both, (H, W), which pixels of the image are used.
    camera
        The camera of both rectified images, of the model `Cassini`.
    rectified_from_a, rectified_from_b
        (3, 3) rotations of the bearings of both cameras.
    baseline
        Distance of the cameras, in the unit of the pose.
    max_disparity
        Largest difference of the columns of a point, px.
    """

    cameras: tuple[Camera, Camera]
    masks: tuple[Mask, Mask] = field(repr=False)
    camera: Camera
    rectified_from_a: Array = field(repr=False)
    rectified_from_b: Array = field(repr=False)
    baseline: float
    max_disparity: int

    @property
    def min_distance(self) -> float:
        """Distance from the cameras beyond which no point has a larger disparity."""
        return float(self.baseline / np.sin(self.max_disparity / self.px_per_rad))

    @property
    def px_per_rad(self) -> float:
        """Pixels per radian of the angle from the baseline."""
        return float(self.camera.model.params[0])

    @property
    def is_periodic(self) -> bool:
        """Whether the rectified images show all angles about the baseline: the first row then follows the last."""
        return abs(self.camera.height - 2 * np.pi * self.camera.model.params[1]) < 0.5

    def angles(self, columns: ArrayLike) -> Array:
        """Return the angles (...), radians, between the direction from camera a to b and columns (...)."""
        fx, _, cx, _ = self.camera.model.params
        return np.pi / 2 - (np.asarray(columns, float) - cx) / fx

    def remap(self, image: NDArray[Any], which: int) -> tuple[NDArray[Any], Mask]:
        """Rectify the image of camera a (0) or b (1).

        Returns
        -------
        The rectified image, black where the camera sees nothing, and (H, W) which of its pixels the camera sees.
        """
        rotation = (self.rectified_from_a, self.rectified_from_b)[which]
        seen = _visible(self.cameras[which], self.masks[which], rotation, self.camera)
        return remap(image, self.cameras[which], self.camera, rotation, interpolation="bicubic"), seen

    def remap_back(self, values: NDArray[Any], interpolation: Interpolation) -> NDArray[Any]:
        """Return values (H, W) of the first rectified image in the pixels of camera a; NaN where there are none."""
        a_from_rectified = self.rectified_from_a.T
        return remap(
            values,
            self.camera,
            self.cameras[0],
            a_from_rectified,
            interpolation=interpolation,
            border=np.nan,
            antialias=False,
        )

    def differences(self, bearings_a: Array, bearings_b: Array) -> Array:
        """Return the parallax and the deviation from the epipolar half-plane, radians, of bearings (N, 3) of points.

        Returns
        -------
        (N, 2): the difference of the angles from the baseline, positive for points at positive distances, and the
        difference of the angles about it times their distance from the axis, which is zero for exact bearings.
        """
        a, b = bearings_a @ self.rectified_from_a.T, bearings_b @ self.rectified_from_b.T
        latitude_a, latitude_b = (np.arctan2(v[:, 0], np.hypot(v[:, 1], v[:, 2])) for v in (a, b))
        about = np.arctan2(a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1], a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])
        return np.stack([latitude_a - latitude_b, about * np.cos((latitude_a + latitude_b) / 2)], -1)


def rectify(
    cameras: tuple[Camera, Camera],
    b_from_a: Pose,
    min_distance: float,
    masks: tuple[Mask | None, Mask | None] = (None, None),
) -> Rectification:
    """Return the rectification of two central cameras of any models.

    Both images are mapped to spheres whose poles lie on the baseline (S. Li, Binocular spherical stereo, IEEE Trans.
    Intelligent Transportation Systems 9(4), 2008; Z. Arican and P. Frossard, Dense disparity estimation from
    omnidirectional images, AVSS 2007). There is no image plane, so all directions can be rectified. The rectified
    images show the directions that both cameras see, at the resolution of the finer image, and look into the mean
    viewing direction of both cameras as far as it is perpendicular to the baseline.

    Parameters
    ----------
    cameras
        The cameras a and b; a is the left one of a usual pair.
    b_from_a
        Their pose, x_b = R x_a + t.
    min_distance
        Smallest distance of points from the cameras, in the unit of the pose, larger than the baseline.
    masks
        For both cameras, (H, W), which pixels of the image are used; None for all.

    Raises
    ------
    ValueError
        If the baseline is zero, the smallest distance is infinite or not larger than the baseline, or the cameras see
        no common direction.
    """
    baseline = float(np.linalg.norm(b_from_a.translation))
    if not 0 < baseline < np.inf:
        raise ValueError(f"the baseline is {baseline:g}: stereo needs two cameras in different places")
    if not np.isfinite(min_distance):
        raise ValueError(f"the smallest distance is {min_distance:g}, but must be finite")
    if not baseline < min_distance:
        raise ValueError(
            f"the smallest distance is {min_distance:g}, but must be larger than the baseline, which is {baseline:g}"
        )
    a, b = (
        np.ones(camera.size[::-1], np.bool_) if mask is None else mask
        for camera, mask in zip(cameras, masks, strict=True)
    )
    rectified_from_a = _rectified_from_a(b_from_a, baseline)
    rotations = rectified_from_a, rectified_from_a @ b_from_a.rotation.T
    parallax = float(np.arcsin(baseline / min_distance))
    view = _common_view(cameras, (a, b), rotations, parallax)
    return Rectification(cameras, (a, b), view, *rotations, baseline, int(np.ceil(parallax * view.model.params[0])))


def _rectified_from_a(b_from_a: Pose, baseline: float) -> Array:
    """Return the rotation (3, 3) into the frame with x along the baseline, and z near both viewing directions."""
    x = -b_from_a.rotation.T @ b_from_a.translation / baseline
    forward = np.array([0.0, 0.0, 1.0])
    # If the mean direction is along the baseline, or the cameras look into opposite directions: that of a, or up.
    candidates = b_from_a.rotation[2] + forward, forward, np.array([0.0, -1.0, 0.0])
    across = (candidate - (candidate @ x) * x for candidate in candidates)
    z = next(direction for direction in across if np.linalg.norm(direction) > MIN_SINE)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _common_view(
    cameras: tuple[Camera, Camera], masks: tuple[Mask, Mask], rotations: tuple[Array, Array], parallax: float
) -> Camera:
    """Return the camera of the rectified images.

    A point that both cameras see lies within the largest parallax (radians) of directions that both see.
    """
    grid = _view(GRID_PX_PER_RAD, (-MAX_LATITUDE, MAX_LATITUDE), (-np.pi, np.pi))
    seen = [_visible(*of_camera, grid) for of_camera in zip(cameras, masks, rotations, strict=True)]
    rows, columns = np.nonzero(seen[0] & seen[1])
    if not len(rows):
        raise ValueError(
            "the cameras see no common direction that is more than"
            f" {90 - np.degrees(MAX_LATITUDE):.0f} degrees from their baseline: there is nothing to match"
        )
    bearings, _ = grid.unproject(np.stack([columns, rows], -1)[:: 1 + len(rows) // RESOLUTION_SAMPLES])
    px_per_rad = max(
        float(np.median(resolution(camera, bearings @ rotation)))
        for camera, rotation in zip(cameras, rotations, strict=True)
    )
    left, right = (
        np.clip((edge / grid.width - 0.5) * 2 * MAX_LATITUDE + reach, -MAX_LATITUDE, MAX_LATITUDE)
        for edge, reach in ((columns.min(), -parallax), (columns.max() + 1, parallax))
    )
    top, bottom = ((edge / grid.height - 0.5) * 2 * np.pi for edge in (rows.min(), rows.max() + 1))
    return _view(px_per_rad, (left, right), (top, bottom))


def _view(px_per_rad: float, across: tuple[float, float], down: tuple[float, float]) -> Camera:
    """Return the camera of a range of latitudes and of longitudes, radians."""
    width, height = (max(1, round((high - low) * px_per_rad)) for low, high in (across, down))
    # The outer edges of the outer pixels are at the limits of the ranges.
    fx, fy = width / (across[1] - across[0]), height / (down[1] - down[0])
    return Camera(Cassini(fx, fy, -0.5 - across[0] * fx, -0.5 - down[0] * fy), (width, height))


def _visible(camera: Camera, mask: Mask, rotation: Array, view: Camera) -> Mask:
    """Return which pixels (H, W) of a view show calibrated directions of a camera that its mask allows."""
    seen = remap(np.asarray(mask, np.uint8), camera, view, rotation, interpolation="nearest") > 0
    return seen & ~extrapolation_mask(camera, view, rotation)
