"""The pose of a stereo pair as OpenCV and ROS hold it: R and T, or rectifying rotations and projection matrices.

OpenCV's `stereoCalibrate`: x_2 = R x_1 + T and E = [T]x R. `stereoRectify`: R1 and R2 rotate the cameras to parallel
ones, and P2 has f T_x (or f T_y) of the rectified pair in its fourth column.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.formats._opencv_lens import matrix
from omnisight.formats._rigs import INVERSE_GAIN, MAX_CONTRADICTION, is_inverted, pose_of_vector
from omnisight.formats._values import rotation_matrix
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import hat

Array = NDArray[np.float64]

# Names in lower case: ours.
STEREO_KEYS = {key.lower(): key for key in ("R", "T", "E", "F", "R1", "R2", "P1", "P2", "Q")}
INVERTED = (
    "the extrinsics of camera 2 are inverted: R and T map points of camera 2 to camera 1, as {evidence} of the file"
    " show, and must map points of camera 1 to camera 2: use R' and -R' T, or remove {evidence} and convert the file"
    " with --invert-extrinsics"
)


def stereo_pose(data: Mapping[str, Any]) -> Pose:
    """Return second_from_first of R (a matrix or a rotation vector) and T."""
    rows, columns, values = matrix(data["R"], "R")
    translation = array(data["T"], "T", 3)
    if rows * columns == 3:
        return pose_of_vector(values, translation.tolist())
    if (rows, columns) != (3, 3):
        raise ValueError(f"R must be 3 x 3, got {rows} x {columns}")
    return Pose(rotation_matrix(np.reshape(values, (3, 3)).tolist(), "R"), translation)


def check_stereo(pose: Pose, data: Mapping[str, Any]) -> None:
    """Raise ValueError if E or the rectification of a file show that R and T are inverted."""
    if "E" in data:
        given = array(data["E"], "E", 9).reshape(3, 3)
        direct, inverse = (_essential_difference(p, given) for p in (pose, pose.inverse()))
        if direct > MAX_CONTRADICTION and inverse * INVERSE_GAIN < direct:
            raise ValueError(INVERTED.format(evidence="E"))
    if {"R1", "R2", "P2"} <= set(data):
        first, second = (array(data[key], key, 9).reshape(3, 3) for key in ("R1", "R2"))
        if is_inverted(pose, rectified_pose(first, second, array(data["P2"], "P2", 12).reshape(3, 4))):
            raise ValueError(INVERTED.format(evidence="R1, R2 and P2"))


def rectified_pose(first: Array, second: Array, projection: Array) -> Pose:
    """Return second_from_first of the rectifying rotations of both cameras and the projection matrix of the second."""
    rotations = [rotation_matrix(r.tolist(), f"rectification {i}") for i, r in enumerate((first, second), 1)]
    if not (projection[0, 0] > 0 and projection[1, 1] > 0):
        raise ValueError(f"the focal lengths of a projection matrix must be positive, got {projection.tolist()!r:.80}")
    shift = np.array([projection[0, 3] / projection[0, 0], projection[1, 3] / projection[1, 1], 0.0])
    return Pose(rotations[1].T @ rotations[0], rotations[1].T @ shift)


def array(value: Any, name: str, count: int) -> Array:
    """Return the numbers of a matrix; raise ValueError for another number of them."""
    rows, columns, values = matrix(value, name)
    if rows * columns != count:
        raise ValueError(f"{name} must have {count} numbers, got {rows} x {columns}")
    return np.array(values)


def _essential_difference(pose: Pose, given: Array) -> float:
    """Return the distance of essential matrices of unit length, whose sign is free."""
    ours = hat(pose.translation) @ pose.rotation
    lengths = np.linalg.norm(ours), np.linalg.norm(given)
    if not all(lengths):
        return 0.0
    ours, given = ours / lengths[0], given / lengths[1]
    return float(min(np.linalg.norm(ours - given), np.linalg.norm(ours + given)))
