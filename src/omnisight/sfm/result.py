"""Reconstructions from maps: pixels, residuals, colours and covariances."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig
from omnisight.sfm.bundle_adjustment import Bundle
from omnisight.sfm.mapping import KeypointRays, Map
from omnisight.sfm.reconstruction import Observations, Points, Reconstruction

Array = NDArray[np.float64]
Colors = NDArray[np.uint8]


def build_reconstruction(
    found: Map,
    rays: KeypointRays,
    rig: Rig,
    names: Sequence[str],
    keypoints: Sequence[Keypoints],
    colors: Sequence[Colors],
) -> Reconstruction:
    """Return the reconstruction of a map, whose images are of the first camera of a rig.

    Parameters
    ----------
    found
        The map.
    rays
        The rays of the keypoints.
    rig
        The camera.
    names, keypoints, colors
        Name of each image, its keypoints, and their colours (K, 3), RGB.
    """
    tracks, camera = found.tracks, rig.cameras[0]
    poses = tuple(Pose.of_matrix(pose) for pose in found.cam_from_world)
    which = rays.indices(found.images, tracks)
    pixels = np.concatenate([each.pixels for each in keypoints])[which]
    rotations, translations = found.cam_from_world[tracks.image, :, :3], found.cam_from_world[tracks.image, :, 3]
    projected, _ = camera.project(np.einsum("mij,mj->mi", rotations, found.points[tracks.track]) + translations)
    residuals = projected - pixels
    if (period := camera.model.period) is not None:
        residuals[:, 0] -= period * np.round(residuals[:, 0] / period)
    rgb = np.concatenate(list(colors))[which].astype(float)
    seen = np.maximum(np.bincount(tracks.track, minlength=len(found.points)), 1)[:, None]
    mean = np.column_stack([np.bincount(tracks.track, rgb[:, c], minlength=len(found.points)) for c in range(3)]) / seen
    pose_covariance, point_covariance = _covariances(found, rays)
    count = len(found.images)
    return Reconstruction(
        rig,
        tuple(str(names[i]) for i in found.images),
        np.zeros(count, np.intp),
        np.arange(count),
        poses,
        pose_covariance,
        Points(found.points, point_covariance, np.rint(mean).astype(np.uint8)),
        Observations(tracks.image, tracks.track, pixels, residuals),
    )


def _covariances(found: Map, rays: KeypointRays) -> tuple[Array, Array]:
    """Return the covariances of the poses (I, 6, 6) and of the points (P, 3, 3); NaN if they are not determined."""
    poses = np.zeros((len(found.images), 6, 6))
    if not len(found.points):
        return poses, np.zeros((0, 3, 3))
    bundle: Bundle = found.bundle(rays)
    columns, _, _ = bundle.parameters
    try:
        cameras, points = bundle.covariances(found.structure)
    except LinAlgError:
        return np.full_like(poses, np.nan), np.full((len(found.points), 3, 3), np.nan)
    padded = np.pad(cameras, ((0, 1), (0, 1)))  # the last row is that of fixed parameters, whose column is -1
    poses[:] = padded[columns[:, :, None], columns[:, None, :]]
    return poses, points
