"""Occlusion in catadioptric cameras: rims, holes, backs and other mirrors."""

import numpy as np
import pytest
from systems import BALL, FISHEYE, FLAT, HYPERBOLA, PINHOLE, SYSTEMS, visible_points

from omnisight.optics import Catadioptric, PlacedMirror
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane


def test_points_that_no_mirror_shows_are_not_valid():
    system = Catadioptric(PINHOLE, (PlacedMirror(BALL, tz=0.12),))
    hidden = {
        "straight behind it": [0.0, 0.0, 1.0],
        "behind it, beside the axis": [0.1, 0.0, 1.0],
        "inside it": [0.0, 0.01, 0.15],
        "no point": [np.nan, 0.0, 1.0],
        "no place": [np.inf, 0.0, 1.0],
        "too far to be squared": [1e200, 0.0, 0.0],
    }
    pixels, valid = system.project(np.array(list(hidden.values())))
    assert not valid.any(), [name for name, v in zip(hidden, valid, strict=True) if v]
    assert np.isnan(pixels).all()
    assert system.project([0.5, 0.0, 0.0])[1]


def test_points_on_valid_rays_are_valid():
    # Directions all around a mirror: those that `project` shows fill the cone of the rays through its rim, and no more.
    system = Catadioptric(FISHEYE, (PlacedMirror(Conic.parabola(0.06, 0.04), tz=0.05),))
    rim = system.mirrors[0].lens_from_mirror @ np.array([0.04, 0.0, system.mirrors[0].mirror.sag(0.04)])
    ray = system.rays(FISHEYE.project(rim * [1 - 1e-9, 1, 1])[0])
    limit = np.arctan2(ray.bearings[0], ray.bearings[2])
    theta = np.linspace(limit - 0.2, np.pi, 400)
    points = ray.origins + 1e6 * np.stack([np.sin(theta), 0 * theta, np.cos(theta)], -1)
    _, valid = system.project(points)
    np.testing.assert_array_equal(valid, theta >= limit)


@pytest.mark.parametrize("name", ["conic-oblique", "ball-oblique", "cone-decentred", "asphere-on-axis", "ring-on-axis"])
def test_points_proven_hidden_are_not_found_from_other_start_points(name, monkeypatch):
    # All around, near and far: as many points are shown as if the search went on after the first answer.
    system = SYSTEMS[name]
    rng = np.random.default_rng(7)
    points = rng.normal(size=(600, 3))
    points *= np.exp(rng.uniform(-4, 7, (600, 1))) / np.linalg.norm(points, axis=-1, keepdims=True)
    points[:, 2] += 0.12
    _, valid = system.project(points)
    assert 0.1 < valid.mean() < 0.97
    monkeypatch.setattr(Catadioptric, "_proves_hidden", lambda _self, _u, points: np.zeros(len(points), bool))
    np.testing.assert_array_equal(system.project(points)[1], valid)


def test_valid_rays_are_finite():
    # All of a ball's image, its very limb included, and pixels that are none.
    system = SYSTEMS["ball-oblique"]
    placed = system.mirrors[0]
    phi = np.linspace(0, 2 * np.pi, 600)
    for share in (1.0, 1 - 1e-16, 1 - 1e-12):
        rho = 0.04 * share
        at = np.stack([rho * np.cos(phi), rho * np.sin(phi), np.full_like(phi, BALL.sag(rho))], -1)
        pixels, seen = PINHOLE.project(placed.lens_from_mirror @ at)
        rays = system.rays(np.concatenate([pixels[seen], [[np.nan, 0.0], [np.inf, 0.0], [1e300, 1.0]]]))
        for part in (rays.origins, rays.bearings):
            np.testing.assert_array_equal(np.isfinite(part).all(-1), rays.valid)


def test_smaller_rim_only_removes_points():
    wide = Catadioptric(PINHOLE, (PlacedMirror(HYPERBOLA, tz=0.09),))
    narrow = Catadioptric(
        PINHOLE, (PlacedMirror(Conic(HYPERBOLA.radius, HYPERBOLA.eccentricity, 0.02, 0.005), tz=0.09),)
    )
    points, pixels = visible_points(wide)
    corners, _ = wide.reflection_points(points)
    rho = np.hypot(corners[:, 0, 0], corners[:, 0, 1])
    _, valid = narrow.project(points)
    np.testing.assert_array_equal(valid, (rho <= 0.02) & (rho >= 0.005))
    np.testing.assert_array_equal(narrow.rays(pixels).valid, valid)


def test_lens_behind_a_mirror_without_a_hole_has_no_valid_rays():
    small = PlacedMirror(Conic.sphere(0.05, 0.02), tz=0.1)
    pierced = Catadioptric(PINHOLE, (small, PlacedMirror(FLAT, np.pi, tz=0.01)))
    solid = Catadioptric(
        PINHOLE, (small, PlacedMirror(Conic(FLAT.radius, FLAT.eccentricity, FLAT.rim), np.pi, tz=0.01))
    )
    points, pixels = visible_points(pierced)
    assert not solid.project(points)[1].any()
    assert not solid.rays(pixels).valid.any()


@pytest.mark.parametrize("rim", [0.02, 0.04])
def test_first_mirror_blocks_rays_of_the_second(rim):
    # Two planes face to face: light at the slope s from the axis meets them at s D, s (2 D - d) and passes the first
    # at s (3 D - 2 d).
    system = Catadioptric(PINHOLE, (PlacedMirror(Plane(rim), tz=0.1), PlacedMirror(Plane(0.2, 0.015), np.pi, tz=0.01)))
    slope = np.linspace(0.01, 0.45, 300)
    pixels, _ = PINHOLE.project(np.stack([slope, 0 * slope, slope * 0 + 1], -1))
    expected = (0.1 * slope <= rim) & (0.19 * slope >= 0.015) & (0.28 * slope > rim)
    np.testing.assert_array_equal(system.rays(pixels).valid, expected)
    points = np.stack([slope * 1.18, 0 * slope, 0 * slope + 1], -1)  # at z = 1 of the same light
    found, valid = system.project(points)
    np.testing.assert_array_equal(valid, expected)
    np.testing.assert_allclose(found[valid], pixels[valid], atol=1e-9)


def test_wall_of_a_concave_mirror_blocks_rays():
    # Of a deep bowl: light that would leave through its wall does not.
    deep = Catadioptric(FISHEYE, (PlacedMirror(Conic.sphere(-0.1, 0.0999), tx=0.05, tz=0.06),))
    shallow = Catadioptric(FISHEYE, (PlacedMirror(Conic.sphere(-0.1, 0.05), tx=0.05, tz=0.06),))
    points, pixels = visible_points(shallow, 1.0, 2.0)
    inside = deep.rays(pixels).valid
    assert 0 < inside.sum() < len(inside)
    assert deep.project(points[inside])[1].all()
    # Where the deep one shows such a point after all, it is elsewhere in the image.
    found, valid = deep.project(points[~inside])
    assert (np.abs(found - pixels[~inside])[valid].max(-1) > 100).all()
