"""Alignment of patches with images that are known functions."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from omnisight.visual_odometry._patch_alignment_kernel import align
from omnisight.visual_odometry._patch_kernel import SAMPLES, extract

IDENTITY, STRAIGHT = np.eye(2), np.zeros((2, 3))


def scene(u, v):
    """Return intensities of a smooth texture at pixels."""
    waves = (
        35 * np.sin(0.41 * u + 0.5) * np.cos(0.37 * v) + 25 * np.sin(0.29 * u - 0.33 * v) + 20 * np.cos(0.51 * v + 1)
    )
    return 120 + waves


def image(shift=(0.0, 0.0), matrix=IDENTITY, gain=1.0, offset=0.0, bend=0.0):
    """Return an image whose pixel (50, 40) shows the scene at (50, 40) + shift, and its surroundings by a matrix.

    Rows of the scene become parabolas v = bend u^2.
    """
    v, u = np.mgrid[:80, :100]
    at = np.einsum("ij,jhw->ihw", matrix, np.stack([u - 50.0, v - 40.0 - bend * (u - 50.0) ** 2]))
    return np.clip(gain * scene(at[0] + 50 + shift[0], at[1] + 40 + shift[1]) + offset, 0, 255).round().astype(np.uint8)


def quadratic(matrix, bend=STRAIGHT):
    """Return the map (1, 2, 5) of a patch."""
    return np.hstack([matrix, bend])[None]


@dataclass(frozen=True)
class Surface:
    """Derivative of the pixel by the logarithm of the depth, and standard deviation of the slopes."""

    depth: tuple[float, float] = (0.0, 0.0)
    sigma: float = 0.0


def aligned(*seen, maps=IDENTITY, start=(50.0, 40.0), surface=Surface(), bend=STRAIGHT):
    """Return position, correlation, covariance of the shift over the variance of the intensities, and slopes.

    `seen` is the pyramid of the image with which the patch is aligned.
    """
    levels = (image(),)
    arrays = (
        np.zeros((1, 1, SAMPLES), np.float32),
        np.zeros((1, 1, SAMPLES, 2), np.float32),
        np.zeros((1, 1, 2, 2)),
        np.zeros((1, SAMPLES, 6), np.float32),
        np.zeros((1, 1), bool),
    )
    rows = np.zeros(1, np.intp)
    extract(levels, np.array([[50.0, 40.0]]), quadratic(np.eye(2)), rows, arrays, 0, 1)
    assert arrays[4].all()
    pixels, correlation, noise, uncertainty = np.array([start]), np.empty(1), np.empty(1), np.zeros((1, 2, 2))
    maps, level, slopes = quadratic(maps, bend), np.zeros(1, np.intp), np.zeros((1, 2))
    depths, sigma = np.array([surface.depth]), np.array([surface.sigma])
    align(seen, arrays, rows, maps, depths, level, sigma, slopes, pixels, correlation, noise, uncertainty, 0, 1)
    return pixels[0], correlation[0], uncertainty[0], slopes[0]


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.3, -0.7), (-2.2, 1.9)])
def test_a_shift_is_found(shift):
    pixel, correlation, *_ = aligned(image(shift))
    assert np.allclose(pixel, np.array([50.0, 40.0]) - shift, atol=0.03)
    assert correlation > 0.99


def test_contrast_and_brightness_have_no_effect():
    pixel, correlation, *_ = aligned(image((1.3, -0.7), gain=0.6, offset=30.0))
    assert np.allclose(pixel, (48.7, 40.7), atol=0.05)
    assert correlation > 0.99


def test_an_affine_map_is_applied():
    matrix = np.array([[0.8, 0.3], [-0.2, 1.1]])
    pixel, correlation, *_ = aligned(image(matrix=matrix), maps=np.linalg.inv(matrix), start=(50.8, 39.5))
    assert np.allclose(pixel, (50.0, 40.0), atol=0.05)
    assert correlation > 0.99
    assert aligned(image(matrix=matrix), start=(50.8, 39.5))[1] < correlation


def test_a_curved_image_of_straight_lines_does_not_move_the_patch():
    curved, down = image(bend=0.02), np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]])
    pixel, correlation, *_ = aligned(curved, start=(50.4, 39.7), bend=down)
    assert np.allclose(pixel, (50.0, 40.0), atol=0.03)
    straight, less_similar, *_ = aligned(curved, start=(50.4, 39.7))
    assert correlation > less_similar
    assert np.linalg.norm(straight - (50, 40)) > 0.05


def test_a_uniform_image_shows_no_patch():
    assert aligned(np.full((80, 100), 90, np.uint8))[1] == -1


def test_a_patch_that_leaves_the_image_is_not_found():
    assert aligned(image(), start=(2.0, 40.0))[1] == -1


def test_the_slopes_of_a_surface_are_estimated():
    """The prediction has the map of a surface across the line of sight."""
    depth, slopes = np.array([6.0, -2.0]), np.array([0.04, -0.03])
    slanted, start = image(matrix=np.linalg.inv(np.eye(2) - np.outer(depth, slopes))), (50.4, 39.7)
    fixed, similar, certain, _ = aligned(slanted, start=start)
    refined, more_similar, uncertainty, found = aligned(slanted, start=start, surface=Surface((6.0, -2.0), 0.1))
    assert more_similar > max(similar, 0.99)
    assert np.allclose(refined, (50.0, 40.0), atol=0.05)
    assert np.allclose(found, slopes, atol=0.004)
    assert np.linalg.norm(refined - (50, 40)) < np.linalg.norm(fixed - (50, 40))
    # More unknowns leave the position less certain.
    assert np.linalg.eigvalsh(uncertainty - certain).min() >= -1e-9


def test_a_patch_seen_from_near_is_compared_with_a_coarser_image():
    """The samples of the patch are then as far apart as the pixels, and the noise of the image is averaged."""
    near, rng, errors = image(matrix=np.eye(2) / 2.5), np.random.default_rng(0), []
    for _ in range(20):
        noisy = np.clip(near + rng.normal(0, 12, near.shape), 0, 255).astype(np.uint8)
        found = [aligned(*levels, maps=2.5 * IDENTITY)[0] for levels in ((noisy,), (noisy, cv2.pyrDown(noisy)))]
        errors.append([np.linalg.norm(pixel - (50, 40)) for pixel in found])
    fine, coarse = np.sqrt(np.mean(np.square(errors), axis=0))
    assert coarse < 0.7 * fine
    assert coarse < 0.2
