"""Blend the images of a rig to one view of a known surface, with precomputed maps."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import parallel_for
from omnisight.rig import Rig
from omnisight.views.seam_weights import seam_weights

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Image = NDArray[Any]
Mask = NDArray[np.bool_]

# Reduced copies of an image, each half the size: a 64-fold reduction covers views of any useful scale.
MAX_LEVELS = 7
# Weights below are less than half a gray level of 8 bits.
MIN_WEIGHT = 1 / 512
# Standard deviations: of the gains, half a stop of an automatic exposure, and of gray levels of the same surface seen
# from two sides, relative to white (Brown and Lowe 2007, section 6).
GAIN_SIGMA, INTENSITY_SIGMA = 0.35, 10 / 255
# View pixels at which overlapping images are compared: the mean of a thousand is exact to a fraction of a gray level.
MAX_OVERLAP_SAMPLES = 4000


class CameraMap(NamedTuple):
    """Where one camera sees the points of a view.

    Attributes
    ----------
    pixels
        (H, W, 2) pixels of the image; NaN where it does not see the point.
    visible
        (H, W).
    scale
        (H, W) image pixels per view pixel in the denser direction.
    resolution
        (H, W) image pixels per view pixel, by area.
    """

    pixels: Floats
    visible: Mask
    scale: Floats
    resolution: Floats


class SurroundRemapper:
    """Maps from the images of a rig to a view of points in its frame.

    Attributes
    ----------
    rig
        The rig.
    maps
        Where each camera sees the points.
    weights
        (C, H, W) blending weights.
    overlaps
        For each pair of cameras (a, b) the pixels (N, 2) of either image that show the same points, near the seam.
    """

    def __init__(
        self,
        rig: Rig,
        points: Array,
        *,
        feather_px: float,
        hidden: Sequence[Mask] | None = None,
        masks: Sequence[Mask | None] | None = None,
    ) -> None:
        """Compute the maps.

        Parameters
        ----------
        rig
            The rig; its cameras may be of any model, central or not.
        points
            (H, W, 3) points of the rig frame that the view shows.
        feather_px
            Width of the transition at seams, view pixels.
        hidden
            For each camera the view pixels (H, W) that it cannot show, such as those behind the vehicle.
        masks
            For each camera the image pixels (H, W) to use; None for all.
        """
        self.rig = rig
        self.shape = points.shape[:2]
        used = masks or (None,) * len(rig)
        self.maps = [camera_map(rig, k, points, mask) for k, mask in enumerate(used)]
        if hidden is not None:
            self.maps = [m._replace(visible=m.visible & ~h) for m, h in zip(self.maps, hidden, strict=True)]
        self.weights = seam_weights([m.resolution for m in self.maps], [m.visible for m in self.maps], feather_px)
        self._offsets, self._widths, self._sizes = _pyramid_layout(rig)
        self._first, self._table = self._samples()
        self.overlaps = self._overlap_samples()

    def __repr__(self) -> str:
        """Return the number of cameras and the size of the view."""
        return f"SurroundRemapper({len(self.rig)} cameras to {self.shape[1]}x{self.shape[0]})"

    def __call__(self, images: Sequence[Image], gains: Floats | None = None) -> Image:
        """Return the view (H, W, 3) of simultaneous images (H, W) or (H, W, 3), in the order of the cameras.

        Parameters
        ----------
        images
            Images of one type: uint8, uint16 or float32.
        gains
            (C, 3) factors of the images; 1 by default. See `gains`.
        """
        from omnisight.views._surround_kernel import blend

        images = self._rgb(images)
        dtype = images[0].dtype
        is_integer = np.issubdtype(dtype, np.integer)
        limit = np.float32(np.iinfo(dtype).max if is_integer else np.inf)
        rounding = np.float32(0.5 if is_integer else 0.0)
        buffer = self._buffer(images)
        factors = np.ones((len(images), 3), np.float32) if gains is None else np.asarray(gains, np.float32)
        view = np.empty((*self.shape, 3), dtype)
        arguments = buffer, self._table, factors, limit, rounding, self._first
        parallel_for(lambda low, high: blend(*arguments, low, high, view), self.shape[0], 16)
        return view

    @property
    def covered(self) -> Mask:
        """Which pixels (H, W) of the view any camera sees."""
        return np.asarray(self.weights.any(axis=0), np.bool_)

    def gains(self, images: Sequence[Image]) -> Floats:
        """Return factors (C, 3) of the images that make them agree where they overlap (Brown and Lowe 2007)."""
        count = len(images)
        images = self._rgb(images)
        scale = _white_level(images[0])
        gains = np.ones((count, 3), np.float32)
        for channel in range(3):
            # A camera without overlap keeps its gain of 1.
            normal, right = np.eye(count), np.ones(count)
            for a, b, at_a, at_b in self.overlaps:
                mean_a = images[a][at_a[:, 1], at_a[:, 0], channel].mean() / scale
                mean_b = images[b][at_b[:, 1], at_b[:, 0], channel].mean() / scale
                row = np.zeros(count)
                row[a], row[b] = mean_a, -mean_b
                normal += len(at_a) * np.outer(row, row) / INTENSITY_SIGMA**2
                # Without a prior for each overlapping pixel, gains of 0 would be the best agreement.
                normal[[a, b], [a, b]] += len(at_a) / GAIN_SIGMA**2
                right[[a, b]] += len(at_a) / GAIN_SIGMA**2
            gains[:, channel] = np.linalg.solve(normal, right)
        return gains

    def seam_step(self, images: Sequence[Image], gains: Floats | None = None) -> float:
        """Return the median difference (of 255) of mean levels of neighbouring images where they overlap, or NaN."""
        steps: list[float] = []
        images = self._rgb(images)
        factors = np.ones((len(images), 3)) if gains is None else gains
        for a, b, at_a, at_b in self.overlaps:
            mean_a = (images[a][at_a[:, 1], at_a[:, 0]] * factors[a]).mean()
            mean_b = (images[b][at_b[:, 1], at_b[:, 0]] * factors[b]).mean()
            steps.append(255 / _white_level(images[a]) * abs(float(mean_a - mean_b)))
        return float(np.median(steps)) if steps else float("nan")

    def _rgb(self, images: Sequence[Image]) -> list[Image]:
        """Return images as contiguous (H, W, 3); raise `ValueError` if their types differ."""
        if len({image.dtype for image in images}) > 1:
            types = ", ".join(f"{name} {image.dtype}" for name, image in zip(self.rig.names, images, strict=True))
            raise ValueError(f"the images are of different types ({types}): convert them to one")
        return [_rgb(image) for image in images]

    def _samples(self) -> tuple[NDArray[np.int64], tuple[NDArray[Any], ...]]:
        """Return the first sample of each view pixel, and the table of samples; see the kernel."""
        pixel, table = list[NDArray[Any]](), list[tuple[NDArray[Any], ...]]()
        for k, (m, weight) in enumerate(zip(self.maps, self.weights, strict=True)):
            used = np.flatnonzero(weight.ravel() >= MIN_WEIGHT)
            level = np.clip(np.rint(np.log2(np.maximum(m.scale.ravel()[used], 1.0))), 0, len(self._sizes[k]) - 1)
            level = level.astype(int)
            size = np.array(self._sizes[k])[level]
            # pyrDown keeps every second pixel, so coordinates are halved without an offset.
            at = np.clip(m.pixels.reshape(-1, 2)[used] / 2.0 ** level[:, None], 0, size - 1 - 1e-3)
            whole = np.minimum(at.astype(int), size - 2)
            fraction = np.minimum((at - whole) * 256, 255).astype(np.uint8)
            stride = np.array(self._widths[k])[level]
            index = np.array(self._offsets[k])[level] + whole[:, 1] * stride + whole[:, 0]
            camera = np.full(len(used), k, np.uint8)
            weights = weight.ravel()[used].astype(np.float32)
            pixel.append(used)
            table.append(
                (index.astype(np.int32), stride.astype(np.int32), fraction[:, 0], fraction[:, 1], weights, camera)
            )
        pixels = np.concatenate(pixel)
        order = np.argsort(pixels, kind="stable")
        counts = np.bincount(pixels, minlength=self.shape[0] * self.shape[1])
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        columns = zip(*table, strict=True)
        return first, tuple(np.ascontiguousarray(np.concatenate(column)[order]) for column in columns)

    def _buffer(self, images: Sequence[Image]) -> Image:
        """Return the pixels of all images and their reduced copies (N, 3)."""
        import cv2

        buffer = np.empty((self._offsets[-1][-1] + int(np.prod(self._sizes[-1][-1])), 3), images[0].dtype)

        def fill(low: int, high: int) -> None:
            for k in range(low, high):
                current = images[k]
                for offset, (width, height) in zip(self._offsets[k], self._sizes[k], strict=True):
                    target = buffer[offset : offset + width * height].reshape(height, width, 3)
                    if current is images[k] and offset == self._offsets[k][0]:
                        target[...] = current
                    else:
                        cv2.pyrDown(current, dst=target)
                    current = target

        parallel_for(fill, len(images), 1)
        return buffer

    def _overlap_samples(self) -> list[tuple[int, int, NDArray[np.int_], NDArray[np.int_]]]:
        """Return for each pair of cameras the image pixels (N, 2) that both see of the same points, near the seam."""
        samples: list[tuple[int, int, NDArray[np.int_], NDArray[np.int_]]] = []
        for a in range(len(self.maps)):
            for b in range(a + 1, len(self.maps)):
                both = np.flatnonzero((self.weights[a] > 0) & (self.weights[b] > 0))
                both = both[:: 1 + len(both) // MAX_OVERLAP_SAMPLES]
                if len(both):
                    at = [self._nearest(k, both) for k in (a, b)]
                    samples.append((a, b, at[0], at[1]))
        return samples

    def _nearest(self, camera: int, pixels: NDArray[np.int_]) -> NDArray[np.int_]:
        at = np.rint(self.maps[camera].pixels.reshape(-1, 2)[pixels]).astype(int)
        return np.clip(at, 0, np.array(self.rig.cameras[camera].size) - 1)


def camera_map(rig: Rig, camera: int, points: Array, mask: Mask | None = None) -> CameraMap:
    """Return where one camera of a rig sees points (H, W, 3) of the rig frame."""
    sensor, pose = rig.cameras[camera], rig.sensor_from_rig[camera]
    in_sensor = pose @ points
    pixels, valid = sensor.project(in_sensor)
    visible = valid & sensor.in_image(pixels) & sensor.calibrated(in_sensor)
    if mask is not None:
        at = np.rint(np.where(visible[..., None], pixels, 0)).astype(int)
        at = np.clip(at, 0, np.array(sensor.size) - 1)
        visible &= mask[at[..., 1], at[..., 0]]
    with np.errstate(invalid="ignore"):
        across, down = np.gradient(pixels, axis=1), np.gradient(pixels, axis=0)
        scale = np.maximum(np.linalg.norm(across, axis=-1), np.linalg.norm(down, axis=-1))
        area = np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])
    finite = np.isfinite(scale) & np.isfinite(area)
    visible &= finite
    fill = np.where(visible, scale, 1.0).astype(np.float32), np.where(visible, area, 0.0).astype(np.float32)
    return CameraMap(np.where(visible[..., None], pixels, np.nan).astype(np.float32), visible, *fill)


def _pyramid_layout(rig: Rig) -> tuple[list[list[int]], list[list[int]], list[list[tuple[int, int]]]]:
    """Return offset, width and size of each pyramid level of each camera in the common buffer."""
    offsets, widths, sizes, at = list[list[int]](), list[list[int]](), list[list[tuple[int, int]]](), 0
    for camera in rig.cameras:
        levels = [camera.size]
        while len(levels) < MAX_LEVELS and min(levels[-1]) >= 4:
            levels.append(((levels[-1][0] + 1) // 2, (levels[-1][1] + 1) // 2))
        starts: list[int] = []
        for width, height in levels:
            starts.append(at)
            at += width * height
        offsets.append(starts)
        widths.append([width for width, _ in levels])
        sizes.append(levels)
    return offsets, widths, sizes


def _white_level(image: Image) -> float:
    """Return the level of white: the largest one of an integer type, else 1."""
    return float(np.iinfo(image.dtype).max) if np.issubdtype(image.dtype, np.integer) else 1.0


def _rgb(image: Image) -> Image:
    """Return an image as contiguous (H, W, 3)."""
    color = image[..., None] if image.ndim == 2 else image[..., :3]
    return np.ascontiguousarray(np.broadcast_to(color, (*color.shape[:2], 3)) if color.shape[2] == 1 else color)
