"""The plan of a stitch: cameras, distance, orientation and seams, estimated from a few frames."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.pipeline.stitching.stitch_inputs import Bytes, HeadFrames
from omnisight.pipeline.stitching.stitch_options import StitchOptions
from omnisight.pipeline.stitching.stitch_rig import HeadRig, head_rig
from omnisight.rig import Rig
from omnisight.sfm.head_result import HeadCalibration
from omnisight.targets.length import parse_length
from omnisight.views.maps import STRIP_ROWS
from omnisight.views.stitching.image_stitcher import ImageStitcher
from omnisight.views.stitching.levelling import Vertical, estimate_vertical
from omnisight.views.stitching.sampling import Sampler
from omnisight.views.stitching.seam_plan import SeamPlan, plan_stitch
from omnisight.views.view_cameras import sphere

Array = NDArray[np.float64]

# Width of the spheres on which distances and the vertical are estimated.
COARSE_WIDTH = 1024
# Distances that are tried, in largest baselines: below the nearest the overlap of two lenses vanishes.
NEAREST_BASELINES, TRIALS = 10.0, 12


@dataclass(frozen=True, eq=False)
class StitchPlan:
    """What is estimated once for all frames.

    Attributes
    ----------
    first
        The images of the first frame.
    head
        The rig.
    camera
        Equirectangular camera of the spheres.
    sphere_from_rig
        (3, 3) rotation of the spheres.
    distance
        Radius of the sphere on which the scene is assumed; infinite without parallax, or if lengths are not known.
    vertical
        Estimate of the vertical; None without.
    is_level
        Whether the horizon is level: by this estimate, or by the given pitch and roll.
    seam_plan
        Colours, seams and local warps of the first frame.
    """

    first: list[Bytes]
    head: HeadRig
    camera: Camera
    sphere_from_rig: Array
    distance: float
    vertical: Vertical | None
    is_level: bool
    seam_plan: SeamPlan

    @property
    def bearings(self) -> NDArray[np.float32]:
        """Directions (H, W, 3) of the spheres in the rig frame."""
        return sphere_bearings(self.camera, self.sphere_from_rig)


def plan_frames(
    frames: HeadFrames,
    rig: Rig | None,
    cameras: Sequence[Camera | str | PathLike[str]],
    options: StitchOptions,
) -> StitchPlan:
    """Estimate what is common to all frames; see `omnisight.stitch`."""
    head = head_rig(frames, rig, cameras, options)
    first = next(iter(frames))
    samplers, distance = _placed(head, first, options.at)
    vertical = _vertical(samplers, first, options)
    sphere_from_rig = _orientation(vertical, options)
    camera = sphere(options.width or head.native_width())
    seam_plan = plan_stitch(samplers, first, camera.width, warp=options.warp)
    is_level = bool(options.pitch or options.roll) or (vertical is not None and not vertical.reason)
    return StitchPlan(first, head, camera, sphere_from_rig, distance, vertical, is_level, seam_plan)


def _placed(head: HeadRig, images: Sequence[Bytes], at: str) -> tuple[list[Sampler], float]:
    """Return the samplers for the specified or estimated distance, and that distance in the unit of the rig."""
    samplers, unit = head.samplers(), head.rig.unit
    if head.calibration is not None:
        return _apart(samplers, head.calibration, at), float("inf")
    if at not in ("auto", "inf"):
        if unit != "m":
            raise ValueError(f"--at {at}: the lengths of the rig are in {unit}, not in metres: use --at auto or inf")
        distance = parse_length(at, "--at")
        return [dataclasses.replace(s, distance=distance) for s in samplers], distance
    baseline = max(float(np.linalg.norm(s.sensor_from_rig.translation)) for s in samplers)
    if at == "inf" or baseline == 0:
        return samplers, float("inf")
    inverse = np.linspace(0, 1 / (NEAREST_BASELINES * baseline), TRIALS)
    placed = [[dataclasses.replace(s, distance=1 / i if i else np.inf) for s in samplers] for i in inverse]
    best = _least_disparity(np.array([_seam_disparities(trial, images) for trial in placed]))
    return placed[best], float(1 / inverse[best]) if best else float("inf")


def _apart(samplers: list[Sampler], head: HeadCalibration, at: str) -> list[Sampler]:
    """Return the samplers of lenses that are apart, around their centre, for the median distance of the scene."""
    if at == "inf":
        return samplers
    poses = Pose(np.eye(3), -head.translation @ head.rotation / 2), Pose(head.rotation, head.translation / 2)
    return [dataclasses.replace(s, sensor_from_rig=p, distance=1.0) for s, p in zip(samplers, poses, strict=True)]


def _seam_disparities(samplers: list[Sampler], images: Sequence[Bytes]) -> Array:
    """Return the disparity (K - 1,) that remains along each seam, degrees; NaN without texture."""
    try:
        plan = plan_stitch(samplers, images, COARSE_WIDTH, warp=False)
    except ValueError:  # a sphere so near that the overlap vanishes
        return np.full(len(samplers) - 1, np.inf)
    return np.array([q.disparity_deg for q in plan.quality])


def _least_disparity(disparities: Array) -> int:
    """Return the trial of least disparity (T, K - 1) on the seams that show texture in all trials with an overlap.

    A seam that shows texture in some trials only would favour those in which it shows none.
    """
    has_texture = ~np.isnan(disparities).any(0)
    return int(np.argmin(disparities[:, has_texture].sum(1)))


def _vertical(samplers: list[Sampler], images: Sequence[Bytes], options: StitchOptions) -> Vertical | None:
    """Estimate the vertical on a coarse sphere."""
    if not options.level:
        return None
    guess = look(0, options.pitch, options.roll).T
    bearings = sphere_bearings(sphere(COARSE_WIDTH), guess)
    coarse = plan_stitch(samplers, images, COARSE_WIDTH, warp=False)
    return estimate_vertical(ImageStitcher(coarse, bearings)(images), bearings, -guess[1])


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


def sphere_bearings(camera: Camera, sphere_from_rig: Array) -> NDArray[np.float32]:
    """Return the directions (H, W, 3) of the pixels of a sphere in the rig frame."""
    bearings = np.empty((camera.height, camera.width, 3), np.float32)
    for top in range(0, camera.height, STRIP_ROWS):
        rows = np.arange(camera.height)[top : top + STRIP_ROWS]
        pixels = np.stack(np.meshgrid(np.arange(camera.width), rows), -1)
        bearings[rows] = camera.unproject(pixels)[0] @ sphere_from_rig
    return bearings
