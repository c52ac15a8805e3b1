"""Stitching of the images of a rig or head to a sphere: the counterpart of `omnisight stitch`."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.formats import load_rig
from omnisight.pipeline.inputs.camera_sources import RigSource
from omnisight.pipeline.stitching.stitch_files import (
    StitchedFrames,
    StitchJob,
    check_output,
    check_suffix,
    stitch_clip,
    stitch_images,
)
from omnisight.pipeline.stitching.stitch_inputs import Bytes, StitchSource, head_frames
from omnisight.pipeline.stitching.stitch_options import StitchOptions
from omnisight.pipeline.stitching.stitch_plan import StitchPlan, plan_frames
from omnisight.progress import Progress, no_progress
from omnisight.rig import Rig
from omnisight.sfm.head_result import HeadCalibration
from omnisight.video_options import VideoOptions
from omnisight.views.stitching.levelling import Vertical
from omnisight.views.stitching.seam_plan import SeamQuality

Array = NDArray[np.float64]

# Disparity along a seam above which it is visible, degrees: five times the resolution of the eye at a full sphere.
MAX_SEAM_DISPARITY_DEG = 0.3


@dataclass(frozen=True, eq=False)
class StitchResult(Displayed):
    """A stitched sphere and its measures.

    Attributes
    ----------
    image
        (H, W, 3) the first sphere, RGB.
    camera
        Its equirectangular camera.
    rig
        The rig, as given or estimated.
    sphere_from_rig
        (3, 3) rotation of the sphere.
    distance
        Radius of the sphere on which the scene is assumed; infinite without parallax.
    seams
        Measures of the seam of each camera after the first.
    head
        Estimate of lenses and rotation; None for a rig.
    vertical
        Estimate of the vertical; None without.
    covered
        Share of the sphere that the cameras see.
    frames
        Number of spheres.
    seconds
        Duration; of this `frame_seconds` for each frame after the estimates.
    files
        The files written.
    """

    image: Bytes = field(repr=False)
    camera: Camera
    rig: Rig
    sphere_from_rig: Array
    distance: float
    seams: tuple[SeamQuality, ...]
    head: HeadCalibration | None
    vertical: Vertical | None
    covered: float
    frames: int
    seconds: float
    frame_seconds: float
    files: tuple[Path, ...] = ()

    @property
    def warning(self) -> str:
        """What is likely to be visible in the sphere; empty if nothing."""
        worst = max(self.seams, key=lambda seam: np.nan_to_num(seam.disparity_deg, nan=np.inf))
        if not np.isfinite(worst.disparity_deg):
            return "the overlap shows no texture, and the seam cannot be verified"
        if worst.disparity_deg <= MAX_SEAM_DISPARITY_DEG:
            return ""
        return (
            f"the seam has a disparity of {worst.disparity_deg:.2f}°: near objects, images that were not taken at the"
            " same time, or images in the wrong order. With a rig, --at auto estimates the distance of the scene, and"
            " --at 3m specifies it"
        )


def stitch(
    images: StitchSource | Sequence[StitchSource],
    rig: RigSource | None = None,
    options: StitchOptions = StitchOptions(),
    *,
    cameras: Sequence[Camera | str | PathLike[str]] = (),
    output: str | PathLike[str] | None = None,
    video: VideoOptions = VideoOptions(),
    progress: Progress = no_progress,
) -> StitchResult:
    """Stitch simultaneous images of a rig of central cameras to an equirectangular image.

    Without a rig, two lenses with image circles are calibrated by what both see at their rims. Colours are matched in
    linear light, the seam is the closed path of least cost in the overlap, parallax is closed by local warps, and
    images are blended in bands (Burt and Adelson 1983).

    Parameters
    ----------
    images
        An image per camera (file or array), a folder or clip per camera, or one image or clip with two circles side by
        side.
    rig
        The rig, or its file; None for a head of two lenses.
    options
        Options of the command.
    cameras
        The calibrated cameras of both lenses, or their files, if only their rotation is unknown.
    output
        File of the sphere; a folder for several frames, a video file for a clip.
    video
        Codec and quality of a stitched clip; its sound is that of the first clip.
    progress
        Called with the stage, the steps done and the total.

    Raises
    ------
    ValueError
        If an image cannot be read, does not have the size of its camera, or the images have no overlap.
    """
    start = time.perf_counter()
    sources = [images] if isinstance(images, str | PathLike | np.ndarray) else list(images)
    if output is not None:
        check_suffix(Path(output))
    body = load_rig(Path(rig)) if isinstance(rig, str | PathLike) else rig
    frames = replace(head_frames(sources, body.names if body else ()), apply_exif=options.apply_exif)
    target = None if output is None else check_output(Path(output), frames, video)
    progress("estimate the cameras", 0, 1)
    planned = plan_frames(frames, body, cameras, options)
    progress("estimate the cameras", 1, 1)
    estimated = time.perf_counter()
    job = StitchJob(
        frames, planned.seam_plan, planned.camera, planned.bearings, planned.is_level, options, target, video
    )
    done = stitch_clip(job, progress) if frames.is_clip else stitch_images(job, progress)
    seconds = time.perf_counter()
    return stitch_result(planned, done, seconds - start, seconds - estimated)


def stitch_result(planned: StitchPlan, done: StitchedFrames, seconds: float, stitching_seconds: float) -> StitchResult:
    """Return the result of frames that were stitched by a plan."""
    return StitchResult(
        done.first,
        planned.camera,
        planned.head.rig,
        planned.sphere_from_rig,
        planned.distance,
        tuple(planned.seam_plan.quality),
        planned.head.calibration,
        planned.vertical,
        _covered_share(done.covered, planned.camera),
        done.count,
        seconds,
        stitching_seconds / done.count,
        done.files,
    )


def _covered_share(covered: NDArray[np.bool_], sphere: Camera) -> float:
    """Return the share of the solid angle of a sphere whose pixels (H, W) are covered."""
    rows = np.arange(sphere.height)
    bearings, _ = sphere.unproject(np.stack([np.zeros_like(rows), rows], -1))
    return float(np.average(covered.mean(1), weights=np.hypot(bearings[:, 0], bearings[:, 2])))
