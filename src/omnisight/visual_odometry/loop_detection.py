"""Detection of loops: places that were seen before, verified by their geometry."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.features import match_features
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import RobustEstimate, estimate_robustly
from omnisight.places import PlaceIndex
from omnisight.places.verification import agreeing_directions
from omnisight.twoview.bearing_pairs import isotropic_variance
from omnisight.twoview.triangulation import triangulate, whitening
from omnisight.visual_odometry.keyframe_history import KeyframeHistory, KeyframePlace
from omnisight.visual_odometry.loop_result import Loop

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

# Number of places before a place that are no loops, because they show the same scene; but they are after lost tracking.
RECENT_PLACES = 10
# Similar places that are verified for each place.
CANDIDATES = 3
# Matches that must agree with a pose, and their share.
MIN_INLIERS, MIN_SHARE = 20, 0.3
# Least share of the directions with points in which there are inliers: in a town of repeated fronts, the median is 0.33
# for wrong places, and 0.89 for true ones.
MIN_DIRECTIONS = 0.5
# Places before and after, among which another loop must agree: rotation, position relative to the distance of the
# points, and logarithm of the scale.
NEIGHBOURS, MAX_ANGLE_RAD, MAX_DISTANCE, MAX_LOG_SCALE = 4, np.radians(3.0), 0.15, 0.15
# Points with known distances in both places, which determine the scale.
MIN_COMMON = 6
# Residual, standard deviations, up to which rays of neighbouring places meet.
MAX_RESIDUAL_SIGMA = 4.0
# 2000 samples of three contain one of inliers only, with 99 % probability, if 13 % of the matches are inliers.
SEARCH = RansacOptions(max_iterations=2000)


@dataclass(frozen=True, eq=False)
class MappedPlace(KeyframePlace):
    """A place with the points of its keypoints.

    Attributes
    ----------
    points, covariance
        (N, 3) in the frame of the rig, NaN where unknown, and (N, 3, 3).
    """

    points: Array
    covariance: Array

    @classmethod
    def of(cls, place: KeyframePlace) -> Self:
        """Return a place without points."""
        count = len(place.keypoints)
        return cls(
            place.keyframe, place.keypoints, place.origins, np.full((count, 3), np.nan), np.full((count, 3, 3), np.inf)
        )

    @property
    def is_known(self) -> Mask:
        """Which points (N,) are known."""
        return np.isfinite(self.points[:, 0])

    @property
    def distance(self) -> float:
        """Median distance of the points; NaN without any."""
        known = self.points[self.is_known]
        return float(np.median(np.linalg.norm(known, axis=1))) if len(known) else float("nan")

    def set_points(self, rows: Indices, points: Array, covariance: Array) -> None:
        """Set points (K, 3) that are more accurate than the known ones."""
        is_better = np.trace(covariance, axis1=1, axis2=2) < np.trace(self.covariance[rows], axis1=1, axis2=2)
        rows = rows[is_better]
        self.points[rows], self.covariance[rows] = points[is_better], covariance[is_better]


@dataclass(frozen=True, eq=False)
class DetectedLoop:
    """A place that shows the points of an earlier one.

    Attributes
    ----------
    a, b
        Numbers of the earlier and of the later place.
    a_from_b
        Pose of the rig, in the unit at a.
    scale
        Unit at b in that at a.
    pairs
        (M, 2) keypoints that agree.
    noise
        Standard deviation of the rays over that of the keypoints.
    loop
        What is reported.
    """

    a: int
    b: int
    a_from_b: Pose
    scale: float
    pairs: Indices
    noise: float
    loop: Loop


class LoopDetector:
    """Places of a sequence, among which loops are detected.

    Attributes
    ----------
    has_scale
        Whether the scale of odometry is known.
    places
        The places, with points.
    neighbours
        For each place but the first the pairs (M, 2) of keypoints of the place before and of it that see one point.
    loops
        Loops that another loop near them confirms.
    """

    def __init__(self, history: KeyframeHistory, *, has_scale: bool) -> None:
        """Triangulate the points of places, and detect loops among them."""
        self._history, self.has_scale = history, has_scale
        places = history.places()
        self.places = [MappedPlace.of(place) for place in places]
        self.neighbours = [self._triangulate(k) for k in range(1, len(places))]
        self._index = PlaceIndex()
        candidates = [loop for b in range(len(places)) for loop in self._candidates(b)]
        self.loops = [loop for loop in candidates if any(self._agree(loop, other) for other in candidates)]

    def _triangulate(self, k: int) -> Indices:
        """Triangulate the matches of a place with the one before; return those with a point."""
        ends = self.places[k - 1], self.places[k]
        rows = [end.keyframe for end in ends]
        if self._history.segments[rows[0]] != self._history.segments[rows[1]]:
            return np.zeros((0, 2), np.intp)
        keypoints = ends[0].keypoints, ends[1].keypoints
        pairs = match_features(*keypoints).pairs
        if not len(pairs):
            return pairs
        rig_from_world = [self._history.poses[row] for row in rows]
        of_pairs = [keypoint[pairs[:, side]] for side, keypoint in enumerate(keypoints)]
        origins = np.stack([end.origins[pairs[:, side]] for side, end in enumerate(ends)])
        bearings, covariance = (
            np.stack([getattr(each, name) for each in of_pairs]) for name in ("bearings", "covariance")
        )
        found = triangulate(rig_from_world, bearings, covariance, origins=origins)
        sigma = np.sqrt(np.trace(covariance, axis1=2, axis2=3).mean(axis=0) / 2)
        use = found.valid & (np.radians(found.residual_deg) < MAX_RESIDUAL_SIGMA * sigma)
        for side, end in enumerate(ends):
            rotation = rig_from_world[side].rotation
            points = rig_from_world[side] @ found.points[use]
            end.set_points(pairs[use, side], points, rotation @ found.covariance[use] @ rotation.T)
        return pairs[use]

    def _candidates(self, b: int) -> list[DetectedLoop]:
        """Return the similar places before one that agree with its geometry, and add it to the index."""
        words = self._index.words(self.places[b].keypoints)
        similar = self._index.query_words(words, CANDIDATES, before=max(b - RECENT_PLACES, self._before_loss(b)))
        self._index.add_words(words)
        found = [self._verify(place.image, b) for place in similar]
        return [loop for loop in found if loop is not None]

    def _before_loss(self, b: int) -> int:
        """Return the number of places before the last loss of tracking before a place."""
        keyframes = [each.keyframe for each in self.places]
        loss = max(row for row in self._history.losses if row <= keyframes[b])
        return sum(row < loss for row in keyframes)

    def _verify(self, a: int, b: int) -> DetectedLoop | None:
        """Return the loop if the keypoints of a place agree with the points of an earlier one."""
        first, last = self.places[a], self.places[b]
        pairs = match_features(first.keypoints, last.keypoints).pairs
        pairs = pairs[first.is_known[pairs[:, 0]]]
        found = _resect(first, last, pairs)
        inliers = int(found.inliers.sum())
        if found.model is None or inliers < max(MIN_INLIERS, MIN_SHARE * len(pairs)):
            return None
        pairs, b_from_a = pairs[found.inliers], Pose.of_matrix(found.model)
        bearings = last.keypoints.bearings
        directions = agreeing_directions(bearings[last.is_known], bearings[pairs[:, 1]])
        scale = 1.0 if self.has_scale else _relative_scale(first, last, pairs, b_from_a)
        if directions < MIN_DIRECTIONS or not np.isfinite(scale):
            return None
        before, now = (self._history.frames[end.keyframe] for end in (first, last))
        a_from_b = b_from_a.inverse()
        loop = Loop(before, now, a_from_b, scale, len(found.inliers), inliers, directions)
        return DetectedLoop(a, b, a_from_b, scale, pairs, found.scale, loop)

    def _agree(self, loop: DetectedLoop, other: DetectedLoop) -> bool:
        """Return whether a loop of neighbouring places implies the same pose."""
        if other.b == loop.b or max(abs(other.a - loop.a), abs(other.b - loop.b)) > NEIGHBOURS:
            return False
        to_a, from_b = self._relative(loop.a, other.a), self._relative(other.b, loop.b)
        if to_a is None or from_b is None:
            return False
        moved = Pose(from_b.rotation, other.scale * from_b.translation)
        change = loop.a_from_b.inverse() @ (to_a @ other.a_from_b @ moved)
        distance = float(np.linalg.norm(change.translation)) / self.places[loop.a].distance
        angle = float(np.linalg.norm(so3.log(change.rotation)))
        return (
            angle < MAX_ANGLE_RAD and distance < MAX_DISTANCE and abs(np.log(loop.scale / other.scale)) < MAX_LOG_SCALE
        )

    def _relative(self, a: int, b: int) -> Pose | None:
        """Return the pose a_from_b of two places, if odometry determines it."""
        rows = self.places[a].keyframe, self.places[b].keyframe
        if self._history.segments[rows[0]] != self._history.segments[rows[1]]:
            return None
        return self._history.poses[rows[0]] @ self._history.poses[rows[1]].inverse()


def _resect(first: MappedPlace, last: MappedPlace, pairs: Indices) -> RobustEstimate:
    """Estimate the pose last_from_first from the points of the first place and the rays of the last one."""
    from omnisight.visual_odometry._ray_pose_kernel import RayPoseProblem

    seen = last.keypoints[pairs[:, 1]]
    points, origins = first.points[pairs[:, 0]], last.origins[pairs[:, 1]]
    axes, variance = whitening(seen.covariance), isotropic_variance(seen.covariance)

    def problem(scale: float) -> RayPoseProblem:
        return RayPoseProblem(points, origins, seen.bearings, axes / scale, scale**2 * variance)

    return estimate_robustly(problem, is_scale_known=False, options=SEARCH)


def _relative_scale(first: MappedPlace, last: MappedPlace, pairs: Indices, last_from_first: Pose) -> float:
    """Return the unit at the last place in that at the first, from points known at both; NaN if there are few."""
    pairs = pairs[last.is_known[pairs[:, 1]]]
    if len(pairs) < MIN_COMMON:
        return float("nan")
    of_first = np.linalg.norm(last_from_first @ first.points[pairs[:, 0]], axis=1)
    return float(np.median(of_first / np.linalg.norm(last.points[pairs[:, 1]], axis=1)))
