"""Stitching of the frames of clips: luma and chroma are sampled, corrected and blended as they are stored."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.images.planes import Plane, Yuv
from omnisight.parallel import parallel_for
from omnisight.views.frame_remapper import PyramidMap, packed_map, pyramid_map
from omnisight.views.stitching.blending import REDUCTION, Blender
from omnisight.views.stitching.photometry import DISPLAY_GAMMA
from omnisight.views.stitching.sampling import Mask, Sampler, reduction_level
from omnisight.views.stitching.seam_plan import SeamPlan, label_map

Floats = NDArray[np.float32]

# Weights of red and blue in luma (BT.709 and BT.601), and the number of BT.709 in FFmpeg.
LUMA_WEIGHTS, BT709 = {True: (0.2126, 0.0722), False: (0.299, 0.114)}, 1
# Blocks of 2x2 pixels of several cameras.
MIXED = 255
# Corrections of coarse bands below this share of a grey level are not added.
MIN_CORRECTION = 0.02
GRAIN_ROWS = 8


class FrameStitcher:
    """Applies a plan to frames of simultaneous clips.

    Attributes
    ----------
    covered
        (H, W) pixels of the sphere that a camera shows.
    """

    def __init__(self, plan: SeamPlan, bearings: NDArray[Any]) -> None:
        """Compute the packed maps, gains and weights of the directions (H, W, 3) of a sphere."""
        self._plan = plan
        self._size = bearings.shape[1], bearings.shape[0]
        maps = [_visible_map(sampler, bearings) for sampler in plan.samplers]
        seen = [np.isfinite(u) for u, _ in maps]
        self.covered: Mask = np.logical_or.reduce(seen)
        self._blender = Blender(label_map(plan.seams, seen, bearings), seen)
        halves = [_chroma_map(u, v) for u, v in maps]
        self._planes = [
            _PlaneMaps(s.camera, luma, chroma, weight > 0)
            for s, luma, chroma, weight in zip(plan.samplers, maps, halves, self._blender.weights, strict=True)
        ]
        self._gain = np.stack([self._vignetting(k, u, v) for k, (u, v) in enumerate(halves)])
        self._weight = np.stack([np.rint(64 * w).astype(np.uint8) for w in self._blender.weights])
        self._kind = self._single_camera()
        self._coarse = [self._coarse_maps(k, u, v) for k, (u, v) in enumerate(maps)]
        packed = [[maps.luma for maps in self._planes], [maps.chroma for maps in self._planes]]
        self._index = [np.stack([m.index for m in of_cameras]) for of_cameras in packed]
        self._fraction = [np.stack([m.fraction for m in of_cameras]) for of_cameras in packed]

    def __call__(self, frames: Sequence[Yuv]) -> Yuv:
        """Stitch simultaneous frames of all cameras; a frame with several cameras side by side is given for each."""
        from omnisight.views.stitching._frame_kernel import stitch_planes

        sphere = Yuv.empty(self._size, frames[0])
        colors = self._colors(frames[0])
        sources: list[Any] = []
        strides: list[int] = []
        for k, frame in enumerate(frames):
            for p, (plane, offset) in enumerate(zip(frame.planes, self._offsets(k, frames), strict=True)):
                source, stride = self._planes[k].source(p, plane, offset, frame.black[min(p, 1)])
                sources.append(source)
                strides.append(stride)
        low = self._correction(frames, colors)
        black, gray = frames[0].black
        limits = np.float32(black), np.float32(gray), np.float32(2 ** frames[0].depth - 1)
        arguments = (
            tuple(sources),
            np.array(strides, np.uint64),
            (self._index[0], self._fraction[0], self._weight),
            (self._index[1], self._fraction[1], self._gain),
            self._kind,
            colors,
            low,
            limits,
        )
        planes = sphere.planes
        parallel_for(lambda a, b: stitch_planes(*arguments, a, b, planes), self._size[1] // 2, GRAIN_ROWS)
        return sphere

    def _offsets(self, camera: int, frames: Sequence[Yuv]) -> tuple[int, int, int]:
        """Return the columns at which the image of a camera starts in the planes of its frame."""
        width = self._plan.samplers[camera].camera.width
        start = camera * width if frames[camera].size[0] >= 2 * width else 0
        return start, start // 2, start // 2

    def _colors(self, like: Yuv) -> Floats:
        """Return the matrices (K, 3, 3) by which luma and chroma change if red, green and blue get gains."""
        red, blue = LUMA_WEIGHTS[like.frame.colorspace == BT709]
        scale = np.array([1.0, 1.0, 1.0]) if like.is_full_range else np.array([219 / 255, 224 / 255, 224 / 255])
        luma = np.array([red, 1 - red - blue, blue])
        yuv_from_rgb = np.stack([luma, ([0, 0, 1] - luma) / (2 * (1 - blue)), ([1, 0, 0] - luma) / (2 * (1 - red))])
        yuv_from_rgb *= scale[:, None]
        gains = np.exp(-self._plan.photometry.log_gain / DISPLAY_GAMMA)
        inverse = np.linalg.inv(yuv_from_rgb)
        return np.stack([yuv_from_rgb @ np.diag(g) @ inverse for g in gains]).astype(np.float32)

    def _vignetting(self, camera: int, u: Floats, v: Floats) -> NDArray[np.uint16]:
        """Return the factor of all colours, 1/4096, at chroma pixels (h, w) of a camera's map."""
        return np.clip(np.rint(4096 * self._falloff(camera, 2 * u, 2 * v + 0.5)), 0, 65535).astype(np.uint16)

    def _falloff(self, camera: int, u: Floats, v: Floats) -> Floats:
        sampler = self._plan.samplers[camera]
        radius = sampler.relative_radius(np.nan_to_num(np.stack([u, v], -1)))
        return self._plan.photometry.falloff(radius)

    def _single_camera(self) -> NDArray[np.uint8]:
        """Return the camera that shows each block of 2x2 pixels alone, or MIXED."""
        height, width = self._weight.shape[1] // 2, self._weight.shape[2] // 2
        blocks = self._weight[:, : 2 * height, : 2 * width].reshape(-1, height, 2, width, 2).min((2, 4))
        return np.where(blocks.max(0) == 64, blocks.argmax(0), MIXED).astype(np.uint8)

    def _coarse_maps(self, camera: int, u: Floats, v: Floats) -> tuple[Any, Any, Floats]:
        """Return the maps of luma and chroma and the vignetting at the reduced resolution of the coarse bands."""
        size = self._plan.samplers[camera].camera.size
        middle = slice(REDUCTION // 2, None, REDUCTION)
        u, v = (np.ascontiguousarray(m[middle, middle] - np.float32(0)) for m in (u, v))
        with np.errstate(invalid="ignore"):
            across = np.hypot(np.gradient(u, axis=1), np.gradient(v, axis=1))
            down = np.hypot(np.gradient(u, axis=0), np.gradient(v, axis=0))
        scale = np.nan_to_num(np.fmax(across, down), nan=float(REDUCTION))
        level = np.log2(np.maximum(scale, 1)).astype(np.float32)
        half = (size[0] + 1) // 2, (size[1] + 1) // 2
        chroma = pyramid_map(0.5 * u, 0.5 * v - np.float32(0.25), half, np.maximum(level - 1, 0))
        return pyramid_map(u, v, size, level), chroma, self._falloff(camera, u, v)

    def _correction(self, frames: Sequence[Yuv], colors: Floats) -> Floats:
        """Return what blending the coarse bands changes (h, w, 3)."""
        black, gray = frames[0].black

        def reduced(camera: int) -> Floats:
            luma, chroma, falloff = self._coarse[camera]
            layers = np.zeros((*falloff.shape, 3), np.float32)
            for p, (plane, offset) in enumerate(zip(frames[camera].planes, self._offsets(camera, frames), strict=True)):
                target = np.empty(falloff.shape, plane.dtype)
                coarse, empty = (chroma, gray) if p else (luma, black)
                coarse.sample(plane[:, offset:], coarse.size, empty, target)
                layers[..., p] = target.astype(np.float32) - empty
            return np.asarray(layers @ colors[camera].T * falloff[..., None], np.float32)

        found = self._blender.correction([reduced(k) for k in range(len(frames))])
        return np.where(np.abs(found) < MIN_CORRECTION, np.float32(0), found)


class _PlaneMaps:
    """Maps of the planes of a camera for the compiled pass.

    Where the sphere is smaller than the image, planes are first sampled from a pyramid at the pixels of the sphere: the
    maps are then those of equal pixels.
    """

    def __init__(self, camera: Camera, luma: tuple[Floats, Floats], chroma: tuple[Floats, Floats], shown: Mask) -> None:
        half = (camera.width + 1) // 2, (camera.height + 1) // 2
        level = reduction_level(camera, *luma, shown)
        self._pyramids: list[PyramidMap] = []
        if level is not None:
            below = np.ascontiguousarray(level[1::2, ::2])
            self._pyramids = [pyramid_map(*luma, camera.size, level), pyramid_map(*chroma, half, below)]
            luma, chroma = _equal_pixels(luma[0]), _equal_pixels(chroma[0])
        sizes = (camera.size, half) if level is None else (luma[0].shape[::-1], chroma[0].shape[::-1])
        self.luma, self.chroma = packed_map(*luma, sizes[0]), packed_map(*chroma, sizes[1])

    def source(self, index: int, plane: Plane, offset: int, empty: int) -> tuple[Plane, int]:
        """Return the flat pixels that the maps sample, and the pixels per row, of a plane from a column on."""
        if not self._pyramids:
            return plane.ravel()[offset:], plane.shape[1]
        pyramid = self._pyramids[min(index, 1)]
        target = np.empty(pyramid.index.shape[:2], plane.dtype)
        pyramid.sample(plane[:, offset:], pyramid.size, empty, target)
        return target.ravel(), pyramid.index.shape[1]


def _equal_pixels(u: Floats) -> tuple[Floats, Floats]:
    """Return the map (H, W) of each pixel to itself, NaN where u is."""
    rows, columns = np.indices(u.shape, np.float32)
    unseen = np.isnan(u)
    return np.where(unseen, u, columns), np.where(unseen, u, rows)


def _visible_map(sampler: Sampler, bearings: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return the map (H, W) of a camera, NaN where it sees nothing."""
    u, v, seen = sampler.map(bearings)
    return np.where(seen, u, np.float32(np.nan)), np.where(seen, v, np.float32(np.nan))


def _chroma_map(u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return the map of the chroma planes: samples in line with the left column of luma, between two rows."""
    middle = [0.5 * (m[::2, ::2] + m[1::2, ::2]) for m in (u, v)]
    return 0.5 * middle[0], 0.5 * middle[1] - np.float32(0.25)
