"""Points with known positions and descriptors, and their keypoints in images."""

import numpy as np

import omnisight as om
from omnisight.localization.localize import localize
from omnisight.views import sphere

SPHERE = sphere(1024)
SIGMA_RAD, SIGMA_PX, SIGMA_POINT = 1e-3, 0.3, 1e-3
DIMENSION = 128


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def descriptors_of(points, rng):
    """Return descriptors of observations of points, which differ a little from each other."""
    base = np.abs(np.random.default_rng(7).normal(size=(400, DIMENSION)))
    return unit(unit(base)[points] + 0.02 * rng.normal(size=(len(points), DIMENSION))).clip(0).astype(np.float32)


def seen_from(pose, points, rng, ids, wrong=0.0):
    """Return keypoints of points in a camera at a pose, with Gaussian noise; some are of other points."""
    bearings = unit(pose @ points[ids])
    noise = rng.normal(0, SIGMA_RAD, bearings.shape)
    seen = unit(bearings + noise - (noise * bearings).sum(1, keepdims=True) * bearings)
    covariance = SIGMA_RAD**2 * (np.eye(3) - seen[:, :, None] * seen[:, None, :])
    shown = np.where(rng.random(len(ids)) < wrong, rng.permutation(len(points))[: len(ids)], ids)
    return om.Keypoints(SPHERE.project(seen)[0], seen, covariance, np.full(len(ids), 0.01), descriptors_of(shown, rng))


def localized(keypoints, visual_map, camera=SPHERE):
    return localize(keypoints, visual_map, camera)


def photographed(true, assumed, pose, points, rng):
    """Return keypoints of a camera with the noise of pixels and points, whose bearings are those of another camera."""
    pixels, valid = true.project(pose @ (points + rng.normal(0, SIGMA_POINT, points.shape)))
    ids = rng.permutation(np.flatnonzero(valid & true.in_image(pixels)))
    seen = pixels[ids] + rng.normal(0, SIGMA_PX, (len(ids), 2))
    bearings, valid, by_pixel, _ = assumed.model.unproject_with_jacobians(seen)
    covariance = SIGMA_PX**2 * by_pixel @ by_pixel.transpose(0, 2, 1)
    found = om.Keypoints(seen, bearings, covariance, np.full(len(ids), 0.01), descriptors_of(ids, rng))
    return found[valid]
