"""Registration of further images in a map, by resection from its points."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints
from omnisight.sfm.tracks import Tracks
from omnisight.sfm.view_graph import MIN_INLIERS, Edge
from omnisight.twoview.absolute_pose import resect

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def register_images(
    images: Indices, tracks: Tracks, points: Array, edges: Sequence[Edge], keypoints: Sequence[Keypoints]
) -> tuple[Indices, Array]:
    """Estimate the poses of the images that edges connect with a map.

    Images that averaging left out, because the scales of their edges are unknown or because the edges do not agree with
    others, can still see enough of the points.

    Parameters
    ----------
    images
        (I,) indices of the images of the map.
    tracks, points
        Observations of the points (P, 3) of the map; `image` counts in `images`.
    edges
        All edges.
    keypoints
        Keypoints of all images.

    Returns
    -------
    images, cam_from_world
        (J,) indices of the registered images, and their poses (J, 3, 4).
    """
    point_of = {
        (int(images[image]), int(keypoint)): int(point)
        for image, keypoint, point in zip(tracks.image, tracks.keypoint, tracks.track, strict=True)
    }
    inside, seen = set(images.tolist()), dict[int, set[tuple[int, int]]]()
    for edge in edges:
        for new, known, order in ((edge.a, edge.b, (0, 1)), (edge.b, edge.a, (1, 0))):
            if new in inside or known not in inside:
                continue
            found = seen.setdefault(new, set())
            for keypoint, other in edge.pairs[:, order].tolist():
                if (point := point_of.get((known, other))) is not None:
                    found.add((keypoint, point))
    registered: list[int] = []
    poses: list[Array] = []
    for image, matches in sorted(seen.items()):
        rows = np.array(sorted(matches), np.intp).reshape(-1, 2)
        pose = resect(points[rows[:, 1]], keypoints[image].bearings[rows[:, 0]])
        if pose.cam_from_world is not None and pose.inliers.sum() >= MIN_INLIERS:
            registered.append(image)
            poses.append(pose.cam_from_world.matrix)
    return np.array(registered, np.intp), np.array(poses, float).reshape(-1, 3, 4)
