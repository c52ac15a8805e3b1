"""Motion between consecutive images, by patches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.central_rig import central_rig
from omnisight.visual_odometry.initialization import MIN_COMMON, estimate_rotation
from omnisight.visual_odometry.motion_prediction import MotionPrediction
from omnisight.visual_odometry.patches import Patches
from omnisight.visual_odometry.ray_observations import FrameRays, common
from omnisight.visual_odometry.tracker import Tracker

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

PATCHES = 300


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion from one image to a later one.

    Attributes
    ----------
    first, last
        Indices of the images.
    seconds
        Time between them.
    tracked, common
        Number of patches of the first image, and of those that the last one shows.
    turn
        (3,) rotation vector, radians; NaN if too few patches are common.
    parallax_deg, parallax_sigmas
        Median angle between the directions of a patch without the rotation, degrees, and over its noise.
    """

    first: int
    last: int
    seconds: float
    tracked: int
    common: int
    turn: Array
    parallax_deg: float = float("nan")
    parallax_sigmas: float = float("nan")

    @property
    def kept(self) -> float:
        """Share of the patches that the last image shows."""
        return self.common / max(self.tracked, 1)

    @property
    def turn_rate_deg(self) -> float:
        """Degrees per second."""
        return float(np.degrees(np.linalg.norm(self.turn))) / self.seconds

    @classmethod
    def between(cls, a: "SeenFrame", b: "SeenFrame", predicted: Array) -> "Motion":
        """Measure the motion between two images, given a predicted rotation (3, 3)."""
        rays_a, rays_b = common(a.rays, b.rays)
        seconds, counts = b.seconds - a.seconds, (len(a.rays), len(rays_a))
        if len(rays_a) < MIN_COMMON:
            return cls(a.index, b.index, seconds, *counts, np.full(3, np.nan))
        turn = estimate_rotation(rays_a, rays_b, predicted, seed=0)
        chord = np.linalg.norm(rays_a.bearings @ turn.T - rays_b.bearings, axis=1)
        sigma = np.sqrt(rays_a.variance + rays_b.variance)
        parallax = float(np.degrees(np.median(chord))), float(np.median(chord / sigma))
        return cls(a.index, b.index, seconds, *counts, so3.log(turn), *parallax)


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """An image with the rays of its patches."""

    index: int
    seconds: float
    rays: FrameRays


class PatchTracking:
    """Patches that are tracked through runs of consecutive images, which start anew.

    Attributes
    ----------
    runs
        The images of each run.
    steps
        For each run the motions between consecutive images.
    """

    def __init__(self, camera: Camera, region: Mask) -> None:
        """Prepare for images of a camera, of whose pixels (H, W) some are used."""
        self._tracker = Tracker(central_rig(camera), [region], PATCHES)
        self._motion = MotionPrediction.still(0.0, Pose())
        self.runs: list[list[SeenFrame]] = []
        self.steps: list[list[Motion]] = []

    @property
    def cells(self) -> int:
        """Number of cells of the view; a patch can start in each."""
        return self._tracker.cells

    def start(self, index: int, seconds: float, gray: Bytes, *, continues: bool) -> int:
        """Start a run with an image (H, W), which may continue the motion; return its number of patches."""
        tracker = self._tracker
        tracker.patches = Patches.none()
        if not continues:
            self._motion = MotionPrediction.still(seconds, Pose())
        pose = self._motion.rig_from_world
        tracker.track([gray], pose)
        tracker.start(tracker.corners([gray]), pose)
        self.runs.append([SeenFrame(index, seconds, tracker.rays(pose))])
        self.steps.append([])
        return len(self.runs[-1][0].rays)

    def track(self, index: int, seconds: float, gray: Bytes) -> None:
        """Track the patches of the run in the next image (H, W)."""
        last, before = self.runs[-1][-1], self._motion.rig_from_world
        predicted = self._motion.at(seconds)
        frame = SeenFrame(index, seconds, self._tracker.track([gray], predicted))
        step = Motion.between(last, frame, predicted.rotation @ before.rotation.T)
        pose = predicted if np.isnan(step.turn).any() else Pose(so3.exp(step.turn) @ before.rotation)
        self._tracker.confirm(pose, frame.rays, np.ones(len(frame.rays), np.bool_))
        self._motion = self._motion.after(seconds, pose)
        self.runs[-1].append(frame)
        self.steps[-1].append(step)

    def whole_runs(self) -> list[Motion]:
        """Return the motion from the first to the last image of each run of two or more."""
        motions = list[Motion]()
        for run, steps in zip(self.runs, self.steps, strict=True):
            turns = [so3.exp(step.turn) for step in steps if np.isfinite(step.turn).all()]
            if turns and len(turns) == len(steps):
                predicted = np.linalg.multi_dot(turns[::-1]) if len(turns) > 1 else turns[0]
                motions.append(Motion.between(run[0], run[-1], predicted))
        return motions
