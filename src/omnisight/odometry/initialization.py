"""The first two keyframes: the first frames between which the camera moved far enough."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.odometry.ray_observations import FrameRays
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import refine
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Median parallax over its noise at which distances are known to about 5 %.
MIN_PARALLAX_SIGMA = 20.0
# Patches that both frames must show.
MIN_COMMON = 30
# Growth of the parallax after which another attempt is made.
GROWTH = 1.2
# Share of the patches of the first frame below which it is replaced.
MIN_SHARE = 0.4
# Frames that wait for their pose.
MAX_WAITING = 300
SOLVED = "general", "planar motion", "dominant plane"


@dataclass(frozen=True, eq=False)
class WaitingFrame:
    """A frame without a known position.

    Attributes
    ----------
    index, seconds
        Index in the sequence, and time.
    rays
        Its rays.
    rotation
        Pose of the frame with the position of the first one: the rotation that explains the rays best.
    """

    index: int
    seconds: float
    rays: FrameRays
    rotation: Pose


@dataclass
class Initialization:
    """Frames that wait for a sufficient parallax.

    Attributes
    ----------
    first
        The first keyframe.
    waiting
        The frames since, with the last one.
    """

    first: WaitingFrame
    waiting: list[WaitingFrame] = field(default_factory=list[WaitingFrame])
    _tried: float = MIN_PARALLAX_SIGMA / GROWTH

    def solve(self, options: RansacOptions) -> Pose | None:
        """Return last_from_first, with a translation of unit length, once it is known."""
        a, b = common(self.first.rays, self.waiting[-1].rays)
        if len(a) < MIN_COMMON:
            return None
        turn = self.waiting[-1].rotation.rotation @ self.first.rotation.rotation.T
        chord = np.linalg.norm(a.bearings @ turn.T - b.bearings, axis=1)
        parallax = float(np.median(chord / np.sqrt(a.variance + b.variance)))
        if parallax < self._tried * GROWTH:
            return None
        self._tried = parallax
        pairs = BearingPairs(a.bearings, b.bearings, a.covariance, b.covariance, is_noise_known=False)
        found = estimate_relative_pose(pairs, options)
        is_known = found.motion.name in SOLVED and found.alternative is None
        return found.b_from_a if is_known else None

    @property
    def needs_restart(self) -> bool:
        """Whether the last frame shows too few patches of the first one."""
        common_patches, _ = common(self.first.rays, self.waiting[-1].rays)
        share = len(common_patches) / max(len(self.first.rays), 1)
        return share < MIN_SHARE or len(self.waiting) >= MAX_WAITING


def common(a: FrameRays, b: FrameRays) -> tuple[FrameRays, FrameRays]:
    """Return the rays of the patches that two frames show."""
    _, rows_a, rows_b = np.intersect1d(a.number, b.number, assume_unique=True, return_indices=True)
    return a[rows_a], b[rows_b]


def estimate_rotation(a: FrameRays, b: FrameRays, predicted: Array, seed: int = 0) -> tuple[Array, Mask]:
    """Return the rotation (3, 3) that explains the rays (N) of two frames best, and which agree with it.

    Parallax is smaller than the rotation, and in all directions in turn: it counts as noise of unknown size.
    """
    from omnisight.twoview._alignment_problems_kernel import RotationProblem

    order = np.random.default_rng(seed).permutation(len(a))
    a, b = a[order], b[order]
    pairs = BearingPairs(a.bearings, b.bearings, a.covariance, b.covariance, is_noise_known=False)
    fit = refine(RotationProblem.of(pairs), np.column_stack([predicted, np.zeros(3)]), is_scale_known=False)
    inlier = np.zeros(len(a), np.bool_)
    inlier[order] = fit.is_inlier
    return fit.model[:, :3], inlier
