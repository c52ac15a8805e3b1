"""Small motions of the boards between the exposures of a group: a random effect of each exposure.

Images of different cameras are rarely taken at exactly the same time, and boards in a hand move and flex. The pose of
the boards then differs between the cameras by more than corner noise explains. Without a model of it, the joint
refinement bends the cameras to fit it. Each exposure gets a motion of its boards about a pivot, the middle of the first
of them, with a normal prior, whose standard deviations are estimated from all exposures (restricted maximum likelihood
by expectation maximization; Laird and Ware, Random-effects models for longitudinal data, 1982).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.poses import Poses
from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class BoardMotion(Displayed):
    """Standard deviations of the motion of the boards in each exposure.

    Attributes
    ----------
    rotation
        Of each component of the rotation about the pivot, radians.
    translation
        Of each component of the translation, in the unit of the boards.
    """

    rotation: float
    translation: float

    @property
    def information(self) -> Array:
        """(6,) inverse variances of the motion (w, v)."""
        return np.repeat([self.rotation**-2, self.translation**-2], 3)


class MotionNormal(NamedTuple):
    """Normal equations of the motions of all exposures, with their prior.

    Attributes
    ----------
    information
        (E, 6, 6).
    by_shared
        (E, P, 6) coupling with the shared parameters.
    by_group
        (E, 6, 6) coupling with the pose of the group.
    gradient
        (E, 6).
    group
        (E,) group of each exposure.
    """

    information: Array
    by_shared: Array
    by_group: Array
    gradient: Array
    group: Indices

    @property
    def steps(self) -> Array:
        """(E, 6) steps of the motions that minimize the linearized cost, everything else constant."""
        return -np.asarray(np.linalg.solve(self.information, self.gradient[..., None]), float)[..., 0]

    def eliminated_from(self, normal: GroupedNormal) -> GroupedNormal:
        """Return normal equations of shared parameters and groups without the motions (Schur complement)."""
        inverse, steps = np.linalg.inv(self.information), self.steps
        gain = self.by_shared @ inverse
        cross, local, local_gradient = normal.cross.copy(), normal.local.copy(), normal.local_gradient.copy()
        np.subtract.at(cross, self.group, gain @ np.swapaxes(self.by_group, 1, 2))
        np.subtract.at(local, self.group, self.by_group @ inverse @ np.swapaxes(self.by_group, 1, 2))
        np.add.at(local_gradient, self.group, (self.by_group @ steps[..., None])[..., 0])
        return GroupedNormal(
            normal.shared - np.tensordot(gain, self.by_shared, axes=([0, 2], [0, 2])),
            cross,
            local,
            normal.shared_gradient + np.einsum("epi,ei->p", self.by_shared, steps),
            local_gradient,
        )


def with_motion(poses: Poses, pivot: Array, motion: Array) -> Poses:
    """Return cam_from_group (V) with the groups moved about a pivot (3,) by motions (w, v) (V, 6)."""
    turn = so3.exp(motion[:, :3])
    arm = poses.rotation @ pivot
    shift = arm - (turn @ arm[..., None])[..., 0] + motion[:, 3:]
    return Poses(turn @ poses.rotation, poses.translation + shift)


def by_pose(poses: Poses, pivot: Array, motion: Array) -> Array:
    """Return the derivative (V, 6, 6) of the moved poses by the poses before the motion."""
    turn = so3.exp(motion[:, :3])
    arm = so3.hat(poses.rotation @ pivot)
    derivative = np.zeros((len(poses), 6, 6))
    derivative[:, :3, :3], derivative[:, 3:, 3:] = turn, np.eye(3)
    derivative[:, 3:, :3] = turn @ arm - arm
    return derivative


def by_motion(moved: Poses, pivot: Array) -> Array:
    """Return the derivative (V, 6, 6) of moved poses by a further step of their motions."""
    derivative = np.zeros((len(moved), 6, 6))
    derivative[:, range(6), range(6)] = 1.0
    derivative[:, 3:, :3] = so3.hat(moved.rotation @ pivot)
    return derivative


def moved_motion(motion: Array, step: Array) -> Array:
    """Return motions (E, 6) after steps (E, 6)."""
    turn = so3.log(so3.exp(step[:, :3]) @ so3.exp(motion[:, :3]))
    return np.concatenate([turn, motion[:, 3:] + step[:, 3:]], axis=1)
