"""Stitching of the images of a rig or head to a sphere: the counterpart of `omnisight stitch`."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.rotation import look
from omnisight.pipeline.camera_sources import RigSource
from omnisight.pipeline.stitch_files import StitchJob, check_output, check_suffix, stitch_clip, stitch_images
from omnisight.pipeline.stitch_inputs import Bytes, StitchSource, head_frames
from omnisight.pipeline.stitch_options import StitchOptions
from omnisight.pipeline.stitch_rig import head_rig
from omnisight.rig import Rig
from omnisight.sfm.head_result import HeadCalibration
from omnisight.targets.length import parse_length
from omnisight.video_options import VideoOptions
from omnisight.views.stitching.levelling import Vertical, estimate_vertical
from omnisight.views.stitching.sampling import Sampler
from omnisight.views.stitching.stitcher import SeamQuality, plan_stitch
from omnisight.views.view_cameras import sphere

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

# Width of the spheres on which distances and the vertical are estimated.
COARSE_WIDTH = 1024
# Distances that are tried, in largest baselines: below the nearest the overlap of two lenses vanishes.
NEAREST_BASELINES, TRIALS = 10.0, 12
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
            return "the overlap shows no texture, so that the seam cannot be verified"
        if worst.disparity_deg <= MAX_SEAM_DISPARITY_DEG:
            return ""
        return (
            f"the seam has a disparity of {worst.disparity_deg:.2f}°: near objects, images that were not taken at the"
            " same time, or images in the wrong order. With a rig specify the distance of the scene (--at 3m)"
        )


def stitch(
    images: StitchSource | Sequence[StitchSource],
    rig: RigSource | None = None,
    options: StitchOptions = StitchOptions(),
    *,
    cameras: Sequence[Camera | str | PathLike[str]] = (),
    output: str | PathLike[str] | None = None,
    video: VideoOptions = VideoOptions(),
    progress: Progress = lambda stage, done, total: None,
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
    frames = head_frames(sources, rig.names if isinstance(rig, Rig) else ())
    target = None if output is None else check_output(Path(output), frames, video)
    progress("estimate the cameras", 0, 1)
    head = head_rig(frames, rig, cameras, options)
    first = next(iter(frames))
    samplers, distance = _placed(head.samplers(), first, options.at)
    vertical = _vertical(samplers, first, options)
    sphere_from_rig = _orientation(vertical, options)
    camera = sphere(options.width or head.native_width())
    bearings = _bearings(camera, sphere_from_rig)
    progress("estimate the cameras", 1, 1)
    plan = plan_stitch(samplers, first, camera.width, warp=options.warp)
    estimated = time.perf_counter()
    job = StitchJob(frames, plan, bearings, options, target, video)
    done = stitch_clip(job, progress) if frames.is_clip else stitch_images(job, progress)
    seconds = time.perf_counter()
    return StitchResult(
        done.first,
        camera,
        head.rig,
        sphere_from_rig,
        distance,
        tuple(plan.quality),
        head.calibration,
        vertical,
        float(np.average(done.covered.mean(1), weights=np.cos(_latitudes(camera.height)))),
        done.count,
        seconds - start,
        (seconds - estimated) / done.count,
        done.files,
    )


def _placed(samplers: list[Sampler], images: Sequence[Bytes], at: str) -> tuple[list[Sampler], float]:
    """Return the samplers for the specified or estimated distance, and that distance."""
    if at not in ("auto", "inf"):
        distance = parse_length(at)
        return [dataclasses.replace(s, distance=distance) for s in samplers], distance
    baseline = max(float(np.linalg.norm(s.sensor_from_rig.translation)) for s in samplers)
    if at == "inf" or baseline == 0:
        return samplers, float("inf")
    inverse = np.linspace(0, 1 / (NEAREST_BASELINES * baseline), TRIALS)
    placed = [[dataclasses.replace(s, distance=1 / i if i else np.inf) for s in samplers] for i in inverse]
    scores = [_overlap_error(trial, images) for trial in placed]
    best = int(np.argmin(scores))
    return placed[best], float(1 / inverse[best]) if best else float("inf")


def _overlap_error(samplers: list[Sampler], images: Sequence[Bytes]) -> float:
    """Return the disparity that remains along all seams."""
    try:
        plan = plan_stitch(samplers, images, COARSE_WIDTH, warp=False)
    except ValueError:  # a sphere so near that the overlap vanishes
        return float("inf")
    return float(np.nan_to_num(np.sum([q.disparity_deg for q in plan.quality]), nan=np.inf))


def _vertical(samplers: list[Sampler], images: Sequence[Bytes], options: StitchOptions) -> Vertical | None:
    """Estimate the vertical on a coarse sphere."""
    if not options.level:
        return None
    guess = look(0, options.pitch, options.roll).T
    bearings = _bearings(sphere(COARSE_WIDTH), guess)
    coarse = plan_stitch(samplers, images, COARSE_WIDTH, warp=False)
    coarse.prepare(bearings)
    return estimate_vertical(coarse(images), bearings, -guess[1])


def _orientation(vertical: Vertical | None, options: StitchOptions) -> Array:
    """Return sphere_from_rig."""
    if vertical is None or vertical.reason:
        # The camera's own pitch and roll are undone: the sphere is level.
        level = look(0, options.pitch, options.roll).T
    else:
        down = -vertical.up
        forward = np.array([0.0, 0.0, 1.0]) - down[2] * down
        if np.linalg.norm(forward) < 1e-3:
            forward = np.array([0.0, 1.0, 0.0]) - down[1] * down
        forward /= np.linalg.norm(forward)
        level = np.stack([np.cross(down, forward), down, forward])
    return np.asarray(look(options.yaw) @ level, float)


def _bearings(camera: Camera, sphere_from_rig: Array) -> NDArray[np.float32]:
    """Return the directions (H, W, 3) of the pixels of a sphere in the rig frame."""
    lon = (np.arange(camera.width) + 0.5) * 2 * np.pi / camera.width - np.pi
    lat = _latitudes(camera.height)[:, None]
    local = np.stack(
        [
            np.cos(lat) * np.sin(lon),
            np.broadcast_to(np.sin(lat), (camera.height, camera.width)),
            np.cos(lat) * np.cos(lon),
        ],
        -1,
    )
    return (local @ sphere_from_rig).astype(np.float32)


def _latitudes(height: int) -> Array:
    """Return the latitudes (H,) of rows, radians, positive down."""
    return ((np.arange(height) + 0.5) / height - 0.5) * np.pi
