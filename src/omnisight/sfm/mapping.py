"""Mapping: poses of all frames of a view graph, and the points that their images show."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints
from omnisight.optim.loss import StudentT
from omnisight.ray_camera import RayCamera
from omnisight.sfm.bundle_adjustment import TOLERANCE, adjust_bundle
from omnisight.sfm.contradicted_edges import without_contradicted_edges
from omnisight.sfm.initial_poses import InitialPoses, initial_poses, panorama_poses
from omnisight.sfm.map import Map
from omnisight.sfm.map_points import tracks_of_edges, with_triangulated_points
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

# Standard deviation of the residuals of the averaged poses in units of that of the keypoints.
INITIAL_SCALE = 10.0
# Rounds of triangulation and bundle adjustment; the last one changes the noise by less than this share.
MAX_ROUNDS, CONVERGED_CHANGE = 6, 0.05
# Tolerance of the bundle adjustments before the last one; 1e-4 doubles the errors of images 2 to 5 m apart.
ROUGH_TOLERANCE = 1e-5


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
    relative scales). Frames that averaging left out, or that are not verified, are registered by resection. Frames that
    are connected by rotations only form a map without points.

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
    rest, maps = without_contradicted_edges(graph, distances, images), list[Map]()
    while rest.edges:
        first = _first_poses(rest, distances, images)
        rest = replace(rest, edges=[edge for edge in rest.edges if edge.images not in first.contradicted])
        if not len(first.frames):
            continue
        start = _without_points(first, images, rest, refines_sensors)
        is_moving = any(edge.has_translation for edge in rest.edges)
        found = _refine_and_extend(start, keypoints, watch) if is_moving else start
        is_map = (found.row_of_image >= 0).sum() > 1
        maps += [found] if is_map else []
        inside = (found if is_map else start).row_of_image >= 0
        rest = rest.without_images(inside)
    return sorted(maps, key=lambda found: -len(found.frames))


def _refine_and_extend(start: Map, keypoints: Sequence[Keypoints], watch: Watch) -> Map:
    """Refine a map of averaged poses, and register frames that it lacks or does not verify, each once."""
    found, edges, registered = start, start.graph.edges, np.zeros(0, np.intp)
    while True:
        found = _refined(found, tracks_of_edges(found, edges), watch)
        contradicted = _contradicted_frames(found)
        if contradicted.any() and not contradicted.all():
            found = found.with_frames(~contradicted)
            found = _refined(found, tracks_of_edges(found, edges), watch)
        found = found.with_verification()
        new = register_frames(found, edges, registered, keypoints)
        if not len(new.frames):
            return found
        found, edges = found.with_poses(new.frames, new.rig_from_world), edges + new.edges
        registered = np.append(registered, new.frames)


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
    return _refined(start, tracks_of_edges(start, graph.edges), watch)


def refine_with_ray_cameras(
    found: Map, cameras: Sequence[RayCamera | None], keypoints: Sequence[Keypoints], edges: Sequence[Edge], watch: Watch
) -> Map:
    """Return a map in metres refined with the exact rays of non-central cameras, which were approximated before."""
    exact = replace(found, images=found.images.with_ray_cameras(cameras, keypoints))
    return _refined(exact, tracks_of_edges(exact, edges), watch)


def _without_points(first: InitialPoses, images: RigImages, graph: ViewGraph, refines_sensors: bool) -> Map:
    """Return a map of some poses, without points."""
    values = np.zeros(0 if images.pixels is None else images.pixels.free.count)
    no_points = np.zeros((0, 3)), build_tracks([], []), StudentT(sigma=INITIAL_SCALE)
    poses = first.frames, first.rig_from_world, images.sensor_from_rig
    return Map(images, *poses, *no_points, graph, refines_sensors, values)


def _refined(current: Map, tracks: Tracks, watch: Watch) -> Map:
    """Triangulate tracks and adjust poses and points until the noise of the residuals stays the same."""
    for _ in range(MAX_ROUNDS):
        before = current.noise.sigma
        current = with_triangulated_points(current, tracks)
        watch(len(current.frames))
        current = adjust_map(current, ROUGH_TOLERANCE)
        if abs(current.noise.sigma - before) <= CONVERGED_CHANGE * before:
            break
    refined = _without_unsupported_frames(
        _without_points_at_cameras(adjust_map(with_triangulated_points(current, tracks)))
    )
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
