"""Remapping of an image from its camera to any other camera."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.array_kinds import like, to_numpy
from omnisight.camera import Camera
from omnisight.rig import Rig
from omnisight.views.image_size import size_mismatch
from omnisight.views.maps import coverage_mask, is_periodic, map_scale, reduced_view, view_map
from omnisight.views.rig_view import remap_rig
from omnisight.views.view_cameras import MAX_SIDE_PX

Image = NDArray[Any]
Interpolation = Literal["nearest", "bilinear", "bicubic", "lanczos"]
Border = float | Sequence[float] | Literal["edge", "reflect"]

# Columns by which a periodic image is extended on each side, on the coarsest pyramid level used: covers all kernels.
WRAP_COLUMNS = 8
# Views with a smaller reduction (log2 of the scale) need no prefilter; aliasing is not visible below.
MIN_PREFILTER_LEVEL = 0.35
# Spacing of the pixels at which the scale of a map is sampled.
SCALE_STEP_PX = 8
# Coordinate of pixels that the source does not cover; far outside every image.
OUTSIDE_PX = -9999.0


def remap(
    image: Image | Sequence[Image],
    source: Camera | Rig,
    target: Camera,
    target_from_source: ArrayLike | None = None,
    *,
    interpolation: Interpolation = "bilinear",
    border: Border = 0.0,
    antialias: bool = True,
    distance: float = float("inf"),
) -> Image:
    """Remap an image from its camera, or the images of a rig, to another camera.

    Parameters
    ----------
    image
        (H, W) or (H, W, 1 to 4), or a batch of images (N, H, W) or (N, H, W, 1 to 4), uint8, uint16 or float, taken by
        `source`. A list of images is stacked to a batch. Arrays of other libraries, such as PyTorch tensors, are
        answered in their kind, without gradients. Of a rig: the simultaneous images of its cameras, in their order.
    source, target
        The camera of the image, or the rig, and the camera of the view. The cameras of a rig are blended where their
        fields of view overlap, each where it resolves the scene best.
    target_from_source
        (3, 3) rotation of bearings from source to view (see `look`); the identity by default.
    interpolation
        Interpolation between source pixels.
    border
        Pixels that the source does not cover: a value (or one per channel), or "edge" or "reflect" to extrapolate by
        half a pixel and set the rest to 0.
    antialias
        Average source pixels where the view is smaller than the source.
    distance
        Of a rig: distance of the scene from its origin, in its unit. Other distances have parallax at the seams.

    Returns
    -------
    The view, with the type and the channels of the image.

    Raises
    ------
    ValueError
        If the size of an image differs from that of its camera, or an option is not for rigs.
    """
    if isinstance(source, Rig):
        if interpolation != "bilinear" or border != 0.0 or not antialias:
            raise ValueError("images of a rig are remapped with bilinear interpolation, antialiasing and a border of 0")
        return remap_rig([to_numpy(each) for each in image], source, target, target_from_source, distance=distance)
    if distance != float("inf"):
        raise ValueError("distance is for rigs: the view of one central camera does not depend on it")
    return Remapper(
        source, target, target_from_source, interpolation=interpolation, border=border, antialias=antialias
    )(image)


class Remapper:
    """A remap with a precomputed map, for videos and folders of images.

    Attributes
    ----------
    source, target, target_from_source, border
        The arguments.
    mask
        (H, W) bool: pixels of the view that the source covers.
    scale
        (min, max) number of source pixels that a view pixel spans.
    """

    def __init__(
        self,
        source: Camera,
        target: Camera,
        target_from_source: ArrayLike | None = None,
        *,
        interpolation: Interpolation = "bilinear",
        border: Border = 0.0,
        antialias: bool = True,
    ) -> None:
        import cv2

        flags = {
            "nearest": cv2.INTER_NEAREST,
            "bilinear": cv2.INTER_LINEAR,
            "bicubic": cv2.INTER_CUBIC,
            "lanczos": cv2.INTER_LANCZOS4,
        }
        if interpolation not in flags:
            raise ValueError(f"interpolation must be one of {', '.join(flags)}, got {interpolation!r}")
        if isinstance(border, str) and border not in ("edge", "reflect"):
            raise ValueError(f"border must be a value, 'edge' or 'reflect', got {border!r}")
        rotation = np.eye(3) if target_from_source is None else np.asarray(target_from_source, float)
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
            raise ValueError(f"target_from_source must be an orthogonal (3, 3) matrix, got shape {rotation.shape}")
        self.source, self.target, self.border = source, target, border
        self.target_from_source = rotation
        self._flag = flags[interpolation]
        u, v = view_map(source, target, rotation)
        self.mask = coverage_mask(source, u, v)
        scale = map_scale(source, u, v, SCALE_STEP_PX)
        covered = scale[self.mask[::SCALE_STEP_PX, ::SCALE_STEP_PX] & np.isfinite(scale)]
        self.scale = (float(covered.min()), float(covered.max())) if covered.size else (1.0, 1.0)
        u, v = np.where(self.mask, u, OUTSIDE_PX), np.where(self.mask, v, OUTSIDE_PX)
        reduction = np.log2(max(self.scale[1], 1.0))
        prefilter = antialias and interpolation != "nearest" and reduction >= MIN_PREFILTER_LEVEL
        level = self._pyramid_level(scale) if prefilter else None
        self._padding = (
            WRAP_COLUMNS * 2 ** (0 if level is None else int(np.ceil(level.max()))) if is_periodic(source) else 0
        )
        self._levels = self._build(u, v, level)

    def __repr__(self) -> str:
        """Return the sizes of both images."""
        return f"Remapper({self.source.width}x{self.source.height} to {self.target.width}x{self.target.height})"

    def __call__(self, image: Image | Sequence[Image]) -> Image:
        """Remap an image of the source, or a batch; see `remap`."""
        if isinstance(image, list | tuple):
            return self._remap_list(image)
        array: Image = to_numpy(image)
        if not self._is_batch(array):
            return like(image, self._remap(array))
        shape = (len(array), self.target.height, self.target.width, *array.shape[3:])
        views = np.empty(shape, array.dtype)
        for k, single in enumerate(array):
            views[k] = self._remap(single)
        return like(image, views)

    def _remap_list(self, images: Sequence[Image]) -> Image:
        """Remap a list of images to a batch."""
        if not images or not all(hasattr(image, "shape") for image in images):
            raise ValueError("image must be an array or a list of images that are arrays: convert it by np.asarray")
        arrays: list[Image] = [to_numpy(image) for image in images]
        shapes = {array.shape for array in arrays}
        if len(shapes) > 1:
            raise ValueError(f"the images of a list must have one shape, got {', '.join(map(str, sorted(shapes)))}")
        return like(images[0], np.stack([self._remap(array) for array in arrays]))

    def _is_batch(self, array: Image) -> bool:
        """Return whether an array has several images; (N, H, W) differs from (H, W, C) by the size of the source."""
        is_gray = array.ndim == 3 and array.shape[2] > 4 and array.shape[1:] == self.source.size[::-1]
        return array.ndim == 4 or is_gray

    def _remap(self, image: Image) -> Image:
        """Remap one image."""
        import cv2

        padded = self._check(image)
        if self._padding:
            padded = cv2.copyMakeBorder(padded, 0, 0, self._padding, self._padding, cv2.BORDER_WRAP)
            padded = cv2.copyMakeBorder(padded, self._padding, self._padding, 0, 0, cv2.BORDER_REPLICATE)
        mode, value = self._border_mode(cv2)
        if len(self._levels) == 1 and self._levels[0][1] is None:
            _, _, first, second, _ = self._levels[0]
            result = cv2.remap(padded, first, second, self._flag, borderMode=mode, borderValue=value)
            return self._finish(result, image)
        channels = padded.shape[2:]
        total = np.zeros((self.target.height, self.target.width, *channels), np.float32)
        current, reached = padded, 0
        # The last pixel of a coarse level is up to one of its pixels inside the image: do not blend it with the border.
        inside = cv2.BORDER_REPLICATE if mode == cv2.BORDER_CONSTANT else mode
        for level, weight, first, second, rows in self._levels:
            while reached < level:
                current, reached = cv2.pyrDown(current), reached + 1
            part = cv2.remap(current, first, second, self._flag, borderMode=inside)
            part = part.reshape(*part.shape[:2], *channels).astype(np.float32)
            total[rows] += part * (weight[..., None] if channels else weight)
        total[~self.mask] = value[: channels[0]] if channels else value[0]
        if np.issubdtype(image.dtype, np.integer):
            limits = np.iinfo(image.dtype)
            total = np.clip(np.rint(total), limits.min, limits.max)
        return self._finish(total.astype(image.dtype), image)

    def _pyramid_level(self, scale: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the fractional pyramid level (H, W) from which each view pixel is interpolated."""
        import cv2

        coarsest = int(np.log2(max(min(self.source.size), 1)))
        level: Any = np.log2(np.clip(np.nan_to_num(scale, nan=1.0), 1.0, max(self.scale[1], 1.0))).astype(np.float32)
        level = cv2.resize(level, (self.target.width, self.target.height), interpolation=cv2.INTER_LINEAR)
        return np.clip(level, 0, coarsest)

    def _build(self, u: NDArray[np.float32], v: NDArray[np.float32], depth: NDArray[np.float32] | None) -> list[Any]:
        """Return level, weight, fixed-point maps and rows of each pyramid level used."""
        import cv2

        padding = float(self._padding)
        if depth is None:
            # OpenCV truncates fixed-point maps in nearest-neighbour mode unless they are made for it.
            nearest = self._flag == cv2.INTER_NEAREST
            first, second = cv2.convertMaps(u + padding, v + padding, cv2.CV_16SC2, nninterpolation=nearest)
            return [(0, None, first, second, slice(None))]
        levels: list[Any] = []
        for level in range(int(np.floor(depth.min())), int(np.ceil(depth.max())) + 1):
            weight = np.maximum(1 - np.abs(depth - level), 0)
            used = np.flatnonzero(weight.any(1))
            if not used.size:
                continue
            rows = slice(int(used[0]), int(used[-1]) + 1)
            # pyrDown keeps every second pixel, so coordinates are halved without an offset.
            part = [((m[rows] + padding) / 2**level).astype(np.float32) for m in (u, v)]
            part = [np.where(self.mask[rows], p, OUTSIDE_PX).astype(np.float32) for p in part]
            first, second = cv2.convertMaps(part[0], part[1], cv2.CV_16SC2)
            levels.append((level, weight[rows], first, second, rows))
        return levels

    def _check(self, image: Image) -> Image:
        if image.ndim not in (2, 3) or (image.ndim == 3 and not 1 <= image.shape[2] <= 4):
            raise ValueError(
                "image must be (H, W), (H, W, 1 to 4) or a batch (N, H, W) or (N, H, W, 1 to 4), got shape"
                f" {image.shape}"
            )
        if image.dtype.name not in ("uint8", "uint16", "float32", "float64"):
            raise ValueError(f"image must be uint8, uint16, float32 or float64, got {image.dtype}")
        height, width = image.shape[:2]
        if (width, height) != self.source.size:
            raise ValueError(size_mismatch((width, height), self.source.size))
        limit = MAX_SIDE_PX - 2 * self._padding
        if max(width, height) > limit:
            raise ValueError(f"image of {width}x{height} px is too large: width and height must be at most {limit} px")
        return np.ascontiguousarray(image)

    def _border_mode(self, cv2: Any) -> tuple[int, tuple[float, ...]]:
        if isinstance(self.border, str):
            return (cv2.BORDER_REPLICATE if self.border == "edge" else cv2.BORDER_REFLECT_101), (0.0,) * 4
        value = (self.border,) * 4 if isinstance(self.border, int | float) else tuple(self.border)
        return cv2.BORDER_CONSTANT, tuple(float(x) for x in (*value, 0, 0, 0, 0)[:4])

    def _finish(self, result: Image, image: Image) -> Image:
        if isinstance(self.border, str):
            result[~self.mask] = 0
        return result.reshape(*result.shape[:2], *image.shape[2:])


def magnification(source: Camera, target: Camera, target_from_source: NDArray[np.float64]) -> tuple[float, float]:
    """Return the width of a source pixel in the view, px: in the centre and at the edge of the covered area."""
    reduced = reduced_view(target)
    u, v = view_map(source, reduced, target_from_source)
    scale = map_scale(source, u, v) * (reduced.width / target.width)
    covered = coverage_mask(source, u, v)
    rows, columns = np.nonzero(covered & np.isfinite(scale) & (scale > 0))
    if not rows.size:
        return float("nan"), float("nan")
    distance = np.hypot(rows - (scale.shape[0] - 1) / 2, columns - (scale.shape[1] - 1) / 2)
    order = np.argsort(distance)
    count = max(1, len(order) // 100)
    values = 1 / scale[rows, columns]
    return float(np.median(values[order[:count]])), float(np.median(values[order[-count:]]))
