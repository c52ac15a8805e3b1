"""Lens positions with a single viewpoint, and the best viewpoint of any camera."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from omnisight.camera import Camera
from omnisight.geometry.rays import Rays
from omnisight.models.pinhole import Pinhole
from omnisight.models.unified import Unified
from omnisight.optics import Catadioptric, PlacedMirror, Telecentric
from omnisight.optics.mirrors.asphere import Asphere
from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane
from omnisight.optics.viewpoint import best_viewpoint, lens_positions

PHI = np.linspace(0, 2 * np.pi, 16, endpoint=False)
AROUND = np.stack([np.cos(PHI), np.sin(PHI)], -1)
PIXELS = np.linspace(20, 320, 11)[:, None, None] * AROUND
CONICS = {
    "hyperbola": Conic.hyperbola(0.028, 0.0385, 0.03),
    "flat hyperbola": Conic.hyperbola(0.02, 0.1, 0.03),
    "parabola": Conic.parabola(0.05, 0.03),
    "bowl, parabola": Conic.parabola(-0.2, 0.03),
    "bowl, ellipse": Conic.ellipse(0.12, 0.05, 0.04),
    "bowl, hyperbola": Conic(-0.1, 1.6, 0.03),
}
USEFUL = [
    (name, place) for name, mirror in CONICS.items() for place in lens_positions(mirror) if not place.unusable_because
]


def camera(mirror, lens, focal=1000.0):
    """Return a camera with its lens at z of the mirror frame, or telecentric."""
    if np.isinf(lens):
        return Catadioptric(Telecentric(1e4, 1e4, 0.0, 0.0), (PlacedMirror(mirror, tz=0.3),))
    return Catadioptric(Pinhole(focal, focal, 0.0, 0.0), (PlacedMirror(mirror, tz=-lens),))


def off_focus(by=0.01):
    mirror = CONICS["hyperbola"]
    return camera(mirror, lens_positions(mirror)[0].lens - by)


class Twisted:
    """Rays at a constant distance from the z axis, horizontal at v = 0: px per radian of azimuth and elevation."""

    def __init__(self, distance, focal=500.0):
        self.distance, self.focal = distance, focal

    def rays(self, pixels):
        phi, up = np.moveaxis(np.asarray(pixels, float) / self.focal, -1, 0)
        bearings = np.stack([np.cos(phi) * np.cos(up), np.sin(phi) * np.cos(up), np.sin(up)], -1)
        origins = self.distance * np.stack([-np.sin(phi), np.cos(phi), 0 * phi], -1)
        return Rays(origins, bearings, np.ones(phi.shape, bool))


@pytest.mark.parametrize(("name", "place"), USEFUL)
def test_lens_position_gives_a_single_viewpoint(name, place):
    system = camera(CONICS[name], place.lens, 2000.0 if place.lens > -0.04 else 1000.0)
    found = best_viewpoint(system, PIXELS)
    assert len(found.distances) > 100
    vertex = system.mirrors[0].tz
    np.testing.assert_allclose(found.point, [0, 0, vertex + place.viewpoint], atol=1e-13)
    assert found.worst < 1e-13


def test_lens_positions_of_all_conics():
    assert {name for name, _ in USEFUL} == set(CONICS)
    assert sum(name == "bowl, ellipse" for name, _ in USEFUL) == 2  # either focus


@pytest.mark.parametrize("name", ["hyperbola", "flat hyperbola"])
def test_hyperboloids_satisfy_the_equation_of_baker_and_nayar(name):
    """(z - c/2)^2 - r^2 (k/2 - 1) = c^2/4 (k - 2)/k, viewpoint in 0, pinhole at z = c: their eq. (16)."""
    mirror = CONICS[name]
    (place,) = lens_positions(mirror)
    c, e = place.viewpoint - place.lens, mirror.eccentricity
    k = 2 * e**2 / (e**2 - 1)
    r = np.linspace(0, mirror.rim, 20)
    z = place.viewpoint - mirror.sag(r)
    np.testing.assert_allclose((z - c / 2) ** 2 - r**2 * (k / 2 - 1), c**2 / 4 * (k - 2) / k, rtol=1e-12)


def test_ellipsoids_satisfy_the_equation_of_baker_and_nayar():
    """(z - c/2)^2 + r^2 (1 + c^2/(2 k)) = (2 k + c^2)/4: their eq. (17)."""
    a, focus, rim = 0.12, 0.05, 0.04
    mirror = Conic.ellipse(a, focus, rim)
    for place in lens_positions(mirror):
        c, k = place.viewpoint - place.lens, 2 * (a**2 - focus**2)
        r = np.linspace(0, rim, 20)
        z = place.viewpoint - mirror.sag(r)
        np.testing.assert_allclose((z - c / 2) ** 2 + r**2 * (1 + c**2 / (2 * k)), (2 * k + c**2) / 4, rtol=1e-12)


def test_plane_has_its_viewpoint_behind_it_for_any_lens_position():
    (place,) = lens_positions(Plane())
    assert (place.lens, place.viewpoint, place.unusable_because) == (None, None, "")
    for lens in (-0.05, -0.3):
        found = best_viewpoint(camera(Plane(), lens), PIXELS)
        np.testing.assert_allclose(found.point, [0, 0, -2 * lens], atol=1e-12)
        assert found.worst < 1e-13


@pytest.mark.parametrize(
    ("mirror", "count"),
    [
        (Conic.sphere(0.03, 0.02), 1),
        (Conic.sphere(-0.3, 0.02), 1),
        (Conic(0.03, 0.5, 0.02), 2),
        (Cone(np.radians(50), 0.03), 1),
        (Asphere.example(), 0),
    ],
)
def test_other_mirrors_have_no_usable_lens_position(mirror, count):
    places = lens_positions(mirror)
    assert len(places) == count
    assert all(place.unusable_because for place in places)


def test_viewpoint_of_a_central_camera_is_its_centre():
    found = best_viewpoint(Camera(Unified(300.0, 300.0, 0.0, 0.0, 0.9), (640, 480)), PIXELS)
    assert np.abs(found.point).max() < 1e-15
    assert found.worst < 1e-15
    assert found.parallax(0.1).max() < 1e-12


def test_parallax_of_rays_at_constant_distance_from_a_point():
    level = np.stack([500 * np.arange(24) * 2 * np.pi / 24, np.zeros(24)], -1)
    found = best_viewpoint(Twisted(0.02), level)
    np.testing.assert_allclose(found.point, 0, atol=1e-15)
    assert (found.rms, found.worst) == pytest.approx((0.02, 0.02), rel=1e-12)
    for distance in (0.1, 1.0, 5.0):
        np.testing.assert_allclose(found.parallax(distance), 500 * np.arcsin(0.02 / distance), rtol=1e-9)


@pytest.mark.parametrize("distance", [0.3, 1.0, 5.0])
def test_parallax_is_the_error_of_a_central_camera(distance):
    system = off_focus()
    found = best_viewpoint(system, PIXELS)
    some = np.arange(3, len(found.pixels), 17)
    origins, bearings, _ = system.rays(found.pixels[some])
    # The point of each ray that lies so far from the viewpoint, and the pixel whose ray is parallel to its direction.
    to_foot = np.einsum("ni,ni->n", found.point - origins, bearings)
    along = to_foot + np.sqrt(distance**2 - found.distances[some] ** 2)
    ideal = (origins + along[:, None] * bearings - found.point) / distance

    def central(pixel, direction):
        return least_squares(lambda p: 1e3 * (system.rays(p).bearings - direction), pixel, xtol=1e-14, ftol=1e-14).x

    seen = [central(pixel, direction) for pixel, direction in zip(found.pixels[some], ideal, strict=True)]
    missed = np.linalg.norm(seen - found.pixels[some], axis=1)
    np.testing.assert_allclose(found.parallax(distance)[some], missed, rtol=0.01, atol=1e-4)
    assert missed.max() > 0.02


def test_parallax_decreases_with_distance_and_rejects_distances_between_the_rays():
    found = best_viewpoint(off_focus(), PIXELS)
    far, near = found.parallax(5.0), found.parallax(1.0)
    np.testing.assert_allclose(near, 5 * far, rtol=1e-3)
    with pytest.raises(ValueError, match="use a larger distance"):
        found.parallax(found.worst / 2)


@pytest.mark.parametrize(
    ("mirror", "lens", "rms", "worst", "px"),
    [
        (Conic.hyperbola(0.028, 0.0385, 0.034), 0.0615, 0.17e-3, 0.30e-3, (0.63, 0.13, 0.025)),
        (Conic.hyperbola(0.028, 0.0385, 0.034), 0.0315, 1.8e-3, 3.4e-3, (5.0, 1.0, 0.20)),
        (Conic.sphere(0.04, 0.034), 0.0665, 6.8e-3, 16.9e-3, (5.6, 1.12, 0.22)),
    ],
)
def test_viewpoint_figures_in_the_guide(mirror, lens, rms, worst, px):
    focal = 400 * (lens + float(mirror.sag(mirror.rim))) / mirror.rim
    system = Catadioptric(Pinhole(focal, focal, 0.0, 0.0), (PlacedMirror(mirror, tz=lens),))
    phi = np.arange(24) * np.pi / 12
    rings = 400 * (1 - 1e-9) * np.sqrt(np.arange(1, 13) / 12)[:, None, None]
    found = best_viewpoint(system, rings * np.stack([np.cos(phi), np.sin(phi)], -1))
    assert (found.rms, found.worst) == pytest.approx((rms, worst), rel=0.02)
    assert [found.parallax(d).max() for d in (0.2, 1.0, 5.0)] == pytest.approx(px, rel=0.04)


def test_best_viewpoint_minimizes_the_distances():
    found = best_viewpoint(off_focus(), PIXELS)
    origins, bearings, _ = off_focus().rays(found.pixels)

    def rms(point):
        return np.sqrt((np.cross(point - origins, bearings) ** 2).sum(1).mean())

    assert rms(found.point) == pytest.approx(found.rms, rel=1e-12)
    for step in 1e-5 * np.concatenate([np.eye(3), -np.eye(3)]):
        assert rms(found.point + step) > found.rms


def test_invalid_pixels_are_ignored():
    system = off_focus()
    some = np.concatenate([PIXELS.reshape(-1, 2), [[1e5, 0.0], [np.nan, 0.0]]])
    assert len(best_viewpoint(system, some).distances) <= len(some) - 2


def test_cameras_without_a_viewpoint_are_rejected():
    with pytest.raises(ValueError, match="at least two rays; 0 of 1"):
        best_viewpoint(off_focus(), [[1e5, 0.0]])
    flat = Catadioptric(Telecentric(1e4, 1e4, 0.0, 0.0), (PlacedMirror(Plane(), tz=0.1),))
    with pytest.raises(ValueError, match="parallel"):
        best_viewpoint(flat, PIXELS)
