"""Geyer and Daniilidis: a lens in the focus of a conic is the unified model, with the corrected Table 1."""

import mpmath
import numpy as np
import pytest

from omnisight.models.pinhole import Pinhole
from omnisight.models.unified import Unified
from omnisight.optics import Catadioptric, PlacedMirror, Telecentric
from omnisight.optics.mirrors.conic import Conic

# The chapter's example, a = 28, c = 38.5, among others from nearly flat to nearly a parabola.
HYPERBOLAS = [(28.0, 38.5), (1.0, 1.001), (1.0, 1.05), (1.0, 1.2), (1.0, 2.0), (1.0, 5.0), (1.0, 50.0), (0.3, 0.41)]
ELLIPSES = [(1.0, 0.02), (1.0, 0.2), (1.0, 0.5), (1.0, 0.8), (1.0, 0.95), (120.0, 50.0)]
CENTRE = (641.3, 478.9)
# Bearings of the lens' frame in the frame of the model, whose z looks back from the viewpoint to the lens. Either is a
# reflection: the model's frame, fx and fy positive, is left-handed.
CONVEX = np.array([1.0, 1.0, -1.0])
CONCAVE = np.array([-1.0, -1.0, -1.0])


def whole_mirror(rim_radius):
    """Return pixels of the whole image of a mirror, including its rim."""
    phi = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    radii = rim_radius * np.linspace(1e-4, 1 - 1e-12, 40)
    return np.array(CENTRE) + radii[:, None, None] * np.stack([np.cos(phi), np.sin(phi)], -1)


def angles(one, other):
    """Return angles between bearings, radians."""
    return 2 * np.arcsin(np.linalg.norm(one - other, axis=-1) / 2)


def traced(lens, mirror, distance, rim_radius):
    system = Catadioptric(lens, (PlacedMirror(mirror, tz=distance),))
    pixels = whole_mirror(rim_radius)
    origins, bearings, valid = system.rays(pixels)
    assert valid.all()
    return pixels, origins, bearings


@pytest.mark.parametrize("focal", [200.0, 1000.0])
@pytest.mark.parametrize("reach", [0.3, 3.0])
@pytest.mark.parametrize(("a", "c"), HYPERBOLAS)
def test_unified_model_of_hyperbolas(a, c, reach, focal):
    rim = reach * c
    mirror = Conic.hyperbola(a, c, rim)
    lens = Pinhole(focal, focal, *CENTRE)
    pixels, origins, bearings = traced(lens, mirror, a + c, focal * rim / (a + c + float(mirror.sag(rim))))
    model = Unified.from_hyperbola(a, c, focal, CENTRE)
    assert angles(model.unproject(pixels)[0], bearings * CONVEX).max() < 1e-9
    # and all from the near focus, seen from behind the mirror
    off = np.linalg.norm(np.cross(np.array([0, 0, 2 * c]) - origins, bearings), axis=-1)
    assert off.max() < 1e-9 * c


@pytest.mark.parametrize(("a", "c"), ELLIPSES)
@pytest.mark.parametrize("reach", [0.4, 0.999])
def test_unified_model_of_ellipses(a, c, reach):
    """The rim is at the near focus; a deeper mirror would reflect itself."""
    rim = reach * (a * a - c * c) / a
    mirror = Conic.ellipse(a, c, rim)
    lens = Pinhole(300.0, 300.0, *CENTRE)
    pixels, _, bearings = traced(lens, mirror, a + c, 300 * rim / (a + c + float(mirror.sag(rim))))
    model = Unified.from_ellipse(a, c, 300.0, CENTRE)
    assert angles(model.unproject(pixels)[0], bearings * CONCAVE).max() < 1e-9


@pytest.mark.parametrize(("a", "c"), [*ELLIPSES, (1.0, 1 / 3)])
@pytest.mark.parametrize("reach", [0.3, 0.999])
def test_unified_model_of_ellipses_with_the_lens_in_the_near_focus(a, c, reach):
    """The rays leave through the far focus. The rim is at most at the near focus, 90 degrees from the axis."""
    rim = reach * (a * a - c * c) / a
    mirror = Conic.ellipse(a, c, rim)
    lens = Pinhole(300.0, 300.0, *CENTRE)
    pixels, origins, bearings = traced(lens, mirror, a - c, 300 * rim / (a - c + float(mirror.sag(rim))))
    model = Unified.from_ellipse(a, c, 300.0, CENTRE, lens_focus="near")
    assert model.xi < 0
    assert angles(model.unproject(pixels)[0], bearings * CONCAVE).max() < 1e-9
    off = np.linalg.norm(np.cross(np.array([0, 0, -2 * c]) - origins, bearings), axis=-1)
    assert off.max() < 1e-9 * a


@pytest.mark.parametrize(("a", "c"), HYPERBOLAS)
def test_unified_model_of_concave_hyperbolas(a, c):
    """The lens is in the near focus, the viewpoint behind the mirror, and the image is not turned."""
    rim = 0.9 * (c * c - a * a) / a
    mirror = Conic(-(c * c - a * a) / a, c / a, rim)
    lens = Pinhole(300.0, 300.0, *CENTRE)
    pixels, _, bearings = traced(lens, mirror, c - a, 300 * rim / (c - a + float(mirror.sag(rim))))
    model = Unified.from_hyperbola(a, c, 300.0, CENTRE, lens_focus="near")
    assert angles(model.unproject(pixels)[0], bearings * CONVEX).max() < 1e-9


def test_ellipse_of_eccentricity_a_third_has_xi_of_minus_or_plus_three_fifths():
    near, far = (Unified.from_ellipse(3.0, 1.0, 300.0, CENTRE, focus) for focus in ("near", "far"))
    assert (near.xi, far.xi) == pytest.approx((-0.6, 0.6), rel=1e-15)
    with pytest.raises(ValueError, match="lens_focus must be 'far' or 'near', got 'middle'"):
        Unified.from_ellipse(3.0, 1.0, 300.0, CENTRE, lens_focus="middle")


@pytest.mark.parametrize("latus_rectum", [0.01, 0.05, 1.0, 42.0])
@pytest.mark.parametrize("reach", [0.4, 4.0])
def test_unified_model_of_parabolas(latus_rectum, reach):
    scale = 400 / latus_rectum
    rim = reach * latus_rectum
    lens = Telecentric(scale, scale, *CENTRE)
    pixels, _, bearings = traced(lens, Conic.parabola(latus_rectum, rim), 20 * rim, scale * rim)
    model = Unified.from_parabola(latus_rectum, scale, CENTRE)
    assert angles(model.unproject(pixels)[0], bearings * CONVEX).max() < 1e-9


def test_unmirrored_frame_has_fx_and_fy_of_opposite_sign():
    """The lens frame rotated by 180 degrees about y has a negative fx."""
    mirror = Conic.hyperbola(28.0, 38.5, 30.0)
    pixels, _, bearings = traced(Pinhole(900.0, 900.0, *CENTRE), mirror, 66.5, 300.0)
    model = Unified.from_hyperbola(28.0, 38.5, 900.0, CENTRE)
    turned = Unified(-model.fx, model.fy, *CENTRE, model.xi)
    turn = np.diag([-1.0, 1.0, -1.0])
    assert np.linalg.det(turn) == 1
    assert np.linalg.det(np.diag(CONVEX)) == np.linalg.det(np.diag(CONCAVE)) == -1
    assert angles(turned.unproject(pixels)[0], bearings @ turn).max() < 1e-9


@pytest.mark.parametrize(("a", "c"), [*HYPERBOLAS, *ELLIPSES])
def test_corrected_table_has_two_equivalent_forms(a, c):
    """d/sqrt(d^2 + L^2/4) = 2 e/(1 + e^2), in 40 digits; models and mirrors agree."""
    mpmath.mp.dps = 40
    x, y = mpmath.mpf(a), mpmath.mpf(c)
    d, latus_rectum, e = 2 * y, 2 * abs(x * x - y * y) / x, y / x
    epsilon = d / mpmath.sqrt(d * d + latus_rectum**2 / 4)
    assert mpmath.almosteq(epsilon, 2 * e / (1 + e * e), rel_eps=mpmath.mpf("1e-35"))
    mirror = Conic.hyperbola(a, c, 1.0) if c > a else Conic.ellipse(a, c, 0.1)
    model = (Unified.from_hyperbola if c > a else Unified.from_ellipse)(a, c, 100.0, CENTRE)
    assert mirror.epsilon == pytest.approx(float(epsilon), rel=1e-14)
    assert model.xi == pytest.approx(float(epsilon), rel=1e-14)
    assert mirror.focal_distance == pytest.approx(float(d), rel=1e-10)
    assert mirror.latus_rectum == pytest.approx(float(latus_rectum), rel=1e-12)


def test_printed_table_is_wrong_for_the_example():
    """a = 28, c = 38.5: the rays are those of epsilon 0.95135; the printed d/sqrt(d^2 + 4 l^2) gives 0.61105."""
    a, c, focal, rim = 28.0, 38.5, 1000.0, 30.0
    mirror = Conic.hyperbola(a, c, rim)
    pixels, _, bearings = traced(
        Pinhole(focal, focal, *CENTRE), mirror, a + c, focal * rim / (a + c + float(mirror.sag(rim)))
    )
    flat, directions = pixels.reshape(-1, 2), (bearings * CONVEX).reshape(-1, 3)
    fitted = Unified.fit(directions, flat)
    assert fitted.xi == pytest.approx(0.95135, abs=5e-6)
    d, latus_rectum = 2 * c, 2 * (c * c - a * a) / a
    printed = d / np.sqrt(d**2 + 4 * latus_rectum**2)
    assert printed == pytest.approx(0.61105, abs=5e-6)
    # With epsilon as printed and all else fitted, the best is off by pixels; a quarter of the latus rectum is right.
    import dataclasses

    scale = Unified.from_hyperbola(a, c, focal, CENTRE)
    wrong = dataclasses.replace(scale, xi=printed)
    best = [_fitted_scale(wrong, directions, flat), _fitted_scale(scale, directions, flat)]
    off = [np.linalg.norm(model.project(directions)[0] - flat, axis=1).max() for model in best]
    assert off[0] == pytest.approx(50.0, abs=0.05)  # of 371 px
    assert off[1] < 1e-8
    quarter = latus_rectum / 4
    assert d / np.sqrt(d**2 + 4 * quarter**2) == pytest.approx(scale.xi, rel=1e-14)


def _fitted_scale(model, directions, pixels):
    """Return the errors with the best fitting focal length."""
    import dataclasses

    plane = (model.project(directions)[0] - CENTRE) / model.fx
    away = pixels - CENTRE
    f = float((plane * away).sum() / (plane**2).sum())
    return dataclasses.replace(model, fx=f, fy=f)
