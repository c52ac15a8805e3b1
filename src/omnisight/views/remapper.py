"""The one remap: from any camera's image to any view."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera
from omnisight.views.maps import map_scale, view_map

Image = NDArray[Any]
Interpolation = Literal["nearest", "bilinear", "bicubic", "lanczos"]
Border = float | Sequence[float] | Literal["edge", "reflect"]

# Columns that an image which goes around is continued by on each side, on the coarsest level it is taken from.
AROUND = 8
# A view this little smaller than its source needs no prefilter (log2 of the scale).
SHARP_ENOUGH = 0.35
COARSE = 8
OUTSIDE = -9999.0
LARGEST = 32767  # px a side; what OpenCV's remap takes


def remap(
    image: Image,
    source: Camera,
    target: Camera,
    target_from_source: ArrayLike | None = None,
    *,
    interpolation: Interpolation = "bilinear",
    border: Border = 0.0,
    antialias: bool = True,
) -> Image:
    """Turn an image into a view.

    Parameters
    ----------
    image
        (H, W) or (H, W, 1 to 4), uint8, uint16 or float, taken by `source`.
    source, target
        The camera that took the image, and the view: a camera too.
    target_from_source
        (3, 3) that turns the source's bearings into the view's (`look`); the identity unless told otherwise.
    interpolation
        Between the source's pixels.
    border
        What the source does not show: a value (or one per channel), or "edge" or "reflect" to continue the image half
        a pixel past its edge and leave the rest 0.
    antialias
        Average source pixels where the view is smaller than the source.

    Returns
    -------
    The view, of the image's type and channels.

    Raises
    ------
    ValueError
        If the image's size is not its camera's; the message says how to scale the camera.
    """
    return Remapper(
        source, target, target_from_source, interpolation=interpolation, border=border, antialias=antialias
    )(image)


class Remapper:
    """A remap whose map is kept: for video and folders of images.

    Attributes
    ----------
    source, target, target_from_source, border
        As given.
    mask
        (H, W) bool: which pixels of the view the source shows.
    scale
        (min, max) of how many source pixels a pixel of the view spans.
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
        goes_around = _goes_around(source)
        with np.errstate(invalid="ignore"):
            self.mask = (u >= -0.5) & (u < source.width - 0.5) & (v >= -0.5) & (v < source.height - 0.5)
            if goes_around:  # what rounds over the seam is still there
                self.mask |= (u >= -1.0) & (u <= source.width) & (v >= -0.5) & (v < source.height - 0.5)
        scale = map_scale(source, u, v, COARSE)
        shown = scale[self.mask[::COARSE, ::COARSE] & np.isfinite(scale)]
        self.scale = (float(shown.min()), float(shown.max())) if shown.size else (1.0, 1.0)
        u, v = np.where(self.mask, u, OUTSIDE), np.where(self.mask, v, OUTSIDE)
        sharp = not antialias or interpolation == "nearest" or np.log2(max(self.scale[1], 1.0)) < SHARP_ENOUGH
        depth = None if sharp else self._depth(scale)
        self._around = AROUND * 2 ** (0 if depth is None else int(np.ceil(depth.max()))) if goes_around else 0
        self._levels = self._build(u, v, depth)

    def __call__(self, image: Image) -> Image:
        """Remap an image of the source; see `remap`."""
        import cv2

        picture = self._check(image)
        if self._around:
            picture = cv2.copyMakeBorder(picture, 0, 0, self._around, self._around, cv2.BORDER_WRAP)
            picture = cv2.copyMakeBorder(picture, self._around, self._around, 0, 0, cv2.BORDER_REPLICATE)
        mode, value = self._border_mode(cv2)
        if len(self._levels) == 1 and self._levels[0][1] is None:
            _, _, first, second, _ = self._levels[0]
            result = cv2.remap(picture, first, second, self._flag, borderMode=mode, borderValue=value)
            return self._finish(result, image)
        channels = picture.shape[2:]
        total = np.zeros((self.target.height, self.target.width, *channels), np.float32)
        current, reached = picture, 0
        for level, weight, first, second, rows in self._levels:
            while reached < level:
                current, reached = cv2.pyrDown(current), reached + 1
            part = cv2.remap(current, first, second, self._flag, borderMode=mode, borderValue=value)
            part = part.reshape(*part.shape[:2], *channels).astype(np.float32)
            total[rows] += part * (weight[..., None] if channels else weight)
        if np.issubdtype(image.dtype, np.integer):
            limits = np.iinfo(image.dtype)
            total = np.clip(np.rint(total), limits.min, limits.max)
        return self._finish(total.astype(image.dtype), image)

    def _depth(self, scale: NDArray[np.float32]) -> NDArray[np.float32]:
        """Give the level of the pyramid (H, W), a fraction, that each pixel of the view is to be taken from."""
        import cv2

        deepest = int(np.log2(max(min(self.source.size), 1)))
        depth: Any = np.log2(np.clip(np.nan_to_num(scale, nan=1.0), 1.0, max(self.scale[1], 1.0))).astype(np.float32)
        depth = cv2.resize(depth, (self.target.width, self.target.height), interpolation=cv2.INTER_LINEAR)
        return np.clip(depth, 0, deepest)

    def _build(self, u: NDArray[np.float32], v: NDArray[np.float32], depth: NDArray[np.float32] | None) -> list[Any]:
        import cv2

        around = float(self._around)
        if depth is None:
            # OpenCV rounds fixed-point maps down for the nearest neighbour unless they were made for it.
            nearest = self._flag == cv2.INTER_NEAREST
            first, second = cv2.convertMaps(u + around, v + around, cv2.CV_16SC2, nninterpolation=nearest)
            return [(0, None, first, second, slice(None))]
        levels: list[Any] = []
        for level in range(int(np.floor(depth.min())), int(np.ceil(depth.max())) + 1):
            weight = np.maximum(1 - np.abs(depth - level), 0)
            used = np.flatnonzero(weight.any(1))
            if not used.size:
                continue
            rows = slice(int(used[0]), int(used[-1]) + 1)
            # A pyramid's pixel lies on every second one: coordinates halve without a shift.
            part = [
                (np.where(self.mask[rows], m[rows] + around, OUTSIDE) / 2**level).astype(np.float32) for m in (u, v)
            ]
            part = [np.where(self.mask[rows], p, OUTSIDE).astype(np.float32) for p in part]
            first, second = cv2.convertMaps(part[0], part[1], cv2.CV_16SC2)
            levels.append((level, weight[rows], first, second, rows))
        return levels

    def _check(self, image: Image) -> Image:
        if image.ndim not in (2, 3) or (image.ndim == 3 and not 1 <= image.shape[2] <= 4):
            raise ValueError(f"an image is (H, W) or (H, W, 1 to 4), got shape {image.shape}")
        if image.dtype.name not in ("uint8", "uint16", "float32", "float64"):
            raise ValueError(f"an image is uint8, uint16, float32 or float64, got {image.dtype}")
        height, width = image.shape[:2]
        if (width, height) != self.source.size:
            raise ValueError(size_mismatch((width, height), self.source.size))
        if max(width, height) + 2 * self._around > LARGEST:
            raise ValueError(
                f"an image of {width}x{height} is too large: {LARGEST - 2 * self._around} px a side at most"
            )
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


def _goes_around(source: Camera) -> bool:
    period = source.model.period
    return period is not None and abs(period - source.width) < 0.5


def size_mismatch(found: tuple[int, int], expected: tuple[int, int]) -> str:
    """Say that an image is not of its camera's size, and what to do."""
    if min(expected) < 1:
        return (
            f"the image is {found[0]}x{found[1]}, and the camera's file does not say its size: write it into the file"
        )
    said = f"the image is {found[0]}x{found[1]}, the camera {expected[0]}x{expected[1]}"
    ratios = found[0] / expected[0], found[1] / expected[1]
    if abs(ratios[0] - ratios[1]) < 0.01 * ratios[0]:
        times = f"{ratios[0]:.4g} times as large"
        return f"{said}: the same shape, {times}; if it was resized, scale the camera (--scale-camera)"
    if found == expected[::-1]:
        return f"{said}: turned by 90 degrees; was its EXIF rotation applied?"
    return f"{said}: another shape; a camera is only valid for the images that it was calibrated with"


def magnification(remapper: Remapper) -> tuple[float, float]:
    """Give how many pixels of the view a pixel of the source fills, in its middle and at the rim of what is shown."""
    u, v = view_map(remapper.source, remapper.target, remapper.target_from_source)
    step = max(1, min(u.shape) // 200)
    scale = map_scale(remapper.source, u, v, step)
    scale[~remapper.mask[::step, ::step]] = np.nan
    rows, columns = np.nonzero(np.isfinite(scale) & (scale > 0))
    if not rows.size:
        return float("nan"), float("nan")
    away = np.hypot(rows - (scale.shape[0] - 1) / 2, columns - (scale.shape[1] - 1) / 2)
    order = np.argsort(away)
    few = max(1, len(order) // 100)
    values = 1 / scale[rows, columns]
    return float(np.median(values[order[:few]])), float(np.median(values[order[-few:]]))
