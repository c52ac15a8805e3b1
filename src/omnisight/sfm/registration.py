"""Registration of further frames in a map, by resection from its points."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import triu

from omnisight.features import Keypoints, match_features
from omnisight.geometry.pose import Pose
from omnisight.parallel import parallel_map
from omnisight.sfm.common_points import common_points
from omnisight.sfm.incidence import grouped
from omnisight.sfm.map import Map
from omnisight.sfm.map_points import tracks_of_edges, with_triangulated_points
from omnisight.sfm.missing_matches import KnownPoints, PredictedMatches, predicted_matches
from omnisight.sfm.view_graph import MIN_INLIERS, Edge
from omnisight.twoview.absolute_pose import resect
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import known_relative_pose

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Largest distance of the descriptors of a match relative to that of the second nearest: any. Of the matches of repeated
# structure few are right, but those of all images together determine a pose. Of a set of photos of a checkerboard in
# front of white walls and seven subsets of it, 33 images are verified without registration by them, 49 with it, and no
# wrong one.
RATIO = 1.0


class RegisteredFrames(NamedTuple):
    """Frames that were registered.

    Attributes
    ----------
    frames
        (J,) indices.
    rig_from_world
        Their poses (J, 3, 4).
    edges
        Matches with images of the map that agree with the poses.
    """

    frames: Indices
    rig_from_world: Array
    edges: list[Edge]


class _RegisteredImage(NamedTuple):
    """An image that was registered in a map.

    Attributes
    ----------
    image
        Its index.
    cam_from_world
        Its pose.
    keypoint, point
        (M,) matches that agree with the pose; several can be of one keypoint and point.
    other, other_keypoint
        (M,) the images of the map, and their keypoints, through which they were matched.
    """

    image: int
    cam_from_world: Pose
    keypoint: Indices
    point: Indices
    other: Indices
    other_keypoint: Indices

    @property
    def support(self) -> int:
        """Number of points that agree with the pose."""
        return len(np.unique(self.point))


def register_frames(
    found: Map, edges: Sequence[Edge], before: Indices, keypoints: Sequence[Keypoints]
) -> RegisteredFrames:
    """Estimate poses of the frames that a map lacks, and of those that are not verified, from its verified frames.

    A point determines two coordinates of an image, where another image determines one, and the points of all images
    count together: matches that are too few for a relative pose with any image can determine a pose in the map. Each
    frame is registered by its image with most points. A pose that is not verified can rest on one wrong relative pose:
    it is replaced if more points agree with another one. From the pose of a place that looks alike, other points of the
    map would be visible too, and do not match.

    Parameters
    ----------
    found
        The map; all its frames count as verified if none is.
    edges
        Matches of its points.
    before
        Frames that are left as they are.
    keypoints
        Keypoints of all images.
    """
    is_known = found.is_verified if len(found.verified) else np.ones(len(found.frames), bool)
    least = _verified_points(found)
    least[np.append(before, found.frames[is_known])] = -1
    compared = _compared_images(found, is_known, least >= 0)
    if not compared:
        return RegisteredFrames(np.zeros(0, np.intp), np.zeros((0, 3, 4)), [])
    near = np.unique(np.concatenate([found.row_of_image[others] for others in compared.values()]))
    known = _with_all_matches(found.with_frames(np.isin(np.arange(len(is_known)), near)), edges, keypoints)
    best = dict[int, _RegisteredImage]()
    for new in parallel_map(lambda image: _resect(known, image, compared[image], keypoints), sorted(compared)):
        if new is None:
            continue
        frame = int(known.images.frame[new.image])
        beyond = best[frame].support if frame in best else least[frame]
        if new.support > beyond and not _is_contradicted(known, new, compared[new.image], keypoints):
            best[frame] = new
    poses = np.array([_rig_from_world(known, new) for new in best.values()]).reshape(-1, 3, 4)
    new_edges = [edge for new in best.values() for edge in _edges(known, new)]
    return RegisteredFrames(np.array(list(best), np.intp), poses, new_edges)


def _verified_points(found: Map) -> Indices:
    """Return how many points of two verified frames or more each of all frames observes."""
    tracks, rows = found.tracks, found.row_of_image[found.tracks.image]
    is_verified = np.bincount(tracks.track, found.is_verified[rows], minlength=len(tracks)) >= 2
    return np.bincount(found.frames[rows], is_verified[tracks.track], minlength=found.images.frames).astype(np.intp)


def _compared_images(found: Map, is_known: NDArray[np.bool_], is_wanted: NDArray[np.bool_]) -> dict[int, list[int]]:
    """Return the images of some frames (F,) of a map that each image of other frames was compared with."""
    compared, rows = dict[int, list[int]](), found.row_of_image
    for pair in found.graph.compared:
        for image, other in (pair, pair[::-1]):
            if is_wanted[found.images.frame[image]] and rows[other] >= 0 and is_known[rows[other]]:
                compared.setdefault(image, []).append(other)
    return compared


def _with_all_matches(known: Map, edges: Sequence[Edge], keypoints: Sequence[Keypoints]) -> Map:
    """Return a map with the points of all matches that agree with its poses, of images with a point in common."""

    def edge(pair: Sequence[int]) -> Edge:
        a, b = pair
        b_from_a = known.cam_from_world(b) @ known.cam_from_world(a).inverse()
        matches = match_features(keypoints[a], keypoints[b], RATIO).pairs
        return _known_edge(a, b, b_from_a, _agreeing(known, keypoints, (a, b), b_from_a, matches))

    common = triu(common_points(len(keypoints), known.tracks.image, known.tracks.track), 1).tocoo()
    pairs, frame = np.column_stack([common.row, common.col]), known.images.frame
    further = parallel_map(edge, pairs[frame[common.row] != frame[common.col]].tolist())
    return with_triangulated_points(known, tracks_of_edges(known, [*edges, *further]))


def _agreeing(
    known: Map, keypoints: Sequence[Keypoints], images: tuple[int, int], b_from_a: Pose, pairs: Indices
) -> Indices:
    """Return the matches (N, 2) of two images that agree with their relative pose.

    Keypoints outside of the domain of a refined camera have no bearing.
    """
    a, b = images
    rays_a, rays_b = (known.images.bearings_of(image) for image in images)
    pairs = pairs[np.any(rays_a[pairs[:, 0]], axis=1) & np.any(rays_b[pairs[:, 1]], axis=1)]
    in_a, in_b = pairs.T
    covariances = keypoints[a].covariance[in_a], keypoints[b].covariance[in_b]
    both = BearingPairs.of(rays_a[in_a], rays_b[in_b], *covariances, None).scaled(known.noise.sigma)
    return pairs[known_relative_pose(both, b_from_a).inliers]


def _known_edge(a: int, b: int, b_from_a: Pose, pairs: Indices) -> Edge:
    """Return the edge of two images whose relative pose is known."""
    return Edge(a, b, b_from_a, np.zeros((6, 6)), "general", pairs)


def _resect(known: Map, image: int, others: Sequence[int], keypoints: Sequence[Keypoints]) -> _RegisteredImage | None:
    """Return an image with its pose by the points of other images of a map; None if too few agree with a pose."""
    bearings, parts = known.images.bearings_of(image), [np.zeros((0, 4), np.intp)]
    usable = np.flatnonzero(bearings.any(axis=1))
    of_image = keypoints[image][usable]
    for other in sorted(known.observations.keys() & others):
        points, observed = known.observations[other]
        i, j = match_features(of_image, keypoints[other][observed], RATIO).pairs.T
        parts.append(np.column_stack([usable[i], points[j], np.full(len(i), other), observed[j]]))
    matches = np.concatenate(parts)
    unique, of_match = np.unique(matches[:, :2], axis=0, return_inverse=True)
    pose = resect(known.points[unique[:, 1]], bearings[unique[:, 0]])
    if pose.cam_from_world is None:
        return None
    new = _RegisteredImage(image, pose.cam_from_world, *matches[pose.inliers[of_match.reshape(-1)]].T)
    return new if new.support >= MIN_INLIERS else None


def _is_contradicted(known: Map, new: _RegisteredImage, others: Sequence[int], keypoints: Sequence[Keypoints]) -> bool:
    """Return whether more matches of a registered image with others are missing than agree.

    Far points have no known distance: the matches of relative poses count too.
    """
    distances = np.linalg.norm(new.cam_from_world @ known.points[new.point], axis=1)
    points = KnownPoints.of(known.images.bearings_of(new.image), new.keypoint, distances)

    def prediction(other: int) -> PredictedMatches:
        of_other, observed = known.observations[other]
        _, i, j = np.intersect1d(new.point, of_other, return_indices=True)
        other_from_image = known.cam_from_world(other) @ new.cam_from_world.inverse()
        of_edge = known.graph.matches_of(new.image, other)
        agreeing = _agreeing(known, keypoints, (new.image, other), other_from_image, of_edge)
        pairs = np.unique(np.concatenate([agreeing, np.column_stack([new.keypoint[i], observed[j]])]), axis=0)
        return predicted_matches(points, known.known_points[other], other_from_image, pairs)

    predictions = [prediction(other) for other in others if other in known.observations]
    expected = known.graph.repeatability * sum(each.predicted for each in predictions)
    found = sum(each.found for each in predictions)
    return expected - found > found


def _rig_from_world(known: Map, new: _RegisteredImage) -> Array:
    """Return the pose (3, 4) of the frame of a registered image."""
    of_sensor = Pose.of_matrix(known.sensor_from_rig[known.images.sensor[new.image]])
    return (of_sensor.inverse() @ new.cam_from_world).matrix


def _edges(known: Map, new: _RegisteredImage) -> list[Edge]:
    """Return the matches of a registered image with each image of a map."""
    edges = list[Edge]()
    for other, rows in grouped(new.other):
        other_from_image = known.cam_from_world(other) @ new.cam_from_world.inverse()
        pairs = np.column_stack([new.keypoint[rows], new.other_keypoint[rows]])
        edges.append(_known_edge(new.image, other, other_from_image, pairs))
    return edges
