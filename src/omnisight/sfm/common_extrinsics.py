"""One rig for several maps: its poses are the mean of those that the maps determine."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.sfm.map import Map
from omnisight.sfm.mapping import adjust_map
from omnisight.sfm.result import covariances

Array = NDArray[np.float64]


def with_common_extrinsics(maps: Sequence[Map]) -> list[Map]:
    """Return maps, each of which has refined the poses of the sensors, with the mean of these poses.

    Sensors have their weighted mean by the information of each map; a map without any of a sensor has none. The poses
    of the frames and the points are then adjusted to them. The covariance of the mean includes the scatter of the maps.
    """
    start = [Pose.of_matrix(matrix) for matrix in maps[0].sensor_from_rig]
    steps, information = list[Array](), list[Array]()
    for found in maps:
        poses = map(Pose.of_matrix, found.sensor_from_rig)
        steps.append(np.concatenate([a.step_to(b) for a, b in zip(start, poses, strict=True)]))
        information.append(_information(covariances(found).sensors))
    covariance = np.linalg.pinv(sum(information), hermitian=True)
    mean = covariance @ sum(known @ step for known, step in zip(information, steps, strict=True))
    squares = sum((step - mean) @ known @ (step - mean) for known, step in zip(information, steps, strict=True))
    freedom = sum(np.linalg.matrix_rank(known, hermitian=True) for known in information)
    freedom -= np.linalg.matrix_rank(covariance, hermitian=True)
    excess = max(float(squares) / max(int(freedom), 1), 1.0)
    unknown = np.repeat(~np.diagonal(covariance).reshape(-1, 6).any(axis=1), 6)
    unknown[:6] = False  # the first sensor defines the frame of the rig
    covariance[unknown], covariance[:, unknown] = np.nan, np.nan
    sensors = np.array([pose.moved(step).matrix for pose, step in zip(start, mean.reshape(-1, 6), strict=True)])
    return [
        adjust_map(
            replace(found, sensor_from_rig=sensors, refines_sensors=False, sensor_covariance=excess * covariance)
        )
        for found in maps
    ]


def _information(covariance: Array) -> Array:
    """Return the inverse of a covariance (6 S, 6 S); zero for sensors whose poses are unknown or fixed."""
    is_known = np.isfinite(np.diagonal(covariance))
    known = np.where(is_known[:, None] & is_known, covariance, 0.0)
    scale = np.sqrt(np.diagonal(known))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    return inverse[:, None] * np.linalg.pinv(inverse[:, None] * known * inverse, hermitian=True) * inverse
