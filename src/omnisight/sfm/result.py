"""Reconstructions from maps: pixels, residuals, colours and covariances."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig, Sensor
from omnisight.sfm.mapping import Map
from omnisight.sfm.reconstruction import Observations, Points, Reconstruction
from omnisight.sfm.rig_images import RigImages

Array = NDArray[np.float64]
Colors = NDArray[np.uint8]


def build_reconstruction(
    found: Map,
    images: RigImages,
    rig: Rig,
    names: Sequence[str],
    keypoints: Sequence[Keypoints],
    colors: Sequence[Colors],
) -> Reconstruction:
    """Return the reconstruction of a map.

    Parameters
    ----------
    found
        The map.
    images
        The images.
    rig
        Their cameras; the poses are those of the map.
    names, keypoints, colors
        Name of each image, its keypoints, and their colours (K, 3), RGB.
    """
    tracks, which = found.tracks, images.keypoints(found.tracks)
    rig = replace(rig, sensor_from_rig=tuple(Pose.of_matrix(pose) for pose in found.sensor_from_rig))
    pixels = np.concatenate([each.pixels for each in keypoints])[which]
    rgb = np.concatenate(list(colors))[which].astype(float)
    seen = np.maximum(np.bincount(tracks.track, minlength=len(found.points)), 1)[:, None]
    mean = np.column_stack([np.bincount(tracks.track, rgb[:, c], minlength=len(found.points)) for c in range(3)]) / seen
    pose_covariance, point_covariance = _covariances(found, images)
    inside = np.flatnonzero(np.isin(images.frame, found.frames))
    row_of_frame = np.full(images.frames, -1)
    row_of_frame[found.frames] = np.arange(len(found.frames))
    return Reconstruction(
        rig,
        tuple(names[i] for i in inside.tolist()),
        images.sensor[inside],
        row_of_frame[images.frame[inside]],
        tuple(Pose.of_matrix(pose) for pose in found.rig_from_world),
        pose_covariance,
        Points(found.points, point_covariance, np.rint(mean).astype(np.uint8)),
        Observations(
            np.searchsorted(inside, tracks.image), tracks.track, pixels, _residuals(found, images, rig, pixels)
        ),
        has_scale=images.has_scale(found.frames),
    )


def _residuals(found: Map, images: RigImages, rig: Rig, pixels: Array) -> Array:
    """Return the projections of the points minus the pixels (M, 2) of their observations."""
    tracks, poses = found.tracks, found.rig_from_world[found.rows(images)]
    in_rig = np.einsum("mij,mj->mi", poses[:, :, :3], found.points[tracks.track]) + poses[:, :, 3]
    residuals = np.empty_like(pixels)
    of_sensor = images.sensor[tracks.image]
    for s, (camera, sensor_from_rig) in enumerate(zip(rig.cameras, rig.sensor_from_rig, strict=True)):
        use = of_sensor == s
        residuals[use] = camera.project(sensor_from_rig @ in_rig[use])[0] - pixels[use]
        if (period := _period(camera)) is not None:
            residuals[use, 0] -= period * np.round(residuals[use, 0] / period)
    return residuals


def _covariances(found: Map, images: RigImages) -> tuple[Array, Array]:
    """Return the covariances of the poses (F, 6, 6) and of the points (P, 3, 3); NaN if they are not determined."""
    poses = np.zeros((len(found.frames), 6, 6))
    if not len(found.points):
        return poses, np.zeros((0, 3, 3))
    bundle = found.bundle(images)
    columns, _, _ = bundle.parameters
    try:
        cameras, points = bundle.covariances(found.structure)
    except LinAlgError:
        return np.full_like(poses, np.nan), np.full((len(found.points), 3, 3), np.nan)
    padded = np.pad(cameras, ((0, 1), (0, 1)))  # the last row is that of fixed parameters, whose column is -1
    poses[:] = padded[columns[:, :, None], columns[:, None, :]]
    return poses, points


def _period(camera: Sensor) -> float | None:
    """Return the width of a 360 image in pixels; None for other cameras."""
    return getattr(camera.model, "period", None)
