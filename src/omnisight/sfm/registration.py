"""Registration of further frames in a map, by resection from its points."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.tracks import Tracks
from omnisight.sfm.view_graph import MIN_INLIERS, Edge
from omnisight.twoview.absolute_pose import resect

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class RegisteredFrames(NamedTuple):
    """Frames that were registered.

    Attributes
    ----------
    frames
        (J,) indices.
    rig_from_world
        Their poses (J, 3, 4).
    support
        (J,) matches that agree with each pose.
    """

    frames: Indices
    rig_from_world: Array
    support: Indices

    def select(self, use: NDArray[np.bool_]) -> "RegisteredFrames":
        """Return the frames of a mask (J,)."""
        return RegisteredFrames(self.frames[use], self.rig_from_world[use], self.support[use])


def register_frames(
    frames: Indices,
    tracks: Tracks,
    points: Array,
    edges: Sequence[Edge],
    images: RigImages,
) -> RegisteredFrames:
    """Estimate the poses of the frames that edges connect with a map, each by the image with the most inliers.

    Frames that averaging left out, because the scales of their edges are unknown or because the edges do not agree with
    others, can still see enough of the points.

    Parameters
    ----------
    frames
        (F,) indices of the frames of the map.
    tracks, points
        Observations of the points (P, 3) of the map.
    edges
        All edges.
    images
        The images.
    """
    best = dict[int, tuple[int, Array]]()
    for image, rows in sorted(_matches(frames, tracks, edges, images).items()):
        pose = resect(points[rows[:, 1]], images.bearings_of(image)[rows[:, 0]])
        support, frame = int(pose.inliers.sum()), int(images.frame[image])
        if pose.cam_from_world is None or support < MIN_INLIERS or support <= best.get(frame, (0,))[0]:
            continue
        sensor_from_rig = Pose.of_matrix(images.sensor_from_rig[images.sensor[image]])
        best[frame] = support, (sensor_from_rig.inverse() @ pose.cam_from_world).matrix
    poses = np.array([pose for _, pose in best.values()], float).reshape(-1, 3, 4)
    support = np.array([number for number, _ in best.values()], np.intp)
    return RegisteredFrames(np.array(list(best), np.intp), poses, support)


def _matches(frames: Indices, tracks: Tracks, edges: Sequence[Edge], images: RigImages) -> dict[int, Indices]:
    """Return the keypoints and points (M, 2) that edges connect, by the images that are not in the map."""
    point_of = {
        (int(image), int(keypoint)): int(point)
        for image, keypoint, point in zip(tracks.image, tracks.keypoint, tracks.track, strict=True)
    }
    inside, seen = np.isin(images.frame, frames), dict[int, set[tuple[int, int]]]()
    for edge in edges:
        for new, known, order in ((edge.a, edge.b, (0, 1)), (edge.b, edge.a, (1, 0))):
            if inside[new] or not inside[known]:
                continue
            found = seen.setdefault(new, set())
            for keypoint, other in edge.pairs[:, order].tolist():
                if (point := point_of.get((known, other))) is not None:
                    found.add((keypoint, point))
    return {image: np.array(sorted(rows), np.intp).reshape(-1, 2) for image, rows in seen.items()}
