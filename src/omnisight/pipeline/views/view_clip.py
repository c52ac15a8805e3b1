"""Views of a clip: one or several videos from one pass over its frames."""

import dataclasses
import math
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.images import Clip
from omnisight.images.output_paths import refuse_overwrite
from omnisight.images.planes import Yuv
from omnisight.images.video_writer import VideoWriter
from omnisight.parallel import prefetch
from omnisight.pipeline.inputs.central_camera import AnyCameraSource, camera_of_image, central_camera
from omnisight.pipeline.views.view import ViewResult
from omnisight.pipeline.views.view_encoding import is_whole_sphere
from omnisight.pipeline.views.view_motion import Angles, check_fixed_angles, moved, stabilization, view_angles
from omnisight.pipeline.views.view_options import ViewMotion, ViewOptions
from omnisight.pipeline.views.view_renderer import hatch
from omnisight.pipeline.views.view_target import view_target
from omnisight.progress import Progress, no_progress
from omnisight.video_options import VideoOptions
from omnisight.views.cube import CROSS_LAYOUT, CUBE_FACES, cube_cross
from omnisight.views.frame_remapper import FrameRemapper
from omnisight.views.maps import calibrated_fraction, extrapolation_mask

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClipViews(Displayed):
    """Views of a clip that were written.

    Attributes
    ----------
    views
        The view for each file; of a moving view, that of the frame with the smallest part of the view covered within
        the calibrated field of view.
    times
        Time of that frame from the start of the clip, s, for each file; None if the view does not move.
    clip
        The clip.
    frames
        Number of frames of each file.
    seconds
        Duration of the computation.
    """

    views: tuple[ViewResult, ...]
    times: tuple[float | None, ...]
    clip: Clip
    frames: int
    seconds: float


def view_clip(
    clip: str | PathLike[str],
    camera: AnyCameraSource | None,
    views: Sequence[tuple[str | PathLike[str], ViewOptions]],
    *,
    motion: ViewMotion = ViewMotion(),
    video: VideoOptions = VideoOptions(),
    progress: Progress = no_progress,
) -> ClipViews:
    """Turn a clip into videos of views, which keep its time stamps and its sound.

    Frames are decoded, remapped and encoded at the same time, and the planes of luma and chroma are remapped as they
    are stored. Memory does not depend on the length of the clip.

    Parameters
    ----------
    clip
        The video file.
    camera
        The camera of the clip, or its calibration file of any format; None for an equirectangular clip of 360° x 180°.
    views
        File and options of each view. Options that concern the clip are those of the first.
    motion
        Motion of the views, common to all.
    video
        Codec, quality and sound.
    progress
        Called with the stage, the frames written and their number.

    Raises
    ------
    ValueError
        If an option is not usable, or the clip cannot be decoded.
    OSError
        If a file cannot be written.
    """
    began = time.perf_counter()
    first, files = views[0][1], [Path(file) for file, _ in views]
    source_clip = Clip.open(Path(clip), upright=first.apply_exif)
    refuse_overwrite(files, [source_clip.path])
    if len({file.resolve() for file in files}) < len(views):
        raise ValueError(f"{files[0]}: two views have the same file; specify one for each")
    of_clip = source_clip.size, source_clip.path.name
    central = None if camera is None else central_camera(camera, name=first.name, distance=first.distance)
    source = camera_of_image(central, *of_clip, name=None, scale=first.scale_camera)
    duration = _last_time(source_clip)
    angles, stable_from_source = view_angles(motion, duration), stabilization(motion, duration)
    rendered = [_ClipView(source, options, motion, angles) for _, options in views]
    count = 0
    with ExitStack() as stack:
        writers = [
            stack.enter_context(VideoWriter(file, view.size, source_clip, video, is_sphere=view.is_sphere))
            for file, view in zip(files, rendered, strict=True)
        ]
        for frame in stack.enter_context(closing(prefetch(source_clip.frames(limit=None)))):
            for view, writer in zip(rendered, writers, strict=True):
                image = view(frame.yuv(writer.depth), frame.seconds, stable_from_source(frame.seconds))
                writer.write(image, frame.seconds)
            count += 1
            progress("view", count, max(source_clip.declared_frames or 0, count))
    results = tuple(view.result(file) for file, view in zip(files, rendered, strict=True))
    times = tuple(view.time if motion.moves else None for view in rendered)
    return ClipViews(results, times, source_clip, count, time.perf_counter() - began)


class _ClipView:
    """One view of a clip, that may move.

    Attributes
    ----------
    is_sphere
        Whether it shows all directions, equirectangular.
    size
        (width, height), px.
    time
        Time of the frame that is measured, s: the first with the smallest part covered within the calibrated field of
        view.
    """

    def __init__(self, source: Camera, options: ViewOptions, motion: ViewMotion, angles: Angles) -> None:
        self.source, self.options = source, options.for_camera(source)
        self._angles, self._moves = angles, motion.moves
        if options.mark and self._moves:
            raise ValueError("--mark applies to views that do not move")
        check_fixed_angles(options, motion, angles(0.0))
        target, rotations = view_target(self._at(0.0))
        self.time, self._lowest = 0.0, math.inf
        self._measured: tuple[Camera, Sequence[Array], NDArray[np.bool_]] | None = None
        self._faces: list[FrameRemapper] = []
        self._hatched: NDArray[np.bool_] | None = None
        self.is_sphere = is_whole_sphere(_even(target))
        width, height = _even(target).size
        self.size = (4 * width, 3 * height) if len(rotations) > 1 else (width, height)

    def __call__(self, frame: Yuv, seconds: float, stable_from_source: Array) -> Yuv:
        """Return the view of a frame."""
        if not self._faces or self._moves:
            target, rotations = view_target(self._at(seconds))
            target, rotations = _even(target), [rotation @ stable_from_source for rotation in rotations]
            self._faces = [self._remapper(target, rotation) for rotation in rotations]
            self._measure(target, rotations, seconds)
            if self.options.mark:
                outside = [extrapolation_mask(self.source, f.target, r) & f.mask for f, r in self._pairs(rotations)]
                self._hatched = cube_cross(outside)
        view = self._faces[0](frame) if len(self._faces) == 1 else _cross([face(frame) for face in self._faces])
        if self._hatched is not None:
            luma, (height, width) = view.planes[0], self._hatched.shape
            luma[:height, :width] = hatch(luma[:height, :width], self._hatched, (1 << view.depth) - 1)
        return view

    def result(self, file: Path) -> ViewResult:
        """Return the measures of the view of the frame that is measured."""
        assert self._measured is not None  # a clip has at least one frame
        target, rotations, covered = self._measured
        return ViewResult.of(self.options, [file], (self.source, target), rotations, covered)

    def _measure(self, target: Camera, rotations: Sequence[Array], seconds: float) -> None:
        """Keep the view of a frame for `result` if a smaller part is covered than in those before."""
        share = calibrated_fraction(self.source, target, rotations)
        if share < self._lowest:
            self.time, self._lowest = seconds, share
            self._measured = target, rotations, cube_cross([face.mask for face in self._faces])

    def _at(self, seconds: float) -> ViewOptions:
        return moved(self.options, self._angles(seconds))

    def _pairs(self, rotations: Sequence[Array]) -> list[tuple[FrameRemapper, Array]]:
        return list(zip(self._faces, rotations, strict=True))

    def _remapper(self, target: Camera, rotation: Array) -> FrameRemapper:
        kernel = self.options.interpolation or "bilinear"
        return FrameRemapper(self.source, target, rotation, interpolation=kernel, antialias=self.options.antialias)


def _even(camera: Camera) -> Camera:
    """Return a camera without an odd last column or row, which video codecs do not encode."""
    width, height = camera.size
    if min(width, height) < 2:
        raise ValueError(f"a view of {width}x{height} px cannot be encoded: specify --size 2x2 or more")
    return dataclasses.replace(camera, size=(width // 2 * 2, height // 2 * 2))


def _cross(faces: Sequence[Yuv]) -> Yuv:
    """Join the six faces of a cube into a cross."""
    side = faces[0].size[0]
    cross = Yuv.empty((4 * side, 3 * side), faces[0])
    for k, plane in enumerate(cross.planes):
        step = side if k == 0 else side // 2
        plane[...] = cross.black[min(k, 1)]
        for name, face in zip(CUBE_FACES, faces, strict=True):
            row, column = CROSS_LAYOUT[name]
            plane[row * step : (row + 1) * step, column * step : (column + 1) * step] = face.planes[k][:step, :step]
    return cross


def _last_time(clip: Clip) -> float | None:
    """Return the time of the last frame according to the header."""
    if clip.declared_frames is None:
        return clip.seconds
    return (clip.declared_frames - 1) / clip.frame_rate
