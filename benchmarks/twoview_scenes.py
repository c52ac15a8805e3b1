"""Synthetic bearings with noise and outliers, and the poses behind them, for the benchmark of two views."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.twoview import poses_from_homography

Array = NDArray[np.float64]
Generator = np.random.Generator

FIELDS_DEG = (60, 120, 190, 280, 360)
OUTLIERS = (0.0, 0.3, 0.5, 0.7)
SIGMAS_DEG = (0.05, 0.2)
MOTIONS = ("general", "forward", "sideways", "plane")
COUNT = 500
# Translations along and across the axis are rotated by up to this angle.
DEVIATION_DEG = 10.0
# Largest share of the points of a plane that the second motion with the same homography has in front of both cameras.
MAX_SECOND_SHARE = 0.9


class Pair(NamedTuple):
    """Bearings (N, 3) of two cameras, and the true pose."""

    a: Array
    b: Array
    b_from_a: om.Pose


@dataclass(frozen=True)
class Cell:
    """One kind of pair: points at 2 to 10 baselines, on a plane at 2 to 6 baselines from camera a.

    `outliers` is the share of pairs whose bearings belong to different points. All fields of view are around the z axis
    of both cameras, so that those above 180 degrees contain points behind the cameras.
    """

    motion: str
    fov_deg: float
    outliers: float
    sigma_deg: float

    def pair(self, seed: int) -> Pair:
        """Return a pair of a seed."""
        rng = np.random.default_rng(seed)
        pose, a, points = self._scene(rng)
        b = unit(pose @ points)
        spoil(rng, b, self.outliers)
        return Pair(noisy(rng, a, self.sigma_deg), noisy(rng, b, self.sigma_deg), pose)

    def _scene(self, rng: Generator) -> tuple[om.Pose, Array, Array]:
        while True:
            turn = unit(rng.normal(size=3)) * np.radians(rng.uniform(0, self.fov_deg / 6))
            pose = om.Pose(so3.exp(turn), self._translation(rng))
            if self.motion != "plane":
                return pose, *self._visible(rng, pose, lambda a: rng.uniform(2, 10, len(a)))
            # The axis meets the plane.
            normal, height = directions(rng, 1, 120)[0], rng.uniform(2, 6)

            def distances(a: Array, normal: Array = normal, height: float = height) -> Array:
                cosine = a @ normal
                return np.where(cosine > height / 20, height / np.maximum(cosine, 1e-9), np.nan)

            a, points = self._visible(rng, pose, distances)
            if second_share(pose, normal / height, a) < MAX_SECOND_SHARE:
                return pose, a, points

    def _translation(self, rng: Generator) -> Array:
        t = {"forward": np.array([0.0, 0.0, -1.0]), "sideways": np.array([1.0, 0.0, 0.0])}.get(self.motion)
        if t is None:
            return unit(rng.normal(size=3))
        return so3.exp(unit(rng.normal(size=3)) * np.radians(rng.uniform(0, DEVIATION_DEG))) @ t

    def _visible(self, rng: Generator, pose: om.Pose, distances: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Return bearings of camera a and points that both cameras see; NaN distances are no points."""
        a, points = np.empty((0, 3)), np.empty((0, 3))
        while len(a) < COUNT:
            candidates = directions(rng, 4 * COUNT, self.fov_deg)
            x = candidates * distances(candidates)[:, None]
            seen = unit(pose @ x)[:, 2] > np.cos(np.radians(self.fov_deg / 2))
            a, points = np.concatenate([a, candidates[seen]]), np.concatenate([points, x[seen]])
        return a[:COUNT], points[:COUNT]


def second_share(pose: om.Pose, normal: Array, a: Array) -> float:
    """Return the largest share of points of a plane n.x = 1 that another motion with its homography can have in front.

    If all points of a plane are in front of both cameras for both motions, no method can tell them apart.
    """
    poses, normals = poses_from_homography(pose.rotation + np.outer(pose.translation, normal), np.empty((0, 3)))
    others = [n for p, n in zip(poses, normals, strict=True) if np.abs(p[:, :3] - pose.rotation).max() > 1e-6]
    shares = [float((a @ n > 0).mean()) for n in others]
    return max((max(share, 1 - share) for share in shares), default=0.0)


def known_points(fov_deg: float, outliers: float, sigma_deg: float, seed: int) -> tuple[Array, Array, om.Pose]:
    """Return points at 2 to 10 units from a camera, their bearings, and its pose."""
    rng = np.random.default_rng(seed)
    bearings = directions(rng, COUNT, fov_deg)
    pose = om.Pose(so3.exp(rng.normal(size=3)), rng.normal(size=3))
    points = pose.inverse() @ (bearings * rng.uniform(2, 10, (COUNT, 1)))
    spoil(rng, bearings, outliers)
    return points, noisy(rng, bearings, sigma_deg), pose


def seen_points(views: int, sigma_deg: float, seed: int) -> tuple[list[om.Pose], Array, Array]:
    """Return poses of cameras one unit apart, their bearings (V, N, 3), and points at 2 to 10 units all around."""
    rng = np.random.default_rng(seed)
    points = directions(rng, COUNT, 360) * rng.uniform(2, 10, (COUNT, 1))
    step = unit(rng.normal(size=3))
    poses = [om.Pose(so3.exp(rng.normal(size=3)), np.zeros(3)) @ om.Pose(np.eye(3), -k * step) for k in range(views)]
    return poses, np.stack([noisy(rng, unit(pose @ points), sigma_deg) for pose in poses]), points


def spoil(rng: Generator, bearings: Array, share: float) -> None:
    """Exchange a share of bearings with each other."""
    wrong = rng.permutation(len(bearings))[: round(share * len(bearings))]
    bearings[wrong] = bearings[np.roll(wrong, 1)]


def directions(rng: Generator, count: int, fov_deg: float) -> Array:
    """Return directions uniformly distributed up to half the field of view from the z axis."""
    z, phi = rng.uniform(np.cos(np.radians(fov_deg / 2)), 1, count), rng.uniform(0, 2 * np.pi, count)
    s = np.sqrt(1 - z**2)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)


def noisy(rng: Generator, bearings: Array, sigma_deg: float) -> Array:
    return unit(bearings + np.radians(sigma_deg) * rng.normal(size=bearings.shape))


def unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
