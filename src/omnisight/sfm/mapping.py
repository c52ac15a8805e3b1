"""Mapping: poses of all frames of a view graph, and the points that their images show."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints
from omnisight.optim.loss import StudentT
from omnisight.parallel import parallel_for
from omnisight.ray_camera import RayCamera
from omnisight.sfm.bundle_adjustment import TOLERANCE, adjust_bundle
from omnisight.sfm.contradicted_edges import without_contradicted_edges
from omnisight.sfm.initial_poses import InitialPoses, initial_poses, panorama_poses
from omnisight.sfm.map import Map
from omnisight.sfm.missing_matches import missing_matches
from omnisight.sfm.noise import noise_of_map
from omnisight.sfm.registration import register_frames
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.scale_averaging import PointDistances
from omnisight.sfm.tracks import Tracks, build_tracks
from omnisight.sfm.view_graph import MIN_INLIERS, Edge, ViewGraph

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
# Called with the number of frames in a map.
Watch = Callable[[int], None]

# Residuals of inliers in units of the scale of the noise.
MAX_RESIDUAL_SIGMA = 5.0
# Observations beyond which a track is divided. Matches follow a texture whose keypoint changes with the viewpoint, so
# that a long chain drifts from its point; and each track connects all its frames in the normal equations. Errors of
# positions and rotations in 1000 rendered images of a town were 0.013 % and 0.07 degrees without a limit, 0.008 % and
# 0.09 degrees with 80, and 0.014 % and 0.11 degrees with 40, where bundle adjustment took 88 s instead of 141 s.
MAX_TRACK_LENGTH = 80
# Tracks that two frames must have in common to be in one: fewer do not determine a relative pose (D. Nister, An
# efficient solution to the five-point relative pose problem, 2004), but each such pair of frames is a block of the
# normal equations. In 1000 images of a town they were 0.04 % of the observations and six sevenths of the arithmetic.
MIN_COMMON_POINTS = 5
# Least parallax of a point: below, its distance is uncertain, and its errors are skewed.
MIN_PARALLAX_RAD = float(np.radians(0.5))
# Standard deviation of the residuals of the averaged poses in units of that of the keypoints.
INITIAL_SCALE = 10.0
# Rounds of triangulation and bundle adjustment; the last one changes the noise by less than this share.
MAX_ROUNDS, CONVERGED_CHANGE = 6, 0.05
# Tolerance of the bundle adjustments before the last one; 1e-4 doubles the errors of images 2 to 5 m apart.
ROUGH_TOLERANCE = 1e-5
# Tracks per task of a thread.
TRACKS_PER_TASK = 1024


def map_images(
    keypoints: Sequence[Keypoints],
    images: RigImages,
    graph: ViewGraph,
    watch: Watch,
    *,
    refines_sensors: bool = False,
) -> list[Map]:
    """Return the maps of all connected parts of a view graph, the one with most frames first.

    Orientations and positions are averaged over the edges; tracks are triangulated, and poses and points refined by
    bundle adjustment (as in L. Pan et al., Global structure-from-motion revisited, ECCV 2024, but with positions from
    relative scales). Frames that averaging left out are registered by resection. Frames that are connected by rotations
    only form a map without points.

    Parameters
    ----------
    keypoints
        Keypoints of all images.
    images
        The images.
    graph
        Their relative poses; pairs that were compared and have none can contradict others.
    watch
        Called with the number of frames in a map.
    refines_sensors
        Whether bundle adjustment refines the poses of the sensors.
    """
    distances = PointDistances(keypoints)
    graph = without_contradicted_edges(graph, distances, images)
    maps, rest = list[Map](), graph.edges
    while rest:
        first = _first_poses(replace(graph, edges=rest), distances, images)
        rest = [edge for edge in rest if edge.images not in first.contradicted]
        if not len(first.frames):
            continue
        start = _without_points(first, images, replace(graph, edges=rest), refines_sensors)
        is_moving = any(edge.has_translation for edge in rest)
        found = _refine_and_extend(start, watch) if is_moving else start
        is_map = (found.row_of_image >= 0).sum() > 1
        maps += [found] if is_map else []
        inside = (found if is_map else start).row_of_image >= 0
        rest = [edge for edge in rest if not inside[edge.a] and not inside[edge.b]]
    return sorted(maps, key=lambda found: -len(found.frames))


def _refine_and_extend(start: Map, watch: Watch) -> Map:
    """Refine a map of averaged poses, and register further frames, while more of them agree with it."""
    found, edges, size = start, start.graph.edges, (0, 0)
    while True:
        found = _refined(found, _tracks(found, edges), watch)
        contradicted = _contradicted_frames(found)
        if contradicted.any() and not contradicted.all():
            found = found.with_frames(~contradicted)
            found = _refined(found, _tracks(found, edges), watch)
        found = found.with_verification()
        before, size = size, (len(found.verified), len(found.frames))
        if size <= before:  # the registered frames did not agree with the map
            return found
        extended = _with_registered_frames(found, edges)
        if extended is found:
            return found
        found = extended


def _with_registered_frames(found: Map, edges: Sequence[Edge]) -> Map:
    """Return the map with new poses of the frames that it lacks, and of those that are not verified.

    A pose that is not verified can rest on one wrong relative pose. It is replaced if more matches agree with another
    one, which the points of the verified frames determine.
    """
    rows, verified = found.row_of_image, found.with_frames(found.is_verified)
    within = [edge for edge in edges if rows[edge.a] >= 0 and rows[edge.b] >= 0]
    added = register_frames(found.frames, found.tracks, found.points, edges, found.images)
    again = register_frames(verified.frames, verified.tracks, verified.points, within, found.images)
    observations = np.zeros(found.images.frames, np.intp)
    observations[found.frames] = np.bincount(rows[found.tracks.image], minlength=len(found.frames))
    better = again.select(again.support > observations[again.frames])
    if not len(added.frames) and not len(better.frames):
        return found
    return found.with_poses(added.frames, added.rig_from_world).with_poses(better.frames, better.rig_from_world)


def _first_poses(graph: ViewGraph, points: PointDistances, images: RigImages) -> InitialPoses:
    """Return poses of the largest part of a view graph: of the edges with a translation, if there are any."""
    moving = [edge for edge in graph.edges if edge.has_translation]
    if any(images.frame[edge.a] != images.frame[edge.b] for edge in moving):
        return initial_poses(replace(graph, edges=moving), points, images)
    return panorama_poses(graph, images)


def refine_poses(
    first: InitialPoses, images: RigImages, graph: ViewGraph, watch: Watch, *, refines_sensors: bool
) -> Map:
    """Return the map of frames with initial poses: triangulate points, and refine both.

    The poses are in the unit of the rig if its sensors are apart; the first frame keeps its pose.
    """
    start = _without_points(first, images, graph, refines_sensors)
    return _refined(start, _tracks(start, graph.edges), watch)


def refine_with_ray_cameras(
    found: Map, cameras: Sequence[RayCamera | None], keypoints: Sequence[Keypoints], edges: Sequence[Edge], watch: Watch
) -> Map:
    """Return a map in metres refined with the exact rays of non-central cameras, which were approximated before."""
    exact = replace(found, images=found.images.with_ray_cameras(cameras, keypoints))
    return _refined(exact, _tracks(exact, edges), watch)


def _without_points(first: InitialPoses, images: RigImages, graph: ViewGraph, refines_sensors: bool) -> Map:
    """Return a map of some poses, without points."""
    values = np.zeros(0 if images.pixels is None else images.pixels.free.count)
    no_points = np.zeros((0, 3)), build_tracks([], []), StudentT(sigma=INITIAL_SCALE)
    poses = first.frames, first.rig_from_world, images.sensor_from_rig
    return Map(images, *poses, *no_points, graph, refines_sensors, values)


def _tracks(current: Map, edges: Sequence[Edge]) -> Tracks:
    """Return the tracks of the edges between images of a map."""
    inside = current.row_of_image >= 0
    return build_tracks([e for e in edges if inside[e.a] and inside[e.b]], np.diff(current.images.offsets).tolist())


def _refined(current: Map, tracks: Tracks, watch: Watch) -> Map:
    """Triangulate tracks and adjust poses and points until the noise of the residuals stays the same."""
    for _ in range(MAX_ROUNDS):
        before = current.noise.sigma
        current = _triangulated(current, tracks)
        watch(len(current.frames))
        current = adjust_map(current, ROUGH_TOLERANCE)
        if abs(current.noise.sigma - before) <= CONVERGED_CHANGE * before:
            break
    refined = _without_unsupported_frames(_without_points_at_cameras(adjust_map(_triangulated(current, tracks))))
    watch(len(refined.frames))
    return refined


def _without_points_at_cameras(current: Map) -> Map:
    """Return the map without points that coincide with a camera: the normal equations would be singular."""
    wrong = current.structure.coincide_with_cameras(current.bundle.rays)
    kept, used = current.tracks.select(~wrong[current.tracks.track])
    return replace(current, points=current.points[used], tracks=kept)


def _without_unsupported_frames(current: Map) -> Map:
    """Return the map without frames whose observations do not agree with it: their poses are wrong or unknown."""
    rows = current.row_of_image[current.tracks.image]
    keep = np.bincount(rows, minlength=len(current.frames)) >= MIN_INLIERS
    return current if keep.all() else current.with_frames(keep)


def _contradicted_frames(found: Map) -> NDArray[np.bool_]:
    """Return which frames (F,) are where more matches with the others are missing than agree."""
    pairs, predictions = found.compared
    lacking = missing_matches(predictions, found.graph.repeatability)
    agreeing = np.array([each.found for each in predictions])
    ends, contradicted = found.row_of_image[pairs], np.zeros(len(found.frames), bool)
    while True:
        use = ~contradicted[ends].any(axis=1)
        missing, confirmed = (
            sum(np.bincount(ends[use, side], values[use], minlength=len(contradicted)) for side in (0, 1))
            for values in (lacking, agreeing)
        )
        excess = np.where(contradicted, 0.0, missing - confirmed)
        if not (excess > 0).any():
            return contradicted
        contradicted[excess.argmax()] = True


def _triangulated(current: Map, tracks: Tracks) -> Map:
    """Return the map with the points of all tracks that agree with its poses."""
    of_frame = current.rig_from_world[current.row_of_image]
    centers = -np.einsum("iba,ib->ia", of_frame[:, :, :3], of_frame[:, :, 3])
    whole = _with_points(current, tracks.divided(centers[tracks.image], MAX_TRACK_LENGTH))
    divided = whole.tracks.divided_where_few_are_common(whole.row_of_image[whole.tracks.image], MIN_COMMON_POINTS)
    return whole if divided is whole.tracks else _with_points(current, divided)


def _with_points(current: Map, tracks: Tracks) -> Map:
    """Return the map with the points of tracks, and the observations that agree with its poses."""
    from omnisight.sfm._track_kernel import triangulate_tracks

    images, which = current.images, current.images.keypoints(tracks)
    of_frame = current.rig_from_world[current.row_of_image[tracks.image]]
    of_sensor = current.sensor_from_rig[images.sensor[tracks.image]]
    rotations = of_sensor[:, :, :3] @ of_frame[:, :, :3]
    translations = np.einsum("mij,mj->mi", of_sensor[:, :, :3], of_frame[:, :, 3]) + of_sensor[:, :, 3]
    origins = np.einsum("mji,mj->mi", rotations, images.origins[which] - translations)
    directions = np.einsum("mji,mj->mi", rotations, images.bearings[which])
    world_rays = tracks.starts, tracks.image, origins, directions, images.axes[which] @ rotations
    limits = (MAX_RESIDUAL_SIGMA * current.noise.sigma) ** 2, MIN_PARALLAX_RAD
    points, inliers = np.empty((len(tracks), 3)), np.zeros(len(which), bool)
    arguments = *world_rays, *limits
    parallel_for(lambda a, b: triangulate_tracks(*arguments, a, b, points, inliers), len(tracks), TRACKS_PER_TASK)
    agreeing, kept = tracks.select(inliers)
    return replace(current, points=points[kept], tracks=agreeing)


def adjust_map(current: Map, tolerance: float = TOLERANCE) -> Map:
    """Return the map with poses, points and cameras of the least robust cost, and the noise of the residuals.

    For the tolerance see `minimize`.
    """
    current = replace(current, noise=noise_of_map(current.bundle, current.structure))
    bundle = current.bundle
    structure = adjust_bundle(bundle, tolerance=tolerance).state
    return replace(
        current,
        images=current.images.at(structure.values),
        rig_from_world=structure.rig_from_world,
        sensor_from_rig=structure.sensor_from_rig,
        points=structure.points,
        noise=noise_of_map(bundle, structure),
        values=structure.values,
    )
