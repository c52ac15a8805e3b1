"""Reconstructions from maps: pixels, residuals, colours and covariances."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig, Sensor
from omnisight.sfm.map import Map
from omnisight.sfm.reconstruction import PointObservations, Points, Reconstruction

Array = NDArray[np.float64]
Colors = NDArray[np.uint8]


def build_reconstruction(
    found: Map,
    rig: Rig,
    names: Sequence[str],
    keypoints: Sequence[Keypoints],
    colors: Sequence[Colors],
    origin: tuple[float, float, float] | None = None,
) -> Reconstruction:
    """Return the reconstruction of a map.

    Parameters
    ----------
    found
        The map.
    rig
        Its cameras; the poses are those of the map.
    names, keypoints, colors
        Name of each image, its keypoints, and their colours (K, 3), RGB.
    origin
        Of a map at known positions: latitude, longitude, degrees, and altitude, metres.
    """
    tracks, images = found.tracks, found.images
    which = images.keypoints(tracks)
    poses, unit = tuple(map(Pose.of_matrix, found.sensor_from_rig)), "m" if found.has_scale else "units"
    of_map = covariances(found)
    of_rig = of_map.sensors if found.refines_sensors else found.sensor_covariance
    rig = replace(rig, sensor_from_rig=poses, unit=unit, covariance=of_rig)
    if images.pixels is not None:
        rig = replace(rig, cameras=images.pixels.free.at(found.values, of_map.values))
    pixels = np.concatenate([each.pixels for each in keypoints])[which]
    rgb = np.concatenate(list(colors))[which].astype(float)
    seen = np.maximum(np.bincount(tracks.track, minlength=len(found.points)), 1)[:, None]
    mean = np.column_stack([np.bincount(tracks.track, rgb[:, c], minlength=len(found.points)) for c in range(3)]) / seen
    inside = np.flatnonzero(found.row_of_image >= 0)
    image = np.searchsorted(inside, tracks.image)
    of_two = len(found.frames) < 3 or not len(found.points)  # or of one place: there is nothing to verify
    is_verified = np.ones(len(found.frames), bool) if of_two else found.is_verified
    return Reconstruction(
        rig,
        tuple(names[i] for i in inside.tolist()),
        images.sensor[inside],
        found.row_of_image[inside],
        tuple(Pose.of_matrix(pose) for pose in found.rig_from_world),
        of_map.poses,
        Points(found.points, of_map.points, np.rint(mean).astype(np.uint8)),
        PointObservations(image, tracks.track, pixels, _residuals(found, rig, pixels), tracks.keypoint),
        has_scale=found.has_scale,
        origin=origin if found.measured is not None else None,
        unverified=tuple(names[i] for i in inside.tolist() if not is_verified[found.row_of_image[i]]),
    )


def _residuals(found: Map, rig: Rig, pixels: Array) -> Array:
    """Return the projections of the points minus the pixels (M, 2) of their observations."""
    tracks = found.tracks
    poses = found.rig_from_world[found.row_of_image[tracks.image]]
    in_rig = np.einsum("mij,mj->mi", poses[:, :, :3], found.points[tracks.track]) + poses[:, :, 3]
    residuals, of_sensor = np.empty_like(pixels), found.images.sensor[tracks.image]
    for s, (camera, sensor_from_rig) in enumerate(zip(rig.cameras, rig.sensor_from_rig, strict=True)):
        use = of_sensor == s
        residuals[use] = camera.project(sensor_from_rig @ in_rig[use])[0] - pixels[use]
        if (period := _period(camera)) is not None:
            residuals[use, 0] -= period * np.round(residuals[use, 0] / period)
    return residuals


class Covariances(NamedTuple):
    """Covariances of the poses (F, 6, 6), the points (P, 3, 3), the values (Q, Q) and the sensors (6 S, 6 S).

    NaN if not determined.
    """

    poses: Array
    points: Array
    values: Array
    sensors: Array


def covariances(found: Map) -> Covariances:
    """Return the covariances of a map."""
    frames, points, count, sensors = len(found.frames), len(found.points), len(found.values), found.sensor_from_rig
    shapes = (frames, 6, 6), (points, 3, 3), (count, count), (6 * len(sensors), 6 * len(sensors))
    unknown = Covariances(*(np.full(shape, np.nan) for shape in shapes))
    if not points:
        return unknown
    bundle = found.bundle
    of_frames, of_sensors, total = bundle.parameters
    try:
        cameras, of_points = bundle.covariances(found.structure)
    except LinAlgError:
        return unknown
    values, of_rig = cameras.square(np.arange(total - count, total)), cameras.square(of_sensors.ravel())
    return Covariances(cameras.square(of_frames), of_points, values, with_unknown_sensors(of_rig))


def with_unknown_sensors(covariance: Array) -> Array:
    """Return the covariance (6 S, 6 S) of sensors with NaN for those of which nothing is known, whose entries are 0.

    The first sensor defines the frame of the rig, and has none.
    """
    unknown = np.repeat(~np.diagonal(covariance).reshape(-1, 6).any(axis=1), 6)
    unknown[:6] = False
    return np.where(unknown[:, None] | unknown, np.nan, covariance)


def _period(camera: Sensor) -> float | None:
    """Return the width of a 360 image in pixels; None for other cameras."""
    return getattr(camera.model, "period", None)
