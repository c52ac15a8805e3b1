"""The plan of a stitch: colours, seams and local warps, estimated once from simultaneous images of a rig."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.views.stitching.local_warp import Disparity, SeamWarp, measure_disparity
from omnisight.views.stitching.photometry import OverlapSamples, Photometry, estimate_photometry
from omnisight.views.stitching.sampling import Mask, PolarGrid, Sampler
from omnisight.views.stitching.seams import Seam, find_seam

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

# Columns of the polar grids in which seams are searched, and the fewest rows in which optical flow can be computed.
MIN_SEAM_COLUMNS, MAX_SEAM_COLUMNS, MIN_SEAM_ROWS = 1024, 2048, 32
# Columns of the grid on which overlaps are compared for gains: each pixel averages many of the image.
SAMPLE_COLUMNS = 512
# Range of angles around the axis of a camera in which a seam can be, radians.
MIN_THETA, MAX_THETA = np.radians(10.0), np.radians(150.0)
# Standard deviation, px, of the blur that leaves the photometric step.
STEP_BLUR_PX = 8.0


@dataclass(frozen=True, eq=False)
class SeamQuality(Displayed):
    """Differences of two images in their overlap, after all corrections.

    Attributes
    ----------
    overlap_rms
        Root mean square difference of grey levels of 255.
    photometric_step
        Median absolute difference of blurred grey levels along the seam.
    disparity_px, disparity_deg
        Median displacement along the seam, in pixels of the sphere and degrees.
    unwarped_deg
        The same before the local warp.
    overlap_deg
        Mean width of the overlap.
    """

    overlap_rms: float
    photometric_step: float
    disparity_px: float
    disparity_deg: float
    unwarped_deg: float
    overlap_deg: float


@dataclass(frozen=True, eq=False)
class SeamPlan:
    """Colours, seams and local warps of the images of a rig, which `ImageStitcher` and `FrameStitcher` apply.

    Attributes
    ----------
    samplers
        The cameras with their warps.
    photometry
        Corrections of colours.
    seams
        The seam of each camera but the first, against the first and those before it: each overlaps one of them.
    quality
        Measures of the seam of each camera but the first.
    """

    samplers: list[Sampler]
    photometry: Photometry
    seams: dict[int, Seam]
    quality: list[SeamQuality]

    @property
    def samplers_before_warp(self) -> list[Sampler]:
        """The cameras without the warps of this plan."""
        return [dataclasses.replace(sampler, warps=()) for sampler in self.samplers]


def plan_stitch(samplers: Sequence[Sampler], images: Sequence[Bytes], width: int, *, warp: bool = True) -> SeamPlan:
    """Estimate colours, seams and local warps from simultaneous images.

    Parameters
    ----------
    samplers
        The cameras in the frame of the rig.
    images
        Their images (H, W, 3).
    width
        Width of the sphere for which disparities are stated, px.
    warp
        Whether to warp locally where that reduces the disparity along a seam.
    """
    photometry = estimate_photometry(_overlap_samples(samplers, images), len(samplers))
    current, seams, quality = list(samplers), dict[int, Seam](), dict[int, SeamQuality]()
    while len(seams) < len(current) - 1:
        others = [k for k in range(1, len(current)) if k not in seams]
        k, seam, before, disparity = _fit_seam(current, images, photometry, seams, others, width)
        if warp and disparity.median_px > 0:
            warped = _warped(current, seams, k, seam, disparity)
            _, closer, after, _ = _fit_seam(warped, images, photometry, seams, [k], width)
            if after.disparity_deg < before.disparity_deg:
                seam, current = closer, warped
                before = dataclasses.replace(after, unwarped_deg=before.disparity_deg)
        seams[k], quality[k] = seam, before
    return SeamPlan(current, photometry, seams, [quality[k] for k in sorted(quality)])


def label_map(
    seams: Mapping[int, Seam], seen: Mapping[int, Mask] | Sequence[Mask], bearings: NDArray[Any]
) -> NDArray[np.intp]:
    """Return the camera (H, W) that shows each direction: a camera replaces those before it inside its seam."""
    labels = np.zeros(seen[0].shape, np.intp)
    covered = seen[0].copy()
    for k, seam in seams.items():
        labels[seen[k] & (seam.inside(bearings) | ~covered)] = k
        covered |= seen[k]
    return labels


def _fit_seam(
    samplers: Sequence[Sampler],
    images: Sequence[Bytes],
    photometry: Photometry,
    seams: Mapping[int, Seam],
    others: Sequence[int],
    width: int,
) -> tuple[int, Seam, SeamQuality, Disparity]:
    """Find the seam of one of the other cameras against the first one and those with seams, and measure it."""
    before = [0, *seams]
    k, grid = _next_overlap(samplers, others, before, min(max(MIN_SEAM_COLUMNS, width), MAX_SEAM_COLUMNS))
    bearings = grid.bearings()
    layers = {i: _corrected_layer(samplers[i], images[i], photometry, i, bearings) for i in (*before, k)}
    seen = {i: mask for i, (_, mask) in layers.items()}
    labels = label_map(seams, seen, bearings)
    outer = np.select([(labels == i)[..., None] for i in before], [layers[i][0] for i in before])
    inner, overlap = layers[k][0], np.logical_or.reduce([seen[i] for i in before]) & seen[k]
    seam = find_seam(grid, inner, outer, overlap)
    disparity = measure_disparity(seam, inner, outer, overlap)
    return k, seam, _quality(seam, inner, outer, overlap, disparity, width), disparity


def _corrected_layer(
    sampler: Sampler, image: Bytes, photometry: Photometry, camera: int, bearings: NDArray[Any]
) -> tuple[Bytes, Mask]:
    """Return an image at directions (H, W, 3) with corrected colours, and which of them are seen."""
    import cv2

    u, v, seen = sampler.map(bearings)
    layer = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    factor = photometry.factor(camera, sampler.relative_radius(np.stack([u, v], -1)))
    return np.asarray(cv2.multiply(layer, factor, dtype=cv2.CV_8U), np.uint8), seen


def _polar_grid(sampler: Sampler) -> PolarGrid:
    """Return a coarse polar grid around the axis of a camera."""
    return PolarGrid.around(sampler.axis, float(MIN_THETA), float(MAX_THETA), 256)


def _next_overlap(
    samplers: Sequence[Sampler], others: Sequence[int], before: Sequence[int], columns: int
) -> tuple[int, PolarGrid]:
    """Return the first other camera that overlaps those before it, and a polar grid that covers the overlap.

    Raises
    ------
    ValueError
        If none does.
    """
    for k in others:
        if (grid := _overlap_grid(samplers, k, before, columns)) is not None:
            return k, grid
    raise ValueError(_no_overlap(samplers, others[0], before))


def _overlap_grid(samplers: Sequence[Sampler], k: int, before: Sequence[int], columns: int) -> PolarGrid | None:
    """Return a polar grid around the axis of camera k that covers its overlap with those before it, if there is any."""
    coarse = _polar_grid(samplers[k])
    bearings = coarse.bearings()
    overlap = np.logical_or.reduce([samplers[i].map(bearings)[2] for i in before]) & samplers[k].map(bearings)[2]
    rows = np.flatnonzero(overlap.any(1))
    if not rows.size:
        return None
    shortest = MIN_SEAM_ROWS * 2 * np.pi / columns
    middle = (coarse.theta[rows[0]] + coarse.theta[rows[-1]]) / 2
    half = max((coarse.theta[rows[-1]] - coarse.theta[rows[0]]) / 2 + 1 / coarse.px_per_rad, shortest / 2)
    low, high = float(middle - half), float(middle + half)
    return PolarGrid.around(samplers[k].axis, low, high, columns)


def _no_overlap(samplers: Sequence[Sampler], k: int, before: Sequence[int]) -> str:
    """Return the message of a camera that sees nothing that those before it see, with the angle that is missing."""
    grid = _polar_grid(samplers[k])
    bearings = grid.bearings()
    own = samplers[k].map(bearings)[2]
    others = np.logical_or.reduce([samplers[i].map(bearings)[2] for i in before])
    inner = grid.theta[np.where(own.any(1))[0].max()] if own.any() else 0.0
    outer = grid.theta[np.where(others.any(1))[0].min()] if others.any() else np.pi
    return (
        f"camera {k + 1} has no overlap with {', '.join(str(i + 1) for i in before)}: their fields of view are"
        f" {np.degrees(max(outer - inner, 0.0)):.1f}° apart. Check that the images are of different lenses, and the"
        " fields of view (theta_max), poses and masks of a rig"
    )


def _warped(
    samplers: Sequence[Sampler], seams: Mapping[int, Seam], k: int, seam: Seam, disparity: Disparity
) -> list[Sampler]:
    """Return the samplers, where camera k and those before it meet in the middle.

    What the inner image shows at x the outer one shows at x + flow: the inner is sampled at x - flow / 2.
    """
    return [
        dataclasses.replace(s, warps=(SeamWarp(seam, disparity.flow, -0.5 if i == k else 0.5), *s.warps))
        if i in (0, *seams, k)
        else s
        for i, s in enumerate(samplers)
    ]


def _quality(seam: Seam, inner: Bytes, outer: Bytes, overlap: Mask, disparity: Disparity, width: int) -> SeamQuality:
    import cv2

    a, b = (cv2.cvtColor(np.ascontiguousarray(x), cv2.COLOR_RGB2GRAY).astype(np.float32) for x in (inner, outer))
    difference = np.where(overlap, a - b, 0)
    count = cv2.GaussianBlur(overlap.astype(np.float32), (0, 0), STEP_BLUR_PX)
    step = np.abs(cv2.GaussianBlur(difference, (0, 0), STEP_BLUR_PX)) / np.maximum(count, 1e-3)
    at = seam.row, np.arange(seam.grid.columns)
    on_seam = step[at][overlap[at]]
    degrees = float(np.degrees(disparity.median_px / seam.grid.px_per_rad))
    return SeamQuality(
        float(np.sqrt(np.mean((a - b)[overlap] ** 2))) if overlap.any() else float("nan"),
        float(np.median(on_seam)) if on_seam.size else float("nan"),
        degrees / 360 * width,
        degrees,
        degrees,
        float(np.degrees(overlap.sum(0).mean() / seam.grid.px_per_rad)),
    )


def _overlap_samples(samplers: Sequence[Sampler], images: Sequence[Bytes]) -> list[OverlapSamples]:
    """Return blurred pixels of all pairs of cameras in their overlaps."""
    import cv2

    samples: list[OverlapSamples] = []
    height = SAMPLE_COLUMNS // 2
    grid = PolarGrid.around(np.array([0.0, -1.0, 0.0]), 0.0, np.pi, SAMPLE_COLUMNS)
    bearings = grid.bearings()[: height * 2]
    layers: list[tuple[Any, Mask, Array]] = []
    for sampler, image in zip(samplers, images, strict=True):
        scale = max(1.0, max(image.shape) / SAMPLE_COLUMNS)
        blurred = cv2.GaussianBlur(image, (0, 0), scale)
        u, v, seen = sampler.map(bearings)
        colors = cv2.remap(blurred, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        layers.append((colors, seen, sampler.relative_radius(np.stack([u, v], -1))))
    for i in range(len(layers)):
        for j in range(i):
            both = layers[i][1] & layers[j][1]
            if both.any():
                colors = layers[i][0][both], layers[j][0][both]
                radius = layers[i][2][both], layers[j][2][both]
                samples.append(OverlapSamples((i, j), colors, radius))
    return samples
