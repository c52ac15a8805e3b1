"""Points of a map: triangulation of the tracks of its edges."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from omnisight.parallel import parallel_for
from omnisight.sfm.map import Map
from omnisight.sfm.tracks import Tracks, build_tracks
from omnisight.sfm.view_graph import Edge

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
# Tracks per task of a thread.
TRACKS_PER_TASK = 1024


def tracks_of_edges(current: Map, edges: Sequence[Edge]) -> Tracks:
    """Return the tracks of the edges between images of a map."""
    inside = current.row_of_image >= 0
    return build_tracks([e for e in edges if inside[e.a] and inside[e.b]], np.diff(current.images.offsets).tolist())


def with_triangulated_points(current: Map, tracks: Tracks) -> Map:
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
