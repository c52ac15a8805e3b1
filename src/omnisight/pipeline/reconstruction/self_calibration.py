"""Cameras of unknown calibration: a first guess from their images, for structure from motion to refine."""

import dataclasses
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import Keypoints, match_features
from omnisight.images import ImageField
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.models.radial_tangential import RadialTangentialPinhole
from omnisight.optim.refinement import THRESHOLDS
from omnisight.parallel import parallel_map
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose

Array = NDArray[np.float64]

# Fields of view, degrees: of an image circle, and of the diagonal of the image of a fisheye or of a perspective lens.
# The circle of a lens of 200 degrees may touch all sides of a square image, whose diagonal then has 283. Mapping
# converges from focal lengths 20 % too short to 25 % too long, so one of the candidates suffices.
CIRCLES = (160.0, 180.0, 200.0, 220.0, 250.0)
FISHEYES, PERSPECTIVES = (100.0, 130.0, 160.0, 190.0, 220.0, 260.0, 300.0), (40.0, 55.0, 70.0, 85.0)
# Number of pairs of images that select the field of view, number of pairs among which these are the ones with most
# matches, and number of keypoints of each image that are matched for that.
MAX_PAIRS, MAX_MATCHED_PAIRS, MAX_MATCHED_KEYPOINTS = 6, 300, 300
# Standard deviations of the principal point about the centre of the image circle or of the image, as a share of the
# image's diagonal, of the ratio of both focal lengths about 1 (board calibrations of one fisheye by several programs
# and models: 0.003), and of further distortion coefficients about zero. Focal length and first coefficient are free.
CENTER_SIGMA, ASPECT_SIGMA, COEFFICIENT_SIGMAS = 0.003, 0.003, {"k2": 0.01, "k3": 0.001}
# Rounds of mapping with the cameras of the round before, and change of the rays at which they end.
MAX_ROUNDS, CONVERGED_RAD = 4, float(np.radians(0.02))


def candidate_cameras(field: ImageField) -> list[Camera]:
    """Return cameras of several fields of view for images with an image circle, or without; the middle one first."""
    width, height = field.size
    if field.outer is not None:
        center, radius = field.outer.centre, field.outer.radius
        candidates = [_fisheye(field.size, center, radius / np.radians(degrees / 2)) for degrees in CIRCLES]
    else:
        center, radius = ((width - 1) / 2, (height - 1) / 2), float(np.hypot(width, height)) / 2
        candidates = [_fisheye(field.size, center, radius / np.radians(degrees / 2)) for degrees in FISHEYES]
        candidates += [
            _perspective(field.size, center, radius / np.tan(np.radians(degrees / 2))) for degrees in PERSPECTIVES
        ]
    return [candidates[1], candidates[0], *candidates[2:]]


def prior_sigmas(camera: Camera) -> dict[tuple[str, ...], float]:
    """Return the standard deviations of the groups of parameters that are refined; see `FreeCameras`."""
    center = CENTER_SIGMA * float(np.hypot(*camera.size))
    focal = float(camera.model.params[camera.model.param_names.index("fy")])
    free = {("fx", "fy"): np.inf, ("fy",): ASPECT_SIGMA * focal, ("k1",): np.inf}
    return {**free, ("cx",): center, ("cy",): center, **{(name,): sigma for name, sigma in COEFFICIENT_SIGMAS.items()}}


def relocated(keypoints: Keypoints, before: Camera, camera: Camera) -> tuple[Keypoints, NDArray[np.bool_]]:
    """Return the keypoints that another camera sees, with its bearings and covariances, and which (N,) these are."""
    by_pixel = before.model.unproject_with_jacobians(keypoints.pixels)[2]
    of_pixel = np.linalg.inv(by_pixel.transpose(0, 2, 1) @ by_pixel) @ by_pixel.transpose(0, 2, 1)
    covariance = of_pixel @ keypoints.covariance @ of_pixel.transpose(0, 2, 1)
    bearings, valid, by_pixel, _ = camera.model.unproject_with_jacobians(keypoints.pixels)
    moved = by_pixel @ covariance @ by_pixel.transpose(0, 2, 1)
    return dataclasses.replace(keypoints, bearings=bearings, covariance=moved)[valid], valid


def select_camera(candidates: Sequence[Camera], keypoints: Sequence[Keypoints]) -> Camera:
    """Return the camera with which the matches of a few pairs of images agree best with a motion.

    The measure is the sum of squared errors, each truncated, against that of outliers only. The keypoints are those of
    the first candidate.
    """
    strongest = [each[:MAX_MATCHED_KEYPOINTS] for each in keypoints]
    pairs = list(combinations(range(len(keypoints)), 2))[:MAX_MATCHED_PAIRS]
    counts = parallel_map(lambda pair: len(match_features(strongest[pair[0]], strongest[pair[1]]).pairs), pairs)
    best = [pairs[i] for i in np.argsort(-np.array(counts), kind="stable")[:MAX_PAIRS]]
    matches = [match_features(keypoints[a], keypoints[b]).pairs for a, b in best]

    def gain(camera: Camera) -> float:
        total = 0.0
        for (a, b), rows in zip(best, matches, strict=True):
            (of_a, seen_a), (of_b, seen_b) = (
                relocated(keypoints[image][rows[:, side]], candidates[0], camera) for side, image in enumerate((a, b))
            )
            of_a, of_b = of_a[seen_b[seen_a]], of_b[seen_a[seen_b]]
            if len(of_a) >= 8:
                pairs = BearingPairs.of(of_a.bearings, of_b.bearings, of_a.covariance, of_b.covariance, None)
                score = estimate_relative_pose(pairs).score
                total += THRESHOLDS[1] * len(pairs) - score if np.isfinite(score) else 0.0
        return total

    return candidates[int(np.argmax([gain(camera) for camera in candidates]))]


def change_of_rays(before: Camera, camera: Camera, keypoints: Sequence[Keypoints]) -> float:
    """Return the median angle, radians, between the rays of keypoints of a camera and of the one before."""
    pixels = np.concatenate([np.zeros((0, 2)), *(each.pixels for each in keypoints)])
    (a, in_a), (b, in_b) = (each.model.unproject(pixels) for each in (before, camera))
    use = in_a & in_b
    return float(np.median(np.linalg.norm(a[use] - b[use], axis=1))) if use.any() else 0.0


def _fisheye(size: tuple[int, int], center: tuple[float, float], focal: float) -> Camera:
    model = KannalaBrandt(fx=focal, fy=focal, cx=center[0], cy=center[1], k1=0.0, k2=0.0, k3=0.0, k4=0.0)
    return Camera(model, size)


def _perspective(size: tuple[int, int], center: tuple[float, float], focal: float) -> Camera:
    zero = dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), 0.0)
    return Camera(RadialTangentialPinhole(fx=focal, fy=focal, cx=center[0], cy=center[1], **zero), size)
