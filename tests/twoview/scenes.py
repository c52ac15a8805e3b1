"""Pairs of bearings with noise and outliers, and the pose between the cameras."""

from dataclasses import dataclass

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp, log


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Scene:
    """Points at 2 to 10 baselines in the fields of view of two cameras.

    `outliers` is the share of pairs whose bearings belong to different points.
    """

    fov_deg: float = 190.0
    outliers: float = 0.3
    sigma_deg: float = 0.05
    count: int = 300

    def motion(self, rng):
        """Return the pose of camera b."""
        return Pose(exp(unit(rng.normal(size=3)) * np.radians(self.fov_deg) / 6), unit(rng.normal(size=3)))

    def distances(self, rng, bearings):
        """Return the distances (N, 1) of points along bearings of camera a."""
        return rng.uniform(2, 10, (len(bearings), 1))

    def pairs(self, seed):
        """Return noisy bearings of both cameras, the true pose, and which pairs are inliers."""
        rng = np.random.default_rng(seed)
        pose = self.motion(rng)
        a, points = np.empty((0, 3)), np.empty((0, 3))
        while len(a) < self.count:
            candidates = directions(rng, 4 * self.count, self.fov_deg)
            x = candidates * self.distances(rng, candidates)
            seen = unit(pose @ x)[:, 2] > np.cos(np.radians(self.fov_deg / 2))
            a, points = np.concatenate([a, candidates[seen]]), np.concatenate([points, x[seen]])
        a, b = a[: self.count], unit(pose @ points[: self.count])
        wrong = rng.permutation(self.count)[: round(self.outliers * self.count)]
        b[wrong] = b[np.roll(wrong, 1)]
        inliers = np.ones(self.count, bool)
        inliers[wrong] = False
        return noisy(rng, a, self.sigma_deg), noisy(rng, b, self.sigma_deg), pose, inliers


def directions(rng, count, fov_deg):
    """Return directions uniformly distributed up to half the field of view from the z axis."""
    z, phi = rng.uniform(np.cos(np.radians(fov_deg / 2)), 1, count), rng.uniform(0, 2 * np.pi, count)
    s = np.sqrt(1 - z**2)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)


def noisy(rng, bearings, sigma_deg):
    return unit(bearings + np.radians(sigma_deg) * rng.normal(size=bearings.shape))


def step_between(estimate, truth):
    """Return the step (w, v) of `Pose.moved` that leads from an estimate to the truth."""
    return np.concatenate([log(truth.rotation @ estimate.rotation.T), truth.translation - estimate.translation])


def errors_deg(estimate, truth):
    """Return the errors of the rotation and of the direction of the translation."""
    step = step_between(estimate, truth)
    cosine = unit(estimate.translation) @ unit(truth.translation)
    return np.degrees(np.linalg.norm(step[:3])), np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def normalized_squares(steps, covariances, freedom):
    """Return the squared errors over their covariances, per degree of freedom."""
    return np.array(
        [
            s @ np.linalg.pinv(c, rcond=1e-9, hermitian=True) @ s / freedom
            for s, c in zip(steps, covariances, strict=True)
        ]
    )
