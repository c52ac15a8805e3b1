"""Uncertainty of the relative rotation of two lenses, against Monte Carlo."""

import numpy as np
import pytest

from omnisight import Camera
from omnisight.geometry import rotation as so3
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.sfm.head_calibration import fit_head_rotation
from omnisight.sfm.head_matches import INDEPENDENT_MATCHES, OverlapMatches

SIZE = 1000
FOCAL = SIZE / 2 / np.radians(100)
LENS = Camera(KannalaBrandt(FOCAL, FOCAL, 499.5, 499.5, 0.0, 0.0, 0.0, 0.0), (SIZE, SIZE))
BACK_FROM_FRONT = so3.exp([0.0, np.pi, 0.0])
TRIALS = 40


def squared_error(seed, frames, matches, baseline):
    """Return the squared error of an estimate in units of its covariance, divided by three."""
    rng = np.random.default_rng(seed)
    phi, theta = rng.uniform(0, 2 * np.pi, matches), np.radians(rng.uniform(84, 96, matches))
    front = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    # A smooth scene at 0.5 to 3.5 m: neighbouring matches have the same parallax.
    distance = 2 + np.sin(phi + rng.uniform(0, 6)) + 0.5 * np.sin(2 * phi + rng.uniform(0, 6))
    back = (front * distance[:, None] - [0, 0, baseline]) @ BACK_FROM_FRONT.T
    pixels = [LENS.project(x)[0] + rng.normal(0, 0.5, (matches, 2)) for x in (front, back)]
    found = fit_head_rotation((LENS, LENS), OverlapMatches(pixels[0], pixels[1], np.arange(matches) % frames))
    assert found
    error = so3.log(found.rotation @ BACK_FROM_FRONT.T)
    return error @ np.linalg.solve(found.covariance[10:13, 10:13], error) / 3


@pytest.mark.parametrize(
    ("frames", "matches", "baseline", "low", "high"),
    [
        # As many matches as are assumed independent: 120 degrees of freedom, three standard deviations.
        pytest.param(4, 4 * INDEPENDENT_MATCHES, 0.0, 0.61, 1.39, id="independent"),
        # Parallax of 3 cm that all matches share: with independent ones assumed, the ratio is above 10.
        pytest.param(1, 600, 0.03, 0.25, 2.0, id="parallax"),
    ],
)
def test_the_covariance_of_a_head_rotation_is_that_of_its_errors(frames, matches, baseline, low, high):
    ratios = [squared_error(seed, frames, matches, baseline) for seed in range(TRIALS)]
    assert low < np.mean(ratios) < high


def test_more_frames_with_parallax_of_their_own_reduce_the_uncertainty_of_a_head_rotation():
    """The uncertainty falls with the root of the number of frames, and not with that of the matches."""
    rng = np.random.default_rng(0)
    phi, theta = rng.uniform(0, 2 * np.pi, 1200), np.radians(rng.uniform(84, 96, 1200))
    front = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    pixels = [LENS.project(x)[0] + rng.normal(0, 0.5, (1200, 2)) for x in (front, front @ BACK_FROM_FRONT.T)]

    def sigma(frames, step):
        rows = slice(None, None, step)
        frame = np.arange(1200)[rows] % frames
        matches = OverlapMatches(pixels[0][rows], pixels[1][rows], frame)
        return fit_head_rotation((LENS, LENS), matches).rotation_sigma_deg

    assert sigma(4, 1) == pytest.approx(sigma(1, 1) / 2, rel=1e-6)
    assert sigma(1, 4) == pytest.approx(sigma(1, 1), rel=0.15)
