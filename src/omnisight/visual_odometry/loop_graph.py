"""The pose graph of keyframes: odometry between consecutive ones, and loops."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.pose_graph import RelativeEdges, Similarities
from omnisight.visual_odometry.keyframe_history import KeyframeHistory
from omnisight.visual_odometry.loop_detection import DetectedLoop, MappedPlace

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Correlation of the errors of the rays of a track, which share the errors of its template and of the shape of its
# surface: in a rendered room, street and town 0.8 in consecutive keyframes, 0.55 to 0.6 eight apart, and 0.4 to 0.44
# sixteen apart. See docs/guide/odometry.md.
TRACK_CORRELATION = 0.6
# Systematic drift of the logarithm of the scale per keyframe: root mean square over ten sequences. Its sign depends on
# the images, and mostly changes in the reverse order.
SCALE_DRIFT = 5e-5
# Errors of a loop besides the noise of its rays: rotation, position relative to the distance of the points, scale.
LOOP_ROTATION_RAD, LOOP_DISTANCE, LOOP_LOG_SCALE = np.radians(0.05), 0.003, 0.003
# Standard deviations of the motion between two segments: rotation, position relative to the largest distance between
# neighbouring keyframes, logarithm of the scale.
CUT_ROTATION_RAD, CUT_DISTANCE, CUT_LOG_SCALE = 1.0, 100.0, 2.0
# Common points from which a relative pose is known.
MIN_COMMON = 6
# Relative standard deviation that is added to the positions of points of a loop.
LOOP_POINT_SIGMA = 1e-3
# Relative standard deviation of the prior of points, which makes the information of points without parallax regular.
POINT_PRIOR_SIGMA = 30.0


def world_from_keyframes(history: KeyframeHistory) -> Similarities:
    """Return the keyframes in the world of odometry."""
    inverse = [pose.inverse() for pose in history.poses]
    rotation, position = (np.array([getattr(p, name) for p in inverse]) for name in ("rotation", "translation"))
    return Similarities(rotation, position, np.zeros(len(history)))


def odometry_edges(history: KeyframeHistory) -> RelativeEdges:
    """Return the relative poses of consecutive keyframes, weighted by the information of their common points."""
    count, nodes = len(history), world_from_keyframes(history)
    a, b = np.arange(count - 1), np.arange(1, count)
    information = point_information(history)
    relative = nodes[a].inverse() @ nodes[b]
    longest = float(np.linalg.norm(relative.position, axis=1).max(initial=1e-9))
    cut = np.diag(1 / np.array([CUT_ROTATION_RAD] * 3 + [CUT_DISTANCE * longest] * 3 + [CUT_LOG_SCALE]))
    roots = [_odometry_root(history, k, information) for k in range(count - 1)]
    root = np.array([cut if each is None else each for each in roots]).reshape(-1, 7, 7)
    return RelativeEdges(a, b, relative, root, np.zeros(count - 1, np.bool_))


def loop_edges(loops: Sequence[DetectedLoop], places: Sequence[MappedPlace]) -> RelativeEdges:
    """Return the relative similarities of loops."""
    a = np.array([places[loop.a].keyframe for loop in loops], np.intp)
    b = np.array([places[loop.b].keyframe for loop in loops], np.intp)
    rotation = np.array([loop.a_from_b.rotation for loop in loops]).reshape(-1, 3, 3)
    position = np.array([loop.a_from_b.translation for loop in loops]).reshape(-1, 3)
    log_scale = np.log([loop.scale for loop in loops])
    root = np.array([_loop_root(loop, places) for loop in loops]).reshape(-1, 7, 7)
    return RelativeEdges(a, b, Similarities(rotation, position, log_scale), root, np.ones(len(loops), np.bool_))


def alignment_information(a_from_b: Pose, scale: float, points: Array, covariance: Array) -> Array:
    """Return the information (7, 7) of points (N, 3) of b on a similarity, given their covariances (N, 3, 3) in a."""
    moved = scale * points @ a_from_b.rotation.T
    derivatives = np.zeros((len(points), 3, 7))
    derivatives[:, :, :3] = -scale * a_from_b.rotation @ so3.hat(points)
    derivatives[:, :, 3:6] = np.eye(3)
    derivatives[:, :, 6] = moved
    return np.asarray(np.einsum("nji,njk->ik", derivatives, np.linalg.solve(covariance, derivatives)), float)


def point_information(history: KeyframeHistory) -> Array:
    """Return the information (P, 3, 3) of the rays of all keyframes about the points of patches.

    Errors of the rays of a track are correlated: n rays have the information of n / (1 + (n - 1) correlation)
    independent ones (the design effect of a cluster, L. Kish, Survey sampling, 1965).
    """
    total, count = np.zeros((len(history.points), 3, 3)), np.zeros(len(history.points))
    for row, pose in enumerate(history.poses):
        rays = history.rays(row)
        rays = rays[rays.has_point]
        distance = np.linalg.norm(pose @ rays.points - rays.origins, axis=1)
        sigma = history.noise[row] * np.maximum(distance, 1e-9)
        derivatives = rays.axes @ pose.rotation / sigma[:, None, None]
        np.add.at(total, rays.number, np.swapaxes(derivatives, 1, 2) @ derivatives)
        np.add.at(count, rays.number, 1.0)
    return total / (1.0 + np.maximum(count - 1.0, 0.0) * TRACK_CORRELATION)[:, None, None]


def _odometry_root(history: KeyframeHistory, k: int, information: Array) -> Array | None:
    """Return the whitening matrix of the relative pose of a keyframe and the next one, None if it is not known.

    Their common points are taken as if their distances from both had independent errors. The drift of the scale is
    systematic: it grows with the number of edges rather than its root. Each edge has the share of its variance that
    makes that over the whole sequence true, because edges are independent in the graph; over parts it is then larger.
    """
    number = np.intersect1d(history.rays(k).number, history.rays(k + 1).number)
    number = number[np.isfinite(history.points[number, 0])]
    if len(number) < MIN_COMMON or history.segments[k] != history.segments[k + 1]:
        return None
    pose, points = history.poses[k], history.points[number]
    at_b = history.poses[k + 1] @ points
    prior = (POINT_PRIOR_SIGMA * np.linalg.norm(at_b, axis=1)) ** 2
    covariance = np.linalg.inv(information[number] + np.eye(3) / prior[:, None, None])
    covariance = 2 * (pose.rotation @ covariance @ pose.rotation.T)
    a_from_b = pose @ history.poses[k + 1].inverse()
    noise = alignment_information(a_from_b, 1.0, at_b, covariance)
    drift = SCALE_DRIFT**2 * (len(history) - 1)
    return _root(noise - np.outer(noise[6], noise[6]) * drift / (1.0 + drift * noise[6, 6]))


def _loop_root(loop: DetectedLoop, places: Sequence[MappedPlace]) -> Array:
    """Return the whitening matrix of a loop, from its points that are known at both places."""
    a, b = places[loop.a], places[loop.b]
    pairs = loop.pairs[b.is_known[loop.pairs[:, 1]]]
    sigma = np.array([LOOP_ROTATION_RAD] * 3 + [LOOP_DISTANCE * a.distance] * 3 + [LOOP_LOG_SCALE])
    if len(pairs) < MIN_COMMON:
        return np.diag(1 / (10 * sigma))
    turn = loop.scale * loop.a_from_b.rotation
    covariance = loop.noise**2 * (a.covariance[pairs[:, 0]] + turn @ b.covariance[pairs[:, 1]] @ turn.T)
    added = (LOOP_POINT_SIGMA * np.linalg.norm(a.points[pairs[:, 0]], axis=1)) ** 2
    covariance = covariance + added[:, None, None] * np.eye(3)
    noise = np.linalg.inv(alignment_information(loop.a_from_b, loop.scale, b.points[pairs[:, 1]], covariance))
    return _root(np.asarray(np.linalg.inv(noise + np.diag(sigma**2)), float))


def _root(information: Array) -> Array:
    """Return the matrix (7, 7) whose square is an information."""
    values, vectors = np.linalg.eigh(information)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
