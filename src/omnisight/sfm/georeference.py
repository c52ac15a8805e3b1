"""Scale and place of maps: from positions of images, or from the distance between two."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.sfm.map import Map
from omnisight.sfm.mapping import adjust_map
from omnisight.sfm.measurements import MeasuredDistance, MeasuredPositions, camera_positions

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Samples of the robust estimation: of three images each, half of which may have wrong positions.
SAMPLES = 500
# Residuals of correct positions in standard deviations, and rounds of their selection.
MAX_RESIDUAL_SIGMA, ROUNDS = 4.0, 5
# Standard deviations above which positions do not determine the scale and the orientation of a map.
MAX_SCALE_SIGMA, MAX_ROTATION_SIGMA = 0.1, float(np.radians(5.0))
# Relative standard deviation of a specified distance: it is taken as exact.
DISTANCE_SIGMA = 1e-5
# Least standard deviation of positions, metres.
MIN_SIGMA = 1e-6
# Median of the length of a vector of three independent unit Gaussians.
MAXWELL_MEDIAN = 1.538


@dataclass(frozen=True, eq=False)
class Similarity:
    """The map b = scale * rotation @ a + translation."""

    scale: float
    rotation: Array
    translation: Array

    def __matmul__(self, points: Array) -> Array:
        """Map points (N, 3)."""
        return self.scale * points @ self.rotation.T + self.translation


@dataclass(frozen=True, eq=False)
class Georeference(Displayed):
    """How a map was brought into the world; false if it was not.

    Attributes
    ----------
    images
        Number of its images with a known position.
    inliers
        Number of those that agree with the map.
    sigma
        (3,) standard deviations of these positions, metres, along the axes of the world.
    reason
        Why the map is not in metres; empty otherwise.
    """

    images: int
    inliers: int = 0
    sigma: Array | None = None
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether the map is in metres."""
        return not self.reason


def georeferenced(found: Map, positions: Array) -> tuple[Map, Georeference]:
    """Bring a map into the frame of known positions, and adjust it to them and to its observations.

    Parameters
    ----------
    found
        The map.
    positions
        (I, 3) of all images, metres; NaN if unknown. Up to half of them may be wrong.
    """
    rows = found.row_of_image
    known = np.flatnonzero((rows >= 0) & np.isfinite(positions).all(axis=1))
    if len(known) < 3:
        reason = f"{len(known)} images of the model have a known position; 3 or more are needed"
        return found, Georeference(len(known), reason=reason)
    centers, frames = found.images.centers[found.images.sensor[known]], rows[known]
    estimated, _ = camera_positions(found.rig_from_world[frames], centers)
    similarity, inlier = robust_similarity(estimated, positions[known], fixes_scale=found.has_scale)
    residuals = (similarity @ estimated - positions[known])[inlier]
    sigma = np.sqrt((residuals**2).sum(axis=0) / max(inlier.sum() - 7 / 3, 1))
    count = int(inlier.sum())
    if reason := _insufficient(similarity @ estimated[inlier], sigma):
        return found, Georeference(len(known), count, sigma, reason)
    of_inliers = frames[inlier], similarity.scale * centers[inlier], positions[known][inlier]
    moved = replace(
        transformed(found, similarity), measured=MeasuredPositions(*of_inliers, np.maximum(sigma, MIN_SIGMA))
    )
    return adjust_map(moved), Georeference(len(known), count, sigma)


def scaled(found: Map, a: int, b: int, metres: float) -> tuple[Map, Georeference]:
    """Scale a map to a known distance between two of its images."""
    images = np.array([a, b])
    rows = found.row_of_image[images]
    if (rows < 0).any():
        return found, Georeference(int((rows >= 0).sum()), reason="the model lacks an image of the known distance")
    centers = found.images.centers[found.images.sensor[images]]
    positions, _ = camera_positions(found.rig_from_world[rows], centers)
    distance = float(np.linalg.norm(positions[1] - positions[0]))
    if not distance:
        return found, Georeference(2, reason="the images of the known distance have the same position")
    similarity = Similarity(metres / distance, np.eye(3), np.zeros(3))
    measured = MeasuredDistance(rows, similarity.scale * centers, metres, metres * DISTANCE_SIGMA)
    return replace(transformed(found, similarity), measured=measured), Georeference(2, 2)


def transformed(found: Map, similarity: Similarity) -> Map:
    """Return a map in another world: x_new = similarity @ x_old."""
    poses, sensors = found.rig_from_world.copy(), found.sensor_from_rig.copy()
    poses[:, :, :3] = found.rig_from_world[:, :, :3] @ similarity.rotation.T
    poses[:, :, 3] = similarity.scale * found.rig_from_world[:, :, 3] - poses[:, :, :3] @ similarity.translation
    sensors[:, :, 3] *= similarity.scale
    return replace(
        found,
        images=replace(found.images, sensor_from_rig=sensors),
        rig_from_world=poses,
        sensor_from_rig=sensors,
        points=similarity @ found.points,
    )


def robust_similarity(a: Array, b: Array, *, fixes_scale: bool = False) -> tuple[Similarity, NDArray[np.bool_]]:
    """Return the similarity from points a (N, 3) to b, and the inliers (N,).

    Least median of squares over samples of three points, then least squares of the inliers (P. Rousseeuw, A. Leroy,
    Robust regression and outlier detection, 1987; the scale is corrected for few points as there).
    """
    rng = np.random.default_rng(0)
    samples = [rng.choice(len(a), 3, replace=False) for _ in range(SAMPLES)]
    candidates = [least_squares_similarity(a[s], b[s], fixes_scale=fixes_scale) for s in samples]
    best = min(candidates, key=lambda each: float(np.median(((each @ a - b) ** 2).sum(axis=1))))
    median = float(np.median(np.linalg.norm(best @ a - b, axis=1)))
    threshold = MAX_RESIDUAL_SIGMA * max((1 + 5 / max(len(a) - 3, 1)) * median / MAXWELL_MEDIAN, MIN_SIGMA)
    for _ in range(ROUNDS):
        inlier = np.linalg.norm(best @ a - b, axis=1) <= threshold
        best = least_squares_similarity(a[inlier], b[inlier], fixes_scale=fixes_scale)
    return best, np.linalg.norm(best @ a - b, axis=1) <= threshold


def least_squares_similarity(a: Array, b: Array, *, fixes_scale: bool = False) -> Similarity:
    """Return the similarity from points a (N, 3) to b with the least squares (S. Umeyama, 1991)."""
    of_a, of_b = a - a.mean(axis=0), b - b.mean(axis=0)
    covariance = of_b.T @ of_a
    rotation = so3.nearest(covariance)
    scale = 1.0 if fixes_scale else float((rotation * covariance).sum()) / max(float((of_a**2).sum()), 1e-300)
    return Similarity(scale, rotation, b.mean(axis=0) - scale * rotation @ a.mean(axis=0))


def _insufficient(positions: Array, sigma: Array) -> str:
    """Return why positions (N, 3) with standard deviations (3,) do not determine a similarity; empty if they do."""
    arms = positions - positions.mean(axis=0)
    variance = max(float((sigma**2).mean()), MIN_SIGMA**2)
    radius = np.linalg.norm(arms, axis=1).max(initial=0.0)
    scale_sigma = np.sqrt(variance / max(float((arms**2).sum()), 1e-300))
    if scale_sigma > MAX_SCALE_SIGMA:
        return (
            f"the known positions scatter by {np.sqrt(variance):.2g} m, and the images are at most {radius:.2g} m from"
            " their centre"
        )
    skew = so3.hat(arms)
    information = np.einsum("nij,nik->jk", skew, skew) / variance
    if np.linalg.eigvalsh(information)[0] < 1 / MAX_ROTATION_SIGMA**2:
        return "the known positions are on a line, about which any rotation is possible"
    return ""
