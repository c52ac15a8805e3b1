"""Global bundle adjustment of keyframes, with the loops that were closed."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from omnisight.optim.loss import StudentT, robust_sigma
from omnisight.optim.pose_graph import Similarities
from omnisight.sfm.bundle_adjustment import Bundle, adjust_bundle
from omnisight.sfm.incidence import grouped
from omnisight.sfm.structure import RayObservations, Structure
from omnisight.twoview.triangulation import whitening
from omnisight.visual_odometry.keyframe_history import KeyframeHistory
from omnisight.visual_odometry.loop_detection import DetectedLoop, LoopDetector
from omnisight.visual_odometry.ray_observations import FrameRays

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Keyframes that are adjusted together: the reduced normal equations of as many are solved in seconds. Of more, places
# and evenly distributed others are selected; the rest keep their poses relative to these.
MAX_KEYFRAMES = 600
# Degrees of freedom of the residuals, and residuals of rays that do not see the point, as in the sliding window.
DEGREES, OUTLIER_SIGMA = 4.0, 5.0
# Adjustments, each followed by the removal of outliers, and the expected decrease of the cost at which they end.
ROUNDS, TOLERANCE = 2, 1e-4
# Least scale of the residuals, standard deviations of the rays.
MIN_SIGMA = 1e-3


def adjust_globally(
    history: KeyframeHistory, detector: LoopDetector, loops: Sequence[DetectedLoop], nodes: Similarities
) -> tuple[Indices, Similarities]:
    """Refine keyframes and points by the rays of patches, and of the keypoints that places and loops have in common.

    Parameters
    ----------
    history
        The keyframes.
    detector, loops
        Places, and the correct loops among them.
    nodes
        (N) the keyframes in the world of the pose graph, which is kept for the first one.

    Returns
    -------
    The rows of the adjusted keyframes, and these.
    """
    rows = _selected(len(history), [place.keyframe for place in detector.places])
    parts = [_patches(history, nodes, rows), _keypoints(detector, loops, nodes, rows)]
    bundle = _bundle(parts, nodes[rows], has_scale=detector.has_scale)
    for _ in range(ROUNDS):
        bundle = _adjusted(bundle)
    poses = bundle.start.rig_from_world
    rotation = np.swapaxes(poses[:, :, :3], 1, 2)
    position = -np.einsum("nij,nj->ni", rotation, poses[:, :, 3])
    return rows, Similarities(rotation, position, nodes.log_scale[rows])


def _adjusted(bundle: Bundle) -> Bundle:
    """Return the problem without outliers, with the adjusted structure as its start."""
    squares = bundle.start.squared_residuals(bundle.rays)
    bundle = replace(bundle, loss=StudentT(DEGREES, max(robust_sigma(np.sqrt(squares)), MIN_SIGMA)))
    poses, points = bundle.start.rig_from_world.copy(), bundle.start.points.copy()
    for frames, of_part, part in _connected_parts(bundle):
        adjusted = adjust_bundle(part, tolerance=TOLERANCE).state
        poses[frames], points[of_part] = adjusted.rig_from_world, adjusted.points
    return _without_outliers(replace(bundle, start=replace(bundle.start, rig_from_world=poses, points=points)))


def _connected_parts(bundle: Bundle) -> Iterator[tuple[Indices, Indices, Bundle]]:
    """Yield frames, points and problem of each part whose frames are connected by points.

    The rays do not determine place, orientation and scale of a part in the world: each keeps its own.
    """
    rays, start, count = bundle.rays, bundle.start, len(bundle.start.rig_from_world)
    links = coo_array((np.ones(len(rays)), (rays.frame, count + rays.point)), shape=(count + len(start.points),) * 2)
    label = connected_components(links, directed=False)[1]
    for _, of_part in grouped(label[rays.frame]):
        frames, frame = np.unique(rays.frame[of_part], return_inverse=True)
        points, point = np.unique(rays.point[of_part], return_inverse=True)
        if len(frames) > 1:
            observed = replace(rays[of_part], frame=frame, point=point)
            known = replace(start, rig_from_world=start.rig_from_world[frames], points=start.points[points])
            yield frames, points, replace(bundle, rays=observed, start=known)


def _selected(count: int, places: Sequence[int]) -> Indices:
    """Return the keyframes to adjust, sorted."""
    others = np.rint(np.linspace(0, count - 1, min(count, max(MAX_KEYFRAMES - len(places), 2)))).astype(np.intp)
    return np.union1d(others, np.array(places, np.intp)) if count > MAX_KEYFRAMES else np.arange(count)


def _patches(history: KeyframeHistory, nodes: Similarities, rows: Indices) -> tuple[FrameRays, Indices]:
    """Return the rays of patches with points in the world of the nodes, and their frames among the rows."""
    parts, frames = list[FrameRays](), list[Indices]()
    moved = np.full(history.points.shape, np.nan)
    for frame, row in enumerate(rows):
        rays = history.rays(int(row))
        rays = rays[rays.has_point]
        new = np.isnan(moved[rays.number, 0])
        moved[rays.number[new]] = _in_world(nodes, int(row), history.poses[row] @ rays.points[new])
        parts.append(replace(rays, points=moved[rays.number]))
        frames.append(np.full(len(rays), frame, np.intp))
    return _concatenated(parts), np.concatenate(frames)


def _keypoints(
    detector: LoopDetector, loops: Sequence[DetectedLoop], nodes: Similarities, rows: Indices
) -> tuple[FrameRays, Indices]:
    """Return the rays of keypoints that several places show, with points in the world, and their frames."""
    places = detector.places
    offsets = np.concatenate([[0], np.cumsum([len(place.points) for place in places])])
    pairs = [pairs + offsets[[k, k + 1]] for k, pairs in enumerate(detector.neighbours)]
    pairs += [loop.pairs + offsets[[loop.a, loop.b]] for loop in loops]
    a, b = np.concatenate([np.zeros((0, 2), np.intp), *pairs]).T
    links = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(int(offsets[-1]),) * 2)
    track = connected_components(links, directed=False)[1]
    points = np.full((int(track.max(initial=-1)) + 1, 3), np.nan)
    parts, frames = list[FrameRays](), list[Indices]()
    for k, place in enumerate(places):
        number = track[offsets[k] : offsets[k + 1]]
        first = np.zeros(len(number), np.bool_)
        first[np.unique(number, return_index=True)[1]] = True
        new = place.is_known & np.isnan(points[number, 0])
        points[number[new]] = _in_world(nodes, place.keyframe, place.points[new])
        seen = place.keypoints
        rays = FrameRays(number, points[number], place.origins, seen.bearings, whitening(seen.covariance))
        parts.append(rays[first & np.isin(number, track[np.concatenate([a, b])])])
        frames.append(np.full(len(parts[-1]), np.searchsorted(rows, place.keyframe), np.intp))
    rays = _concatenated(parts)
    rays = replace(rays, points=points[rays.number])
    return rays[rays.has_point], np.concatenate(frames)[rays.has_point]


def _bundle(parts: Sequence[tuple[FrameRays, Indices]], nodes: Similarities, *, has_scale: bool) -> Bundle:
    """Return the problem of rays, whose numbers are those of different points in each part."""
    offset, numbers = 0, list[Indices]()
    for rays, _ in parts:
        numbers.append(rays.number + offset)
        offset += int(rays.number.max(initial=-1)) + 1
    rays, frame = _concatenated([rays for rays, _ in parts]), np.concatenate([frames for _, frames in parts])
    number = np.concatenate(numbers)
    order = np.argsort(number, kind="stable")
    first, point = np.unique(number[order], return_index=True, return_inverse=True)[1:]
    rotation = np.swapaxes(nodes.rotation, 1, 2)
    poses = np.concatenate([rotation, -(rotation @ nodes.position[:, :, None])], axis=2)
    start = Structure(poses, np.eye(3, 4)[None], rays.points[order][first])
    observed = RayObservations(
        frame[order], np.zeros(len(order), np.intp), point, rays.origins[order], rays.bearings[order], rays.axes[order]
    )
    return _with_two_rays(Bundle(observed, StudentT(DEGREES), start, has_scale=has_scale))


def _without_outliers(bundle: Bundle) -> Bundle:
    """Return the problem without rays that do not agree with their points."""
    squares = bundle.start.squared_residuals(bundle.rays)
    return _with_two_rays(replace(bundle, rays=bundle.rays[squares < (OUTLIER_SIGMA * bundle.loss.sigma) ** 2]))


def _with_two_rays(bundle: Bundle) -> Bundle:
    """Return the problem without points that fewer than two rays see."""
    rays = bundle.rays
    keep = np.bincount(rays.point, minlength=len(bundle.start.points)) >= 2
    rays = rays[keep[rays.point]]
    rays = replace(rays, point=(np.cumsum(keep) - 1)[rays.point])
    return replace(bundle, rays=rays, start=replace(bundle.start, points=bundle.start.points[keep]))


def _in_world(nodes: Similarities, row: int, points: Array) -> Array:
    """Return points (N, 3) of the frame of a node in the world."""
    return np.exp(nodes.log_scale[row]) * points @ nodes.rotation[row].T + nodes.position[row]


def _concatenated(parts: Sequence[FrameRays]) -> FrameRays:
    """Return the rays of all parts."""
    names = "number", "points", "origins", "bearings", "axes"
    return FrameRays(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
