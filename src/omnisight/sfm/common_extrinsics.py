"""One rig for several maps: its poses are the mean of those that the maps determine."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.sfm.map import Map
from omnisight.sfm.mapping import adjust_map
from omnisight.sfm.result import covariances, with_unknown_sensors

Array = NDArray[np.float64]


def with_common_extrinsics(maps: Sequence[Map]) -> list[Map]:
    """Return maps that have refined the poses of the sensors, with the mean of these poses.

    The mean is weighted by the information of each map, which has none about sensors without images in it. The poses of
    the frames and the points are then adjusted to it. The covariance of the mean includes the scatter of the maps.
    """
    start = [Pose.of_matrix(matrix) for matrix in maps[0].sensor_from_rig]
    steps, information = list[Array](), list[Array]()
    for found in maps:
        poses = map(Pose.of_matrix, found.sensor_from_rig)
        steps.append(np.concatenate([a.step_to(b) for a, b in zip(start, poses, strict=True)]))
        information.append(_inverse(np.nan_to_num(covariances(found).sensors)))
    covariance = _inverse(sum(information, np.zeros_like(information[0])))
    mean = covariance @ sum(known @ step for known, step in zip(information, steps, strict=True))
    squares = sum((step - mean) @ known @ (step - mean) for known, step in zip(information, steps, strict=True))
    freedom = sum(map(_rank, information)) - _rank(covariance)
    excess = max(float(squares) / max(freedom, 1), 1.0)
    sensors = np.array([pose.moved(step).matrix for pose, step in zip(start, mean.reshape(-1, 6), strict=True)])
    common = with_unknown_sensors(excess * covariance)
    return [
        adjust_map(replace(found, sensor_from_rig=sensors, refines_sensors=False, sensor_covariance=common))
        for found in maps
    ]


def _inverse(matrix: Array) -> Array:
    """Return the inverse of a covariance or information (6 S, 6 S) without its rows of zeros, which stay zero."""
    scale = np.sqrt(np.diagonal(matrix))
    unit = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    inverse = np.linalg.pinv(unit[:, None] * matrix * unit, hermitian=True)
    return np.asarray(unit[:, None] * inverse * unit, float)


def _rank(matrix: Array) -> int:
    return int(np.linalg.matrix_rank(matrix, hermitian=True))
