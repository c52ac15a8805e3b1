"""Arrays of rigid motions."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Poses(Displayed):
    """Rigid motions b_from_a of several frames.

    Attributes
    ----------
    rotation, translation
        (N, 3, 3) and (N, 3).
    """

    rotation: Array
    translation: Array

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.rotation)

    def __getitem__(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> "Poses":
        """Return some of the poses."""
        return Poses(self.rotation[index], self.translation[index])

    def __matmul__(self, other: "Poses") -> "Poses":
        """Compose each pose with the pose of the same index; a single pose is composed with all."""
        return Poses(
            self.rotation @ other.rotation,
            (self.rotation @ other.translation[..., None])[..., 0] + self.translation,
        )

    @classmethod
    def of(cls, *poses: Pose) -> Self:
        """Join poses."""
        return cls(np.array([p.rotation for p in poses]), np.array([p.translation for p in poses]))

    @classmethod
    def identity(cls, count: int) -> Self:
        """Return poses that change nothing."""
        return cls(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))

    def one(self, index: int) -> Pose:
        """Return one of the poses."""
        return Pose(self.rotation[index], self.translation[index])

    def inverse(self) -> "Poses":
        """Return a_from_b."""
        back = np.swapaxes(self.rotation, 1, 2)
        return Poses(back, -(back @ self.translation[..., None])[..., 0])

    def transformed(self, points: Array) -> Array:
        """Return points (N, K, 3), K in the frame a of each pose, in its frame b."""
        return points @ np.swapaxes(self.rotation, 1, 2) + self.translation[:, None]

    def steps_from(self, reference: Pose) -> Array:
        """Return the steps (N, 6) from a reference to the poses, see `Pose.moved`."""
        turn = so3.log(self.rotation @ reference.rotation.T)
        return np.concatenate([turn, self.translation - reference.translation], axis=1)

    def where(self, which: NDArray[np.bool_], others: "Poses") -> "Poses":
        """Return these poses where `which` (N,) is true, and others elsewhere."""
        return Poses(
            np.where(which[:, None, None], self.rotation, others.rotation),
            np.where(which[:, None], self.translation, others.translation),
        )

    def moved(self, steps: Array) -> "Poses":
        """Return the poses moved by steps (N, 6), see `Pose.moved`."""
        return Poses(so3.exp(steps[:, :3]) @ self.rotation, self.translation + steps[:, 3:])
