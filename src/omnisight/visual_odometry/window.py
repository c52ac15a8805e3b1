"""The sliding window: the last keyframes with the points they show, refined together."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.blas_threads import blas_threads_for
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.loss import StudentT, robust_sigma
from omnisight.sfm.bundle_adjustment import POSE, Bundle
from omnisight.sfm.structure import RayObservations, Structure
from omnisight.twoview.triangulation import triangulate
from omnisight.visual_odometry.marginalization import PosePrior, marginalize_first
from omnisight.visual_odometry.ray_observations import FrameRays

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

# Steps of a bundle adjustment, which starts near its optimum, and expected decrease at which it ends.
MAX_ITERATIONS, TOLERANCE = 4, 1e-4
# Damping at the start, near the optimum.
INITIAL_DAMPING = 1e-6
# Degrees of freedom of the residuals: tails for points on edges of objects, which move along them.
DEGREES = 4.0
# Residuals (scales of their distribution) of rays that do not see the point.
OUTLIER_SIGMA = 5.0


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A frame whose rays determine points.

    Attributes
    ----------
    index
        Index of the frame in the sequence.
    rig_from_world
        Its pose.
    images
        Gray images (H, W) of its cameras.
    """

    index: int
    rig_from_world: Pose
    images: tuple[NDArray[np.uint8], ...] = ()


@dataclass(frozen=True, eq=False)
class WindowRays:
    """Rays of the keyframes of a window, sorted by patch and keyframe.

    Attributes
    ----------
    frame
        (M,) keyframe of each.
    is_cross
        (M,) whether it is of another camera than the one that tracks the patch: these rays determine the scale.
    rays
        (M) the rays.
    """

    frame: Indices
    is_cross: Mask
    rays: FrameRays

    @classmethod
    def none(cls) -> "WindowRays":
        """Return no rays."""
        return cls(np.zeros(0, np.intp), np.zeros(0, np.bool_), FrameRays.none())

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, use: Mask | Indices) -> "WindowRays":
        return WindowRays(self.frame[use], self.is_cross[use], self.rays[use])

    def joined(self, rays: FrameRays, frame: int, *, is_cross: bool = False) -> "WindowRays":
        """Return these rays and those of the last keyframe."""
        if not len(rays):
            return self
        both = WindowRays(
            np.append(self.frame, np.full(len(rays), frame)),
            np.append(self.is_cross, np.full(len(rays), is_cross)),
            self.rays.joined(rays),
        )
        return both[np.argsort(both.rays.number, kind="stable")]


class KeyframeWindow:
    """The last keyframes, their points, and what is known from earlier ones.

    Attributes
    ----------
    keyframes
        In the order of time.
    number, points
        (P,) numbers of the patches of points (P, 3) in the world.
    """

    def __init__(self, keyframe: Keyframe, rays: FrameRays, prior: PosePrior, size: int) -> None:
        """Start with a keyframe, its rays, and a prior of the first poses; `size` keyframes are kept."""
        self.keyframes = [keyframe]
        self.number, self.points = np.zeros(0, np.intp), np.zeros((0, 3))
        self._rays = WindowRays.none().joined(rays, 0)
        self._prior, self._size = prior, size
        self._loss = StudentT(DEGREES)

    def add(self, keyframe: Keyframe, rays: FrameRays, others: FrameRays, tracked: Indices) -> None:
        """Add a keyframe, refine the window, and marginalize what leaves it.

        Parameters
        ----------
        keyframe
            The keyframe.
        rays
            Rays of patches that agree with its pose.
        others
            Rays of the same patches in further cameras.
        tracked
            Numbers of the patches that are still tracked.
        """
        last = len(self.keyframes)
        self.keyframes.append(keyframe)
        self._rays = self._rays.joined(rays, last).joined(others, last, is_cross=True)
        with blas_threads_for(POSE * len(self.keyframes)):
            self.triangulate()
            self.optimize()
            if len(self.keyframes) > self._size:
                self._marginalize(tracked)

    def extend_last(self, rays: FrameRays, images: tuple[NDArray[np.uint8], ...]) -> None:
        """Add rays of new patches and the images to the last keyframe."""
        self._rays = self._rays.joined(rays, len(self.keyframes) - 1)
        self.keyframes[-1] = replace(self.keyframes[-1], images=images)

    @property
    def last_rays(self) -> FrameRays:
        """The rays of patches of the last keyframe."""
        return self._rays.rays[(self._rays.frame == len(self.keyframes) - 1) & ~self._rays.is_cross]

    @property
    def highest_number(self) -> int:
        """The highest number of a patch with rays; -1 without any."""
        return int(self._rays.rays.number.max(initial=-1))

    def all_rays(self, keyframe: int) -> FrameRays:
        """Return the rays of a keyframe in all cameras."""
        return self._rays.rays[self._rays.frame == keyframe]

    def triangulate(self) -> None:
        """Add the points of patches that have a significant parallax."""
        own = self._rays[~self._rays.is_cross]
        seen, count = np.unique(own.rays.number, return_counts=True)
        new = np.setdiff1d(seen[count >= 2], self.number, assume_unique=True)
        if not len(new):
            return
        row = np.searchsorted(new, own.rays.number)
        use = np.append(new, -1)[row] == own.rays.number
        row, own = row[use], own[use]
        bearings, origins = np.full((2, len(self.keyframes), len(new), 3), np.nan)
        bearings[own.frame, row], origins[own.frame, row] = own.rays.bearings, own.rays.origins
        sigma = float(np.degrees(np.sqrt(np.median(own.rays.variance)))) * self._loss.sigma
        poses = [keyframe.rig_from_world for keyframe in self.keyframes]
        found = triangulate(poses, bearings, sigma_deg=sigma, origins=origins)
        use = found.valid & (found.residual_deg < OUTLIER_SIGMA * sigma)
        number = np.concatenate([self.number, new[use]])
        order = np.argsort(number)
        self.number, self.points = number[order], np.concatenate([self.points, found.points[use]])[order]

    def optimize(self) -> None:
        """Refine poses and points, and remove rays that do not agree with them."""
        bundle, rows = self._bundle(self.number)
        state = minimize(
            bundle, bundle.start, iterations=MAX_ITERATIONS, tolerance=TOLERANCE, damping=INITIAL_DAMPING
        ).state
        self._take(state)
        squares = state.squared_residuals(bundle.rays)
        keep = np.ones(len(self._rays), np.bool_)
        keep[rows[squares > (OUTLIER_SIGMA * self._loss.sigma) ** 2]] = False
        self._loss = _loss(squares, bundle.rays.point)
        self._rays = self._rays[keep]
        self._remove_points()

    def _take(self, state: Structure) -> None:
        """Set the poses and points of a structure."""
        self.points = state.points
        self.keyframes = [
            replace(keyframe, rig_from_world=Pose.of_matrix(matrix))
            for keyframe, matrix in zip(self.keyframes, state.rig_from_world, strict=True)
        ]

    def _remove_points(self) -> None:
        """Remove points with fewer than two rays."""
        first, last = (np.searchsorted(self._rays.rays.number, self.number, side) for side in ("left", "right"))
        keep = last - first >= 2
        self.number, self.points = self.number[keep], self.points[keep]

    def _bundle(self, number: Indices) -> tuple[Bundle, Indices]:
        """Return the problem of some of the points, and the indices (M,) of its rays."""
        rays = self._rays.rays
        point = np.searchsorted(number, rays.number)
        use = np.flatnonzero(np.append(number, -1)[point] == rays.number)
        frame, sensor = self._rays.frame[use], np.zeros(len(use), np.intp)
        observed = RayObservations(frame, sensor, point[use], rays.origins[use], rays.bearings[use], rays.axes[use])
        poses = np.array([keyframe.rig_from_world.matrix for keyframe in self.keyframes])
        start = Structure(poses, np.eye(3, 4)[None], self.points[np.searchsorted(self.number, number)])
        return Bundle(observed, self._loss, start, measured=self._prior), use

    def _marginalize(self, tracked: Indices) -> None:
        """Replace the first keyframe, and its points that are not tracked any more, by a prior.

        Points that are still tracked lose their ray in that keyframe: eliminating them would join all poses, and later
        rays could not improve them (S. Leutenegger et al., Keyframe-based visual-inertial odometry, IJRR 2015).
        """
        rays = self._rays
        first = rays.rays.number[(rays.frame == 0) & ~rays.is_cross]
        gone = np.intersect1d(np.setdiff1d(self.number, tracked), first)
        bundle, _ = self._bundle(gone)
        self._prior = marginalize_first(bundle, self._prior)
        self.keyframes = self.keyframes[1:]
        keep = ~np.isin(self.number, gone)
        self.number, self.points = self.number[keep], self.points[keep]
        kept = rays[(rays.frame > 0) & ~np.isin(rays.rays.number, gone)]
        self._rays = replace(kept, frame=kept.frame - 1)
        self._remove_points()


def _loss(squares: Array, point: Indices) -> StudentT:
    """Return the distribution of squared residuals (M,) after an adjustment, by their median.

    Of the 2 M residuals of the rays, three per point are zero by the choice of the point.
    """
    freedom = max(1.0 - 1.5 * len(np.unique(point)) / max(len(point), 1), 0.25)
    return StudentT(DEGREES, robust_sigma(np.sqrt(squares)) / np.sqrt(freedom))
