"""The first guess of cameras without calibration, from keypoints whose true camera is known."""

import numpy as np
import pytest

from omnisight.features import Keypoints
from omnisight.images import ImageField
from omnisight.images.ellipse import Ellipse
from omnisight.models.equidistant import Equidistant
from omnisight.pipeline.reconstruction.self_calibration import candidate_cameras, select_camera
from sfm.worlds import circle_of_poses, points_around, unit

SIZE, CENTER = (400, 400), (199.5, 199.5)
HALF_DIAGONAL = float(np.hypot(*SIZE)) / 2


def keypoints_of(model, candidate, sigma_px=0.3):
    """Return what four images of a camera hold, with the bearings of a candidate for it."""
    rng, points = np.random.default_rng(3), points_around(500)
    descriptors = unit(rng.normal(size=(len(points), 64))).astype(np.float32)
    found = []
    for pose in circle_of_poses(4, radius=1.0):
        pixels, _ = model.project(pose @ points)
        pixels = pixels + rng.normal(0, sigma_px, pixels.shape)
        seen = np.flatnonzero(((pixels > 0) & (pixels < np.array(SIZE) - 1)).all(axis=1))
        bearings, valid, by_pixel, _ = candidate.model.unproject_with_jacobians(pixels[seen])
        covariance = sigma_px**2 * by_pixel @ by_pixel.transpose(0, 2, 1)
        keypoints = Keypoints(pixels[seen], bearings, covariance, np.full(len(seen), 0.01), descriptors[seen])
        found.append(keypoints[valid])
    return found


@pytest.mark.parametrize("diagonal_deg", [110, 150, 180, 210, 240, 283, 320])
def test_the_selected_focal_length_is_near_that_of_a_fisheye_that_fills_the_image(diagonal_deg):
    focal = HALF_DIAGONAL / np.radians(diagonal_deg / 2)
    candidates = candidate_cameras(ImageField(SIZE))
    selected = select_camera(candidates, keypoints_of(Equidistant(focal, focal, *CENTER), candidates[0]))
    assert selected.model.fx == pytest.approx(focal, rel=0.15)


@pytest.mark.parametrize("degrees", [170, 195, 235])
def test_the_selected_focal_length_is_near_that_of_a_fisheye_with_an_image_circle(degrees):
    focal = 190 / np.radians(degrees / 2)
    candidates = candidate_cameras(ImageField(SIZE, Ellipse(CENTER, (190.0, 190.0), 0.0)))
    selected = select_camera(candidates, keypoints_of(Equidistant(focal, focal, *CENTER), candidates[0]))
    assert selected.model.fx == pytest.approx(focal, rel=0.1)
