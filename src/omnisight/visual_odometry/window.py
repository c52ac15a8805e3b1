"""The sliding window: the last keyframes with the points they show, refined together."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.loss import StudentT, robust_sigma
from omnisight.sfm.bundle_adjustment import Bundle
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
    rays
        Rays of patches that agree with the pose.
    images
        Gray images (H, W) of its cameras.
    others
        Rays of the same patches in further cameras, which determine the scale.
    """

    index: int
    rig_from_world: Pose
    rays: FrameRays
    images: tuple[NDArray[np.uint8], ...] = ()
    others: FrameRays = field(default_factory=FrameRays.none)

    @cached_property
    def all_rays(self) -> FrameRays:
        """The rays of all cameras."""
        return self.rays.joined(self.others)

    def keeping(self, use: Mask) -> "Keyframe":
        """Return the keyframe with some of the rays of all cameras."""
        count = len(self.rays)
        return replace(self, rays=self.rays[use[:count]], others=self.others[use[count:]])


class KeyframeWindow:
    """The last keyframes, their points, and what is known from earlier ones.

    Attributes
    ----------
    keyframes
        In the order of time.
    number, points
        (P,) numbers of the patches of points (P, 3) in the world.
    """

    def __init__(self, keyframes: Sequence[Keyframe], prior: PosePrior, size: int) -> None:
        """Start with keyframes and a prior of their poses; `size` keyframes are kept."""
        self.keyframes = list(keyframes)
        self.number, self.points = np.zeros(0, np.intp), np.zeros((0, 3))
        self._prior, self._size = prior, size
        self._loss = StudentT(DEGREES)

    def add(self, keyframe: Keyframe, tracked: Indices) -> None:
        """Add a keyframe, refine the window, and marginalize what leaves it.

        Parameters
        ----------
        keyframe
            The keyframe.
        tracked
            Numbers of the patches that are still tracked.
        """
        self.keyframes.append(keyframe)
        self.triangulate()
        self.optimize()
        if len(self.keyframes) > self._size:
            self._marginalize(tracked)

    def extend_last(self, rays: FrameRays, images: tuple[NDArray[np.uint8], ...]) -> None:
        """Add rays of new patches and the images to the last keyframe."""
        last = self.keyframes[-1]
        new = rays[rays.number > last.rays.number.max(initial=-1)]
        self.keyframes[-1] = replace(last, rays=last.rays.joined(new), images=images)

    def triangulate(self) -> None:
        """Add the points of patches that have a significant parallax."""
        number = np.concatenate([k.rays.number for k in self.keyframes])
        seen, count = np.unique(number, return_counts=True)
        new = np.setdiff1d(seen[count >= 2], self.number)
        if not len(new):
            return
        frames, rows = len(self.keyframes), len(new)
        bearings, origins = np.full((frames, rows, 3), np.nan), np.zeros((frames, rows, 3))
        variance = list[Array]()
        for k, keyframe in enumerate(self.keyframes):
            at = np.minimum(np.searchsorted(new, keyframe.rays.number), rows - 1)
            use = new[at] == keyframe.rays.number
            bearings[k, at[use]], origins[k, at[use]] = keyframe.rays.bearings[use], keyframe.rays.origins[use]
            variance.append(keyframe.rays.variance[use])
        sigma = float(np.degrees(np.sqrt(np.median(np.concatenate(variance))))) * self._loss.sigma
        poses = [keyframe.rig_from_world for keyframe in self.keyframes]
        found = triangulate(poses, bearings, sigma_deg=sigma, origins=origins)
        use = found.valid & (found.residual_deg < OUTLIER_SIGMA * sigma)
        number = np.concatenate([self.number, new[use]])
        order = np.argsort(number)
        self.number, self.points = number[order], np.concatenate([self.points, found.points[use]])[order]

    def optimize(self) -> None:
        """Refine poses and points, and remove rays that do not agree with them."""
        bundle, rows = self._bundle(self.number)
        bundle = replace(bundle, loss=self._loss)
        solution = minimize(
            bundle, bundle.start, iterations=MAX_ITERATIONS, tolerance=TOLERANCE, damping=INITIAL_DAMPING
        )
        state = solution.state
        self._take(state)
        squares = state.squared_residuals(bundle.rays)
        is_outlier = squares > (OUTLIER_SIGMA * self._loss.sigma) ** 2
        self._loss = _loss(squares, bundle.rays.point)
        self._remove(rows[is_outlier], bundle.rays.frame[is_outlier])

    def _take(self, state: Structure) -> None:
        """Set the poses and points of a structure."""
        self.points = state.points
        self.keyframes = [
            replace(keyframe, rig_from_world=Pose.of_matrix(matrix))
            for keyframe, matrix in zip(self.keyframes, state.rig_from_world, strict=True)
        ]

    def _remove(self, rows: Indices, frames: Indices) -> None:
        """Remove rays, given by their row in the rays of their frame, and points with fewer than two others."""
        for k in np.unique(frames):
            keep = np.ones(len(self.keyframes[k].all_rays), np.bool_)
            keep[rows[frames == k]] = False
            self.keyframes[k] = self.keyframes[k].keeping(keep)
        seen, count = np.unique(np.concatenate([k.all_rays.number for k in self.keyframes]), return_counts=True)
        keep = np.isin(self.number, seen[count >= 2])
        self.number, self.points = self.number[keep], self.points[keep]

    def _bundle(self, number: Indices) -> tuple[Bundle, Indices]:
        """Return the problem of some of the points, and the row (M,) of each ray in the rays of its frame."""
        rows, frames, points = list[Indices](), list[Indices](), list[Indices]()
        for k, keyframe in enumerate(self.keyframes):
            seen = keyframe.all_rays.number
            at = np.searchsorted(number, seen)
            use = np.flatnonzero(np.append(number, -1)[at] == seen)
            rows.append(use)
            points.append(at[use])
            frames.append(np.full(len(use), k, np.intp))
        parts = [keyframe.all_rays[use] for keyframe, use in zip(self.keyframes, rows, strict=True)]
        point = np.concatenate(points)
        order = np.argsort(point, kind="stable")
        origins, bearings, axes = (
            np.concatenate([getattr(rays, name) for rays in parts])[order] for name in ("origins", "bearings", "axes")
        )
        frame = np.concatenate(frames)[order]
        rays = RayObservations(frame, np.zeros(len(order), np.intp), point[order], origins, bearings, axes)
        poses = np.array([keyframe.rig_from_world.matrix for keyframe in self.keyframes])
        of_points = self.points[np.searchsorted(self.number, number)]
        start = Structure(poses, np.eye(3, 4)[None], of_points)
        return Bundle(rays, self._loss, start, measured=self._prior), np.concatenate(rows)[order]

    def _marginalize(self, tracked: Indices) -> None:
        """Replace the first keyframe, and its points that are not tracked any more, by a prior.

        Points that are still tracked lose their ray in that keyframe: eliminating them would join all poses, and later
        rays could not improve them (S. Leutenegger et al., Keyframe-based visual-inertial odometry, IJRR 2015).
        """
        first = self.keyframes[0].rays.number
        gone = np.intersect1d(np.setdiff1d(self.number, tracked), first)
        bundle, _ = self._bundle(gone)
        self._prior = marginalize_first(bundle, self._prior)
        self.keyframes = self.keyframes[1:]
        keep = ~np.isin(self.number, gone)
        self.number, self.points = self.number[keep], self.points[keep]
        for k, keyframe in enumerate(self.keyframes):
            self.keyframes[k] = keyframe.keeping(~np.isin(keyframe.all_rays.number, gone))
        self._remove(np.zeros(0, np.intp), np.zeros(0, np.intp))


def _loss(squares: Array, point: Indices) -> StudentT:
    """Return the distribution of squared residuals (M,) after an adjustment, by their median.

    Of the 2 M residuals of the rays, three per point are zero by the choice of the point.
    """
    freedom = max(1.0 - 1.5 * len(np.unique(point)) / max(len(point), 1), 0.25)
    return StudentT(DEGREES, robust_sigma(np.sqrt(squares)) / np.sqrt(freedom))
