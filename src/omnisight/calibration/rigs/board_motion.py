"""Small motions of the board between the exposures of a group: a random effect of each view.

Images of different cameras are rarely taken at exactly the same time, and boards in a hand move and flex. The pose of
the board then differs between the cameras by more than corner noise explains. Without a model of it, the joint
refinement bends the cameras to fit it. Each view gets a motion of the board about its middle with a normal prior, whose
standard deviations are estimated from all views (restricted maximum likelihood by expectation maximization; Laird and
Ware, Random-effects models for longitudinal data, 1982).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.observations import RigPart
from omnisight.calibration.rigs.poses import Poses
from omnisight.geometry import rotation as so3
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class BoardMotion:
    """Standard deviations of the motion of the board in each view.

    Attributes
    ----------
    rotation
        Of each component of the rotation about the middle of the board, radians.
    translation
        Of each component of the translation, in the unit of the board.
    """

    rotation: float
    translation: float

    @property
    def information(self) -> Array:
        """(6,) inverse variances of the motion (w, v)."""
        return np.repeat([self.rotation**-2, self.translation**-2], 3)


class Eliminated(NamedTuple):
    """What the elimination of the motions subtracts from the normal equations of each view of a part.

    Attributes
    ----------
    shared, shared_gradient
        (V, F, F) and (V, F).
    cross
        (V, F, 6).
    local, local_gradient
        (V, 6, 6) and (V, 6).
    step
        (V, 6) step of the motions that minimizes the linearized cost, everything else constant.
    covariance
        (V, 6, 6) of the motions, everything else constant, for residuals of unit variance.
    """

    shared: Array
    shared_gradient: Array
    cross: Array
    local: Array
    local_gradient: Array
    step: Array
    covariance: Array


def middles(part: RigPart, rotations: Array) -> Array:
    """Return the middle of the board relative to its origin (V, 3), in the axes of rotated boards (V, 3, 3)."""
    middle = np.append(part.observations.extent.mean(0), 0.0)
    return rotations @ middle


def with_motion(poses: Poses, part: RigPart, motion: Array) -> Poses:
    """Return cam_from_board (V) with the boards moved about their middles by motions (w, v) (V, 6)."""
    turn = so3.exp(motion[:, :3])
    arm = middles(part, poses.rotation)
    shift = arm - (turn @ arm[..., None])[..., 0] + motion[:, 3:]
    return Poses(turn @ poses.rotation, poses.translation + shift)


def by_pose(poses: Poses, part: RigPart, motion: Array) -> Array:
    """Return the derivative (V, 6, 6) of the moved poses by the poses before the motion."""
    turn = so3.exp(motion[:, :3])
    arm = so3.hat(middles(part, poses.rotation))
    derivative = np.zeros((len(poses), 6, 6))
    derivative[:, :3, :3], derivative[:, 3:, 3:] = turn, np.eye(3)
    derivative[:, 3:, :3] = turn @ arm - arm
    return derivative


def moved_motion(motion: Array, step: Array) -> Array:
    """Return motions (V, 6) after steps (V, 6)."""
    turn = so3.log(so3.exp(step[:, :3]) @ so3.exp(motion[:, :3]))
    return np.concatenate([turn, motion[:, 3:] + step[:, 3:]], axis=1)


def eliminate(normal: GroupedNormal, rotations: Array, part: RigPart, motion: Array, information: Array) -> Eliminated:
    """Eliminate the motions from the normal equations of a part, one group per view.

    With n the motion, J the derivative of the pose by it, and P its prior information, the normal equations of n are
    N = J^T C J + P with gradient J^T g + P n; the Schur complement subtracts (B J) N^-1 (B J)^T from A, and so on.

    Parameters
    ----------
    normal
        Normal equations of the camera and the poses of the moved boards.
    rotations
        (V, 3, 3) rotations of the moved boards.
    part
        The views.
    motion
        (V, 6) present motions.
    information
        (6,) prior information, for residuals of the variance of `normal`.
    """
    jacobian = np.zeros((len(part), 6, 6))
    jacobian[:, range(6), range(6)] = 1.0
    jacobian[:, 3:, :3] = so3.hat(middles(part, rotations))
    back = np.swapaxes(jacobian, 1, 2)
    inverse = np.linalg.inv(back @ normal.local @ jacobian + np.diag(information))
    gradient = (back @ normal.local_gradient[..., None])[..., 0] + information * motion
    by_shared, by_local = normal.cross @ jacobian, normal.local @ jacobian
    step = -(inverse @ gradient[..., None])[..., 0]
    gain = by_shared @ inverse
    return Eliminated(
        gain @ np.swapaxes(by_shared, 1, 2),
        -np.einsum("vfi,vi->vf", by_shared, step),
        gain @ np.swapaxes(by_local, 1, 2),
        by_local @ inverse @ np.swapaxes(by_local, 1, 2),
        -np.einsum("vji,vi->vj", by_local, step),
        step,
        np.asarray(inverse, float),
    )
