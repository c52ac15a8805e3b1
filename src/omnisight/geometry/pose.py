"""Rigid motions, named after the frames they map: `x_b = b_from_a @ x_a`."""

from dataclasses import dataclass, field
from typing import Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pose(Displayed):
    """A rigid motion b_from_a.

    Attributes
    ----------
    rotation
        (3, 3).
    translation
        (3,), in the unit of the points.
    """

    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        """Convert lists and integers to arrays of floats."""
        for name in ("rotation", "translation"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Pose):
            return NotImplemented
        return np.array_equal(self.rotation, other.rotation) and np.array_equal(self.translation, other.translation)

    def __repr__(self) -> str:
        """Return the rotation vector in degrees and the translation."""
        turn, shift = (
            "[" + ", ".join(f"{value:.6g}" for value in np.round(vector, 9) + 0.0) + "]"
            for vector in (np.degrees(so3.log(self.rotation)), np.asarray(self.translation, float))
        )
        return f"Pose(rotation={turn}°, translation={shift})"

    def __hash__(self) -> int:
        return hash((*np.ravel(self.rotation).tolist(), *np.ravel(self.translation).tolist()))

    @overload
    def __matmul__(self, other: "Pose") -> "Pose": ...
    @overload
    def __matmul__(self, other: ArrayLike) -> Array: ...
    def __matmul__(self, other: "Pose | ArrayLike") -> "Pose | Array":
        """Compose with a pose, or map points (..., 3)."""
        if isinstance(other, Pose):
            return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)
        return np.asarray(other, float) @ self.rotation.T + self.translation

    @classmethod
    def of_matrix(cls, matrix: ArrayLike) -> Self:
        """Return the pose of a matrix [R | t] (3, 4)."""
        m = np.array(matrix, float)
        return cls(m[:, :3].copy(), m[:, 3].copy())

    @property
    def matrix(self) -> Array:
        """The matrix [R | t] (3, 4)."""
        return np.column_stack([self.rotation, self.translation])

    def inverse(self) -> Self:
        """Return a_from_b."""
        return type(self)(self.rotation.T, -self.rotation.T @ self.translation)

    def position_covariance(self, covariance: ArrayLike) -> NDArray[np.float64]:
        """Return the covariance (3, 3) of the position of frame b in frame a, -R^T t.

        Parameters
        ----------
        covariance
            (6, 6) of a step (w, v) of `moved`, which changes the position by -R^T (v - w x t).
        """
        by_step = -self.rotation.T @ np.hstack([so3.hat(self.translation), np.eye(3)])
        return by_step @ np.asarray(covariance, float) @ by_step.T

    def moved(self, step: ArrayLike) -> Self:
        """Return the pose moved by a step (w, v) (6,), rotation vector and translation: x_b = exp(w) R x_a + t + v."""
        s = np.asarray(step, float)
        return type(self)(so3.exp(s[:3]) @ self.rotation, self.translation + s[3:])

    def step_to(self, other: "Pose") -> Array:
        """Return the step (w, v) (6,) of `moved` to another pose."""
        return np.append(so3.log(other.rotation @ self.rotation.T), other.translation - self.translation)
