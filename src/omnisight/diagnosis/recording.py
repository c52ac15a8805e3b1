"""What the checks of a recording examine."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.diagnosis.edge_blur import edge_blur
from omnisight.diagnosis.focal_length import estimate_focal_length_change
from omnisight.diagnosis.frame_pairs import Motion, PatchTracking
from omnisight.diagnosis.readout_time import ReadoutTime, estimate_readout_time
from omnisight.diagnosis.static_regions import StaticEdges
from omnisight.features.detection import illuminated_region
from omnisight.images import estimate_image_field
from omnisight.images.mask import masked_region
from omnisight.sfm.calibration_check import FocalLengthChange

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Gray levels from which a pixel is saturated, and up to which it is black.
SATURATED, BLACK = 250, 6
# Images of a run of consecutive ones, in which patches are tracked.
RUN = 8
# Step between the images that are compared to find static regions.
STATIC_STEP = 3
# Share of the patches that the next image shows below which a run ends.
MIN_KEPT = 0.3


@dataclass(frozen=True)
class FrameFigures:
    """Figures of one image.

    Attributes
    ----------
    index, seconds
        Index in the sequence, and time.
    level
        Median gray level.
    saturated, black
        Shares of the pixels.
    blur_px
        Standard deviation of the blur of edges; NaN without edges.
    difference
        Mean absolute difference to the image before, gray levels; NaN if that was not examined.
    """

    index: int
    seconds: float
    level: float
    saturated: float
    black: float
    blur_px: float
    difference: float


@dataclass(eq=False)
class Recording:
    """Figures of the images of a recording; all are measured by `add`, one image at a time.

    Attributes
    ----------
    camera
        The calibrated camera; None if there is none.
    camera_reason
        Why there is no camera; empty if there is one.
    mask
        (H, W) pixels that may be used; None for all.
    times
        (N,) times of all images, seconds; those of the examined ones for a clip.
    times_from
        Where the times come from.
    frames
        Figures of the examined images, in the order of time.
    unreadable
        Reasons of images that cannot be read.
    corners
        Number of cells with a corner, of the first image of each run.
    tracking
        Patches in runs of consecutive images; None without a camera.
    edges
        Edges that may stay in place.
    """

    camera: Camera | None
    camera_reason: str
    mask: Mask | None = None
    times: Array = field(default_factory=lambda: np.zeros(0))
    times_from: str = ""
    frames: list[FrameFigures] = field(default_factory=list[FrameFigures])
    unreadable: list[str] = field(default_factory=list[str])
    corners: list[int] = field(default_factory=list[int])
    tracking: PatchTracking | None = None
    edges: StaticEdges | None = None
    _last: Bytes | None = field(default=None, repr=False)
    _region: Mask | None = field(default=None, repr=False)

    def add(self, index: int, seconds: float, gray: Bytes) -> None:
        """Measure an image (H, W)."""
        if self._region is None:
            self._prepare(gray)
        region = self._region
        assert region is not None
        is_next = bool(self.frames) and index == self.frames[-1].index + 1 and self._last is not None
        values = gray[region]
        before = self._last[region].astype(np.int16) if is_next and self._last is not None else np.full(1, np.nan)
        self.frames.append(
            FrameFigures(
                index,
                seconds,
                level=float(np.median(values)),
                saturated=float(np.mean(values >= SATURATED)),
                black=float(np.mean(values <= BLACK)),
                blur_px=edge_blur(gray, region),
                difference=float(np.mean(np.abs(values - before))),
            )
        )
        self._track(index, seconds, gray, is_next)
        self._last = gray

    @cached_property
    def steps(self) -> list[Motion]:
        """The motions between consecutive images."""
        return [step for steps in self.tracking.steps for step in steps] if self.tracking is not None else []

    @cached_property
    def runs(self) -> list[Motion]:
        """The motions over runs of consecutive images."""
        return self.tracking.whole_runs() if self.tracking is not None else []

    @cached_property
    def readout(self) -> ReadoutTime | None:
        """The readout time of an image; None if it cannot be determined."""
        if self.tracking is None or self.camera is None:
            return None
        return estimate_readout_time(self.camera, self.tracking.runs)

    @cached_property
    def focal_length_change(self) -> FocalLengthChange | None:
        """The change of the focal length that the images agree with best; None if it cannot be determined."""
        if self.tracking is None or self.camera is None:
            return None
        return estimate_focal_length_change(self.camera, self.tracking.runs)

    @cached_property
    def static_region(self) -> Mask | None:
        """The pixels (H, W) that look the same in all images; None if that cannot be determined."""
        return self.edges.find() if self.edges is not None else None

    def _prepare(self, gray: Bytes) -> None:
        """Find the used pixels of the first image."""
        if self.camera is not None:
            region = illuminated_region(gray, self.camera)
        else:
            v, u = np.indices(gray.shape)
            region = estimate_image_field([gray]).contains(np.stack([u, v], -1).astype(float))
        self._region = masked_region(region, self.mask)
        self.edges = StaticEdges(self._region)
        if self.camera is not None:
            self.tracking = PatchTracking(self.camera, self._region)

    def _track(self, index: int, seconds: float, gray: Bytes, is_next: bool) -> None:
        """Track patches in the image, or start with it."""
        assert self.edges is not None
        tracking = self.tracking
        starts = not is_next
        if tracking is not None:
            if is_next:
                tracking.track(index, seconds, gray)
            is_lost = is_next and tracking.steps[-1][-1].kept < MIN_KEPT
            starts = starts or is_lost or len(tracking.runs[-1]) >= RUN
            if starts:
                self.corners.append(tracking.start(index, seconds, gray, continues=is_next and not is_lost))
        if len(self.frames) % STATIC_STEP == 0:
            self.edges.add(gray)


def frame_list(frames: Sequence[int], limit: int = 5) -> str:
    """Return indices of images as text."""
    shown = ", ".join(map(str, frames[:limit]))
    return f"image{'s' if len(frames) > 1 else ''} {shown}" + (", ..." if len(frames) > limit else "")
