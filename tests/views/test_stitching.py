"""Seams, colours, blending and levelling, against closed forms."""

import numpy as np
import pytest

from omnisight.views.stitching.blending import Blender
from omnisight.views.stitching.levelling import estimate_vertical
from omnisight.views.stitching.local_warp import SeamWarp, measure_disparity
from omnisight.views.stitching.photometry import OverlapSamples, estimate_photometry
from omnisight.views.stitching.sampling import PolarGrid
from omnisight.views.stitching.seams import Seam, find_seam

GRID = PolarGrid.around(np.array([0.3, 0.2, 0.93]) / np.linalg.norm([0.3, 0.2, 0.93]), 1.2, 1.9, 256)


def sphere_bearings(width):
    lon = (np.arange(width) + 0.5) * 2 * np.pi / width - np.pi
    lat = ((np.arange(width // 2) + 0.5) * 2 * np.pi / width - np.pi / 2)[:, None]
    return np.stack([np.cos(lat) * np.sin(lon), np.sin(lat) + 0 * lon, np.cos(lat) * np.cos(lon)], -1)


def test_coordinates_of_a_polar_grid_invert_its_bearings():
    theta, column = GRID.coordinates(GRID.bearings())
    assert np.allclose(theta, GRID.theta[:, None], atol=1e-12)
    assert np.allclose(column, np.arange(256), atol=1e-9)


def test_a_seam_follows_the_rows_without_differences_and_is_closed():
    rows, columns = len(GRID.theta), GRID.columns
    valley = np.rint(rows / 2 + 6 * np.sin(2 * np.pi * np.arange(columns) / columns)).astype(int)
    difference = np.minimum(np.abs(np.arange(rows)[:, None] - valley) * 20, 200).astype(np.uint8)
    inner = np.repeat(difference[..., None], 3, -1)
    seam = find_seam(GRID, inner, np.zeros_like(inner), np.ones((rows, columns), bool))
    assert np.abs(seam.row - valley).max() <= 2
    assert abs(int(seam.row[0]) - int(seam.row[-1])) <= 2


def test_a_seam_stays_in_the_overlap():
    rows, columns = len(GRID.theta), GRID.columns
    overlap = np.zeros((rows, columns), bool)
    overlap[10:20] = True
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (2, rows, columns, 3)).astype(np.uint8)
    assert overlap[find_seam(GRID, *images, overlap).row, np.arange(columns)].all()


@pytest.mark.parametrize("pairs", [[(0, 1)], [(1, 0), (2, 1), (2, 0)]])
def test_gains_and_vignetting_are_recovered_from_overlaps(pairs):
    rng = np.random.default_rng(1)
    gains = np.array([[0.2, 0.0, -0.1], [-0.2, 0.05, 0.1], [0.0, -0.05, 0.0]])[: max(map(max, pairs)) + 1]
    gains -= gains.mean(0)
    samples = []
    for pair in pairs:
        light, radius = rng.uniform(0.1, 0.5, (4000, 3)), rng.uniform(0.6, 1.0, (2, 4000))
        colors = []
        for k, own in zip(pair, radius, strict=True):
            seen = light * np.exp(gains[k]) * np.exp(-0.25 * own**4)[:, None]
            colors.append(255 * np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055))
        samples.append(OverlapSamples(pair, tuple(colors), tuple(radius)))
    found = estimate_photometry(samples, len(gains))
    assert np.abs(found.log_gain - gains).max() < 0.02
    loss = sum(c * 1.0 for c in found.vignetting) - sum(
        c * 0.6**p for c, p in zip(found.vignetting, (2, 4, 8), strict=True)
    )
    assert loss == pytest.approx(-0.25 * (1 - 0.6**4), abs=0.04)


def test_blending_equal_images_changes_nothing_and_a_step_becomes_smooth():
    labels = np.zeros((128, 256), int)
    labels[:, 128:] = 1
    seen = [np.ones((128, 256), bool)] * 2
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (128, 256, 3)).astype(np.uint8)
    blender = Blender(labels, seen)
    assert np.abs(blender([image, image]).astype(int) - image).max() <= 1
    flat = [np.full((128, 256, 3), level, np.uint8) for level in (100, 140)]
    row = blender(flat)[64, :, 0].astype(int)
    assert np.abs(np.diff(row)).max() <= 8
    assert abs(row[0] - row[-1]) <= 8  # the seam of the image is no border of the sphere


def test_a_warp_by_the_measured_disparity_closes_it():
    rng = np.random.default_rng(3)
    import cv2

    rows, columns = len(GRID.theta), GRID.columns
    texture = cv2.GaussianBlur(rng.integers(0, 255, (rows, columns)).astype(np.float32), (0, 0), 2) * 4 - 380
    inner = np.repeat(np.clip(texture, 0, 255).astype(np.uint8)[..., None], 3, -1)
    outer = np.roll(inner, (1, 2), (0, 1))
    seam = Seam(GRID, np.full(columns, rows // 2))
    disparity = measure_disparity(seam, inner, outer, np.ones((rows, columns), bool))
    assert np.median(disparity.flow, axis=0) == pytest.approx([2.0, 1.0], abs=0.3)
    at = GRID.bearings()[rows // 2]
    theta, column = GRID.coordinates(SeamWarp(seam, np.tile([2.0, 1.0], (columns, 1)), 0.5)(at))
    assert np.allclose(theta - GRID.theta[rows // 2], 0.5 / GRID.px_per_rad, atol=1e-9)
    assert np.allclose((column - np.arange(columns)) % columns, 1.0, atol=1e-6)


def test_the_vertical_of_stripes_along_meridians_is_recovered():
    bearings = sphere_bearings(1024)
    tilt = np.radians(8.0)
    up = np.array([0.0, -np.cos(tilt), np.sin(tilt)])
    right = np.array([1.0, 0.0, 0.0])
    forward = np.cross(right, -up)
    azimuth = np.arctan2(bearings @ right, bearings @ forward)
    stripes = np.where(np.sin(12 * azimuth) > 0, 200, 40).astype(np.uint8)
    found = estimate_vertical(np.repeat(stripes[..., None], 3, -1), bearings, np.array([0.0, -1.0, 0.0]))
    assert not found.reason
    assert np.degrees(np.arccos(found.up @ up)) < 0.5


def test_an_image_without_edges_has_no_vertical():
    flat = np.full((256, 512, 3), 90, np.uint8)
    assert "edge pixels" in estimate_vertical(flat, sphere_bearings(512), np.array([0.0, -1.0, 0.0])).reason


@pytest.mark.parametrize("edge", range(120, 128))
def test_the_edge_of_an_image_leaves_no_line_where_both_images_are_equal(edge):
    """The seam follows the edge of the first image, which is black where it shows nothing."""
    height, width = 128, 256
    seen = [np.broadcast_to(np.arange(width) < edge, (height, width)), np.ones((height, width), bool)]
    labels = np.where(seen[0], 0, 1)
    images = [np.repeat(np.where(mask, 150, 0).astype(np.uint8)[..., None], 3, -1) for mask in seen]
    np.testing.assert_allclose(Blender(labels, seen)(images), 150, atol=1)
