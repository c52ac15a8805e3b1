"""Remapping of video frames: luma and chroma are sampled as they are stored, without a conversion to RGB."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.images.planes import Yuv
from omnisight.parallel import parallel_for
from omnisight.views.maps import is_periodic, map_scale, view_map
from omnisight.views.remapper import MIN_PREFILTER_LEVEL, SCALE_STEP_PX, Interpolation

Floats = NDArray[np.float32]
Plane = NDArray[Any]
# Samples rows of a plane, from the first to before the last.
RowLoop = Callable[[int, int], None]

# Rows of luma below which a second thread does not pay.
GRAIN_ROWS = 32
# Reduced copies of a plane: a 64-fold reduction covers views of any useful scale.
MAX_LEVELS = 7


class FrameRemapper:
    """Remaps frames of a clip to a view.

    Attributes
    ----------
    source, target
        The camera of the clip and the camera of the view, both of even size.
    mask
        (H, W) bool: pixels of the view that the source covers.
    """

    def __init__(
        self,
        source: Camera,
        target: Camera,
        target_from_source: NDArray[np.float64],
        *,
        interpolation: Interpolation = "bilinear",
        antialias: bool = True,
    ) -> None:
        self.source, self.target = source, target
        u, v = view_map(source, target, target_from_source)
        with np.errstate(invalid="ignore"):
            self.mask = (u >= -0.5) & (u < source.width - 0.5) & (v >= -0.5) & (v < source.height - 0.5)
        level = pyramid_level(source, u, v, self.mask) if antialias and interpolation != "nearest" else None
        self._luma = _plane_map(u, v, source.size, level, interpolation)
        # A chroma sample is between two rows of luma, in H.264 and its successors in line with their left column.
        half = ((source.width + 1) // 2, (source.height + 1) // 2)
        below = u[1::2, ::2], v[1::2, ::2]
        rows, columns = below[0].shape
        u, v = u[::2, ::2][:rows, :columns], v[::2, ::2][:rows, :columns]
        du, dv = below[0] - u, below[1] - v
        u, v = u + 0.5 * du, np.asarray(v + 0.5 * dv, np.float32)
        if is_periodic(source):
            u -= 0.5 * source.width * np.round(du / source.width)  # the two rows may be on both sides of the seam
            u = (u + 0.5) % source.width - 0.5
        self._chroma = _plane_map(
            0.5 * np.asarray(u, np.float32),
            0.5 * v - 0.25,
            half,
            None if level is None else level[1::2, ::2],
            interpolation,
        )

    def __call__(self, frame: Yuv) -> Yuv:
        """Return the view of a frame; uncovered pixels are black."""
        view = Yuv.empty(self.target.size, frame)
        (luma, *chroma), targets, (black, gray) = frame.planes, view.planes, frame.black
        sample_luma = self._luma.sampler(luma, self.source.size, black, targets[0])
        sample_chroma = [
            self._chroma.sampler(plane, self._chroma.size, gray, target)
            for plane, target in zip(chroma, targets[1:], strict=True)
        ]

        def sample_rows(low: int, high: int) -> None:
            sample_luma(2 * low, 2 * high)
            for sample in sample_chroma:
                sample(low, high)

        parallel_for(sample_rows, self.target.height // 2, GRAIN_ROWS // 2)
        return view


@dataclass(frozen=True, eq=False)
class PackedMap:
    """A map of one plane, bilinear or of the nearest pixel."""

    size: tuple[int, int]
    index: NDArray[np.uint32]
    fraction: NDArray[np.uint16]

    def sampler(self, plane: Plane, size: tuple[int, int], border: int, target: Plane) -> RowLoop:
        """Return the loop that samples rows of a target plane."""
        from omnisight.views._plane_kernel import sample_plane

        stride, value = np.uint64(plane.shape[1]), np.int32(border)
        arguments = _pairs(plane), stride, self.index, self.fraction, value
        return lambda low, high: sample_plane(*arguments, low, high, target)


@dataclass(frozen=True, eq=False)
class PyramidMap:
    """A map of one plane where the view is smaller: each pixel is interpolated in two levels of a pyramid."""

    size: tuple[int, int]
    layout: NDArray[np.int64]
    index: NDArray[np.uint32]
    fraction: NDArray[np.uint16]

    def sample(self, plane: Plane, size: tuple[int, int], border: int, target: Plane) -> None:
        """Sample a target plane."""
        parallel_for(self.sampler(plane, size, border, target), len(self.index), GRAIN_ROWS)

    def sampler(self, plane: Plane, size: tuple[int, int], border: int, target: Plane) -> RowLoop:
        """Return the loop that samples rows of a target plane."""
        import cv2

        from omnisight.views._plane_kernel import sample_pyramid

        buffer = np.empty(self._end, plane.dtype)
        current: Plane = plane[: size[1], : size[0]]
        for k, (offset, width, height) in enumerate(self.layout.tolist()):
            level = buffer[offset : offset + width * height].reshape(height, width)
            level[...] = current if k == 0 else cv2.pyrDown(current)
            current = level
        arguments = buffer, self.index, self.fraction, np.int32(border)
        return lambda low, high: sample_pyramid(*arguments, low, high, target)

    @property
    def _end(self) -> int:
        offset, width, height = self.layout[-1].tolist()
        return offset + width * height


@dataclass(frozen=True, eq=False)
class KernelMap:
    """A map of one plane for the bicubic and Lanczos kernels of OpenCV."""

    size: tuple[int, int]
    maps: tuple[Any, Any]
    mask: NDArray[np.bool_]
    flag: int

    def sampler(self, plane: Plane, size: tuple[int, int], border: int, target: Plane) -> RowLoop:
        """Return the loop that samples rows of a target plane."""
        import cv2

        source = plane[: size[1], : size[0]]
        width, value = self.mask.shape[1], np.asarray(border, plane.dtype)

        def sample(low: int, high: int) -> None:
            columns, fractions = (each[low:high] for each in self.maps)
            view: Any = cv2.remap(source, columns, fractions, self.flag, borderMode=cv2.BORDER_REPLICATE)
            target[low:high, :width] = np.where(self.mask[low:high], view, value)

        return sample


def packed_map(u: Floats, v: Floats, size: tuple[int, int], *, is_nearest: bool = False) -> PackedMap:
    """Return the map of a plane of a size for pixels u, v (H, W), NaN where uncovered."""
    from omnisight.views._plane_kernel import pack_map

    index, fraction = np.empty(u.shape, np.uint32), np.empty(u.shape, np.uint16)
    arguments = u, v, size, is_nearest, index, fraction
    parallel_for(lambda low, high: pack_map(*arguments, low, high), len(u), GRAIN_ROWS)
    return PackedMap(size, index, fraction)


def pyramid_map(u: Floats, v: Floats, size: tuple[int, int], level: Floats) -> PyramidMap:
    """Return the map of a plane of a size, interpolated at pyramid levels (H, W)."""
    from omnisight.views._plane_kernel import pack_pyramid

    layout = _pyramid_layout(size, int(np.ceil(level.max())))
    index, fraction = np.empty((*u.shape, 2), np.uint32), np.empty((*u.shape, 5), np.uint16)
    arguments = u, v, np.ascontiguousarray(level), layout, index, fraction
    parallel_for(lambda low, high: pack_pyramid(*arguments, low, high), len(u), GRAIN_ROWS)
    return PyramidMap(size, layout, index, fraction)


def _plane_map(
    u: Floats, v: Floats, size: tuple[int, int], level: Floats | None, interpolation: Interpolation
) -> PackedMap | PyramidMap | KernelMap:
    """Return the map of a plane of a size."""
    if level is not None:
        return pyramid_map(u, v, size, level)
    if interpolation in ("nearest", "bilinear"):
        return packed_map(u, v, size, is_nearest=interpolation == "nearest")
    import cv2

    with np.errstate(invalid="ignore"):
        mask = (u >= -0.5) & (u < size[0] - 0.5) & (v >= -0.5) & (v < size[1] - 0.5)
    maps = cv2.convertMaps(np.where(mask, u, 0), np.where(mask, v, 0), cv2.CV_16SC2)
    flag = cv2.INTER_CUBIC if interpolation == "bicubic" else cv2.INTER_LANCZOS4
    return KernelMap(size, (maps[0], maps[1]), mask, flag)


def _pairs(plane: Plane) -> NDArray[Any]:
    """Return two neighbouring pixels of a plane each as one integer, without a copy."""
    dtype = np.uint16 if plane.dtype == np.uint8 else np.uint32
    return np.ndarray((plane.size - 1,), dtype, plane, strides=(plane.itemsize,))


def pyramid_level(source: Camera, u: Floats, v: Floats, mask: NDArray[np.bool_]) -> Floats | None:
    """Return the pyramid level (H, W) of each pixel; None if the view is nowhere much smaller than the source.

    Pixels u, v (H, W) outside the mask (H, W) have no effect.
    """
    scale = map_scale(source, u, v, SCALE_STEP_PX)
    scale = np.where(mask[::SCALE_STEP_PX, ::SCALE_STEP_PX] & np.isfinite(scale), np.maximum(scale, 1), 1)
    level = np.log2(scale).astype(np.float32)
    if level.max() < MIN_PREFILTER_LEVEL:
        return None
    import cv2

    return np.asarray(cv2.resize(np.minimum(level, MAX_LEVELS - 1), u.shape[::-1]), np.float32)


def _pyramid_layout(size: tuple[int, int], coarsest: int) -> NDArray[np.int64]:
    """Return offset, width and height of each level of a pyramid in one buffer."""
    levels = [(0, *size)]
    while len(levels) <= coarsest and min(levels[-1][1:]) >= 4:
        offset, width, height = levels[-1]
        levels.append((offset + width * height, (width + 1) // 2, (height + 1) // 2))
    return np.array(levels, np.int64)
