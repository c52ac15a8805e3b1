"""The images in which keypoints are detected: the image of the camera itself, or views that rectify it locally."""

from abc import ABC, abstractmethod
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.rotation import look
from omnisight.models.stereographic import Stereographic
from omnisight.views import Remapper
from omnisight.views.cube import CUBE_FACES
from omnisight.views.maps import is_periodic, resolution

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Border of a view around its face of the cube, and columns by which a periodic image is extended: the support of the
# largest keypoints of ORB, and of those of SIFT up to a radius of 9 px; 2 % are larger.
MARGIN_PX = 56
# Pixels along each side of the image from whose bearings the views are determined.
SAMPLES = 128


class Located(NamedTuple):
    """Pixels of a detection view in the camera.

    Attributes
    ----------
    pixels
        (N, 2) in the image of the camera.
    bearings
        (N, 3).
    d_pixel
        (N, 3, 2) derivative of the bearing by the pixel of the detection view.
    owned
        (N,) whether the direction belongs to this view; each belongs to one.
    """

    pixels: Array
    bearings: Array
    d_pixel: Array
    owned: Mask

    def select(self, mask: Mask) -> "Located":
        """Return the pixels of a mask (N,)."""
        return Located(self.pixels[mask], self.bearings[mask], self.d_pixel[mask], self.owned[mask])


class DetectionView(ABC):
    """An image in which keypoints are detected, made from the image of a camera.

    Attributes
    ----------
    camera
        The camera.
    cell
        (H, W), 255 where pixels of the view may be owned.
    """

    camera: Camera
    cell: Bytes

    @abstractmethod
    def __call__(self, image: Bytes) -> Bytes:
        """Return the view of an image (H, W), or of a mask of 0 and 255."""

    @abstractmethod
    def locate(self, pixels: Array) -> Located:
        """Return the directions of pixels (N, 2) of the view."""

    @cached_property
    def clearance(self) -> NDArray[np.float32]:
        """Distance (H, W), px, of pixels to the nearest outside of the calibrated field of view."""
        return distance_to_invalid(self, valid_region(self.camera))


class WholeImage(DetectionView):
    """The image itself, cropped to what has a direction, and reduced to a maximum resolution.

    Columns are repeated at the seam of a 360 image.
    """

    def __init__(self, camera: Camera, max_resolution: float) -> None:
        bearings, _ = camera.samples(count=SAMPLES)
        ratio = max_resolution / float(np.median(resolution(camera, bearings))) if len(bearings) else 1.0
        # An integer number of columns, because the image of a 360 camera repeats after them.
        self._factor = round(camera.width * min(ratio, 1.0)) / camera.width
        self.camera = camera
        self._margin = MARGIN_PX if is_periodic(camera) else 0
        seen = valid_region(camera)
        rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
        self._first = np.array([columns[0], rows[0]]) if len(rows) else np.zeros(2, np.intp)
        self._last = np.array([columns[-1], rows[-1]]) if len(rows) else np.array(camera.size) - 1
        self.cell = np.full_like(self(seen.astype(np.uint8)), 255)

    def __call__(self, image: Bytes) -> Bytes:
        import cv2

        image = image[self._first[1] : self._last[1] + 1, self._first[0] : self._last[0] + 1]
        if self._factor < 1.0:
            scale = self._factor
            reduced = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            image = np.asarray(reduced, np.uint8)
        return np.pad(image, ((0, 0), (self._margin, self._margin)), "wrap")

    def locate(self, pixels: Array) -> Located:
        source = (pixels - (self._margin, 0) + 0.5) / self._factor - 0.5 + self._first
        bearings, valid, d_pixel, _ = self.camera.model.unproject_with_jacobians(source)
        return Located(source, bearings, d_pixel / self._factor, valid & self.camera.in_image(source))


class MirroredView(DetectionView):
    """Another view, with left and right exchanged."""

    def __init__(self, view: DetectionView) -> None:
        self._view, self.camera = view, view.camera
        self.cell = np.ascontiguousarray(view.cell[:, ::-1])

    def __call__(self, image: Bytes) -> Bytes:
        return np.ascontiguousarray(self._view(image)[:, ::-1])

    def locate(self, pixels: Array) -> Located:
        return self._view.locate(pixels * (-1, 1) + (self.cell.shape[1] - 1, 0))


class TangentView(DetectionView):
    """A stereographic view of the face of a cube: it maps small circles to circles, at nearly constant resolution.

    SIFT and ORB are invariant to rotation and scale, so a conformal view is all they need; a perspective view
    would stretch what is 55 degrees from its centre by 1.7 in one direction.
    """

    def __init__(self, camera: Camera, rotation: Array, seen: Array, max_resolution: float) -> None:
        """Build the view with a rotation (view from camera), cropped to what the camera sees (N, 3) in its face."""
        px_per_rad = min(float(np.median(resolution(camera, seen @ rotation))), max_resolution)
        self.camera, self._rotation = camera, rotation
        self._view = _cropped_view(seen, px_per_rad, max(camera.size) / SAMPLES)
        self._remap = Remapper(camera, self._view, rotation, interpolation="bicubic")
        bearings, _ = self._view.unproject(pixel_grid(self._view))
        across = np.abs(bearings[..., :2]).max(-1)
        # One pixel more than the face: OpenCV rounds the pixels of keypoints to look up the mask.
        self.cell = np.where(bearings[..., 2] >= across - 2 / px_per_rad, 255, 0).astype(np.uint8)

    def __call__(self, image: Bytes) -> Bytes:
        return self._remap(image)

    def locate(self, pixels: Array) -> Located:
        bearings, valid, d_pixel, _ = self._view.model.unproject_with_jacobians(pixels)
        source_from_view = self._rotation.T
        in_source = bearings @ self._rotation
        source, visible = self.camera.project(in_source)
        owned = valid & visible & self.camera.in_image(source) & _is_in_front_face(bearings)
        return Located(source, in_source, source_from_view @ d_pixel, owned)


def _cropped_view(seen: Array, px_per_rad: float, spacing: float) -> Camera:
    """Return a stereographic view of directions (N, 3), which have a spacing (px), in a face of the cube."""
    half_face = 2 * np.tan(np.pi / 8) * px_per_rad
    pixels, _ = Stereographic(px_per_rad, px_per_rad, 0.0, 0.0).project(seen)
    low = np.floor(np.maximum(pixels.min(0) - spacing, -half_face) - MARGIN_PX)
    width, height = np.ceil(np.minimum(pixels.max(0) + spacing, half_face) + MARGIN_PX) - low
    return Camera(Stereographic(px_per_rad, px_per_rad, -low[0], -low[1]), (int(width), int(height)))


@lru_cache(maxsize=4)
def tangent_views(camera: Camera, max_resolution: float) -> list[DetectionView]:
    """Return the views of the cube faces that the camera sees, at the resolution of its image or a maximum of it."""
    bearings, _ = camera.samples(count=SAMPLES)
    views: list[DetectionView] = []
    for yaw, pitch in CUBE_FACES.values():
        rotation = look(yaw, pitch)
        seen = bearings @ rotation.T
        seen = seen[_is_in_front_face(seen)]
        if len(seen):
            views.append(TangentView(camera, rotation, seen, max_resolution))
    return views or whole_image(camera, max_resolution)  # a camera that sees nothing has no keypoints


@lru_cache(maxsize=4)
def whole_image(camera: Camera, max_resolution: float) -> list[DetectionView]:
    """Return the image itself, or its mirror image if the camera exchanges left and right, as the only view."""
    image = WholeImage(camera, max_resolution)
    return [MirroredView(image) if _is_mirrored(camera) else image]


@lru_cache(maxsize=4)
def valid_region(camera: Camera) -> Mask:
    """Return which pixels (H, W) of a camera have a direction in its calibrated field of view."""
    region = np.empty((camera.height, camera.width), np.bool_)
    for row in range(camera.height):  # row by row, because all bearings need much more memory than the image
        bearings, valid = camera.unproject(np.stack([np.arange(camera.width), np.full(camera.width, row)], -1))
        region[row] = valid & camera.calibrated(bearings)
    return region


def distance_to_invalid(view: DetectionView, valid: Mask) -> NDArray[np.float32]:
    """Return the distance (H, W), px, of pixels of a view to the nearest that is not valid in the image.

    Beyond the view all pixels are invalid.
    """
    import cv2

    padded = np.pad((view(valid.astype(np.uint8) * 255) == 255).astype(np.uint8), 1)
    return np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1], np.float32)


def pixel_grid(camera: Camera) -> Array:
    """Return all pixels (H, W, 2)."""
    return np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(float)


def _is_in_front_face(bearings: Array) -> Mask:
    """Return which bearings (N, 3) of a view belong to its face of the cube, without its edges."""
    x, y, z = bearings.T
    return (z > np.abs(x)) & (z > np.abs(y))


def _is_mirrored(camera: Camera) -> bool:
    """Return whether the image exchanges left and right, as behind a mirror."""
    bearings, _ = camera.samples(count=9)
    _, _, d_point, _ = camera.model.project_with_jacobians(bearings)
    # Seen along the bearing, image axes without reflection turn right-handed.
    handedness = np.einsum("ni,ni->n", np.cross(d_point[:, 0], d_point[:, 1]), bearings)
    return bool(handedness.sum() < 0)
