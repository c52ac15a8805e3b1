"""Relative pose of two cameras without a common view, each with a board of its own, from the motion of the rig."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.poses import Poses
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]

# Two rotations about different axes determine the relative rotation; a third image gives a residual.
MIN_POSES = 3
# Rotation (radians) between two images below which its axis is too uncertain.
MIN_ROTATION_RAD = np.radians(5.0)
# Rounds of iteratively reweighted least squares.
ROBUST_ROUNDS = 10
# Singular value of the rotation axes, relative to the largest, below which they are parallel.
MIN_SINGULAR_RATIO = 0.02


@dataclass(frozen=True, eq=False)
class HandEye:
    """The solution of b_i = b_from_a a_i a_from_b_board, for poses a_i and b_i of the boards of two cameras.

    Attributes
    ----------
    b_from_a
        Relative pose of the cameras.
    board_a_from_board_b
        Relative pose of the boards.
    angles
        (I,) angle between the relation of the boards in each image and the solution, radians.
    """

    b_from_a: Pose
    board_a_from_board_b: Pose
    angles: Array


def solve_hand_eye(a_from_board: Poses, b_from_board: Poses) -> HandEye | None:
    """Solve the hand-eye problem of two cameras with boards that are at rest relative to each other.

    With b_i b_j^-1 = X a_i a_j^-1 X^-1, the rotation vectors of the motions of both cameras are related by the
    rotation of X (Park and Martin, Robot sensor calibration, 1994); then the translations of X and of the relative pose
    of the boards are a linear problem (Dornaika and Horaud, Simultaneous robot-world and hand-eye calibration, 1998).
    Both are solved by iteratively reweighted least squares.

    Parameters
    ----------
    a_from_board, b_from_board
        I poses of the board of each camera, at the same times.

    Returns
    -------
    The solution; None if there are too few images or all motions rotate about one axis.
    """
    if len(a_from_board) < MIN_POSES:
        return None
    i, j = np.triu_indices(len(a_from_board), 1)
    alpha = so3.log(a_from_board.rotation[i] @ np.swapaxes(a_from_board.rotation[j], 1, 2))
    beta = so3.log(b_from_board.rotation[i] @ np.swapaxes(b_from_board.rotation[j], 1, 2))
    turned = np.minimum(*(np.linalg.norm(v, axis=1) for v in (alpha, beta))) > MIN_ROTATION_RAD
    if turned.sum() < 2:
        return None
    singular_values = np.linalg.svd(alpha[turned], compute_uv=False)
    if singular_values[1] < MIN_SINGULAR_RATIO * singular_values[0]:
        return None
    rotation = _robust_rotation(alpha[turned], beta[turned])
    relations = np.swapaxes(rotation @ a_from_board.rotation, 1, 2) @ b_from_board.rotation
    relation = _mean_rotation(relations)
    angles = np.linalg.norm(so3.log(relations @ relation.T), axis=1)
    t_sensor, t_board = _translations(rotation, a_from_board, b_from_board)
    return HandEye(Pose(rotation, t_sensor), Pose(relation, t_board), angles)


def _robust_rotation(alpha: Array, beta: Array) -> Array:
    """Return the rotation R with beta = R alpha (Kabsch 1976), with weights of the L1 norm."""
    weights, rotation = np.ones(len(alpha)), np.eye(3)
    for _ in range(ROBUST_ROUNDS):
        rotation = so3.nearest((weights[:, None] * beta).T @ alpha)
        residuals = np.linalg.norm(beta - alpha @ rotation.T, axis=1)
        weights = 1 / np.maximum(residuals, np.median(residuals) + 1e-12)
    return rotation


def _mean_rotation(rotations: Array) -> Array:
    """Return the robust mean of rotations (I, 3, 3), with weights of the L1 norm."""
    weights, mean = np.ones(len(rotations)), np.eye(3)
    for _ in range(ROBUST_ROUNDS):
        mean = so3.nearest(np.einsum("i,ijk->jk", weights, rotations))
        angles = np.linalg.norm(so3.log(rotations @ mean.T), axis=1)
        weights = 1 / np.maximum(angles, np.median(angles) + 1e-12)
    return mean


def _translations(rotation: Array, a_from_board: Poses, b_from_board: Poses) -> tuple[Array, Array]:
    """Return the translations of the cameras and of the boards: t_b = R R_a t_board + R t_a + t_sensor."""
    count = len(a_from_board)
    matrix = np.zeros((count, 3, 6))
    matrix[:, :, :3] = np.eye(3)
    matrix[:, :, 3:] = rotation @ a_from_board.rotation
    right = b_from_board.translation - a_from_board.translation @ rotation.T
    weights, solution = np.ones(count), np.zeros(6)
    for _ in range(ROBUST_ROUNDS):
        rows = (weights[:, None, None] * matrix).reshape(-1, 6)
        solution = np.asarray(np.linalg.lstsq(rows, (weights[:, None] * right).ravel(), rcond=None)[0], float)
        residuals = np.linalg.norm(right - matrix @ solution, axis=1)
        weights = 1 / np.sqrt(np.maximum(residuals, np.median(residuals) + 1e-12))
    return solution[:3], solution[3:]
