"""Laws of all mirrors. New mirrors are discovered and tested automatically."""

import mpmath
import numpy as np
import pytest

from omnisight.optics.mirrors import mirror_class, mirror_names
from omnisight.optics.mirrors.asphere import Asphere
from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane
from omnisight.optics.reflection import reflect

SHAPES = {
    "sphere": Conic.sphere(0.04),
    "bowl": Conic.sphere(-0.3, 0.05),
    "parabola": Conic.parabola(0.06, 0.05),
    "concave-parabola": Conic.parabola(-0.12, 0.05),
    "hyperbola": Conic.hyperbola(0.028, 0.0385, 0.035),
    "ellipse": Conic.ellipse(0.1, 0.06, 0.05),
    "cone": Cone(np.radians(40.0), rim=0.04),
    "funnel": Cone(np.radians(120.0), rim=0.05),
    "plane": Plane(rim=0.06),
    "ring": Plane(rim=0.06, hole=0.02),
    "pierced": Asphere(18.0, -1.5, (900.0, -3e5), rim=0.03, hole=0.008),
    "wavy": Asphere(20.0, -1.5, (3000.0, -2e6), rim=0.035),
} | {name: mirror_class(name).example() for name in mirror_names()}
every_mirror = pytest.mark.parametrize("mirror", [pytest.param(m, id=name) for name, m in SHAPES.items()])
convex_mirror = pytest.mark.parametrize("mirror", [pytest.param(m, id=n) for n, m in SHAPES.items() if m.convex])
every_conic = pytest.mark.parametrize(
    "conic", [pytest.param(m, id=n) for n, m in SHAPES.items() if isinstance(m, Conic)]
)


def points_of(mirror, count=400, seed=3):
    """Return points (N, 3) of a mirror between its hole and its rim."""
    rng = np.random.default_rng(seed)
    rho = mirror.hole + (mirror.rim - mirror.hole) * rng.uniform(0.01, 0.995, count)
    phi = rng.uniform(-np.pi, np.pi, count)
    return np.stack([rho * np.cos(phi), rho * np.sin(phi), mirror.sag(rho)], -1)


def rays_at(mirror, count=3000, seed=5):
    """Return rays (N, 3) that meet a mirror, miss it, or point away from it."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-0.1, 0.1, (count, 3)) - [0, 0, 0.15]
    target = np.concatenate([rng.uniform(-1.3, 1.3, (count, 2)) * mirror.rim, rng.uniform(-0.02, 0.02, (count, 1))], -1)
    bearings = target - origins
    return origins, bearings / np.linalg.norm(bearings, axis=-1, keepdims=True)


# -- the surface ------------------------------------------------------------------------------------------------


def exact_sag(mirror, rho):
    """Return the sag by an independent mpmath implementation."""
    if isinstance(mirror, Plane):
        return mpmath.mpf(0)
    if isinstance(mirror, Cone):
        return rho / mpmath.tan(mpmath.mpf(mirror.half_angle))
    if isinstance(mirror, Conic):
        c, k, b = 1 / mpmath.mpf(mirror.radius), -(mpmath.mpf(mirror.eccentricity) ** 2), ()
    else:
        c, k, b = mpmath.mpf(mirror.curvature), mpmath.mpf(mirror.conic), mirror.b
    sag = c * rho**2 / (1 + mpmath.sqrt(1 - (1 + k) * c**2 * rho**2))
    return sag + sum(mpmath.mpf(v) * rho ** (2 * i) for i, v in enumerate(b, start=2))


@every_mirror
def test_sag_and_normal_satisfy_the_equation(mirror):
    with mpmath.workdps(40):
        for p in points_of(mirror, 12):
            rho = mpmath.sqrt(mpmath.mpf(p[0]) ** 2 + mpmath.mpf(p[1]) ** 2)
            sag, slope = exact_sag(mirror, rho), mpmath.diff(lambda r: exact_sag(mirror, r), rho)
            assert p[2] == pytest.approx(float(sag), rel=1e-12, abs=1e-17)
            n = np.array([*(float(slope * mpmath.mpf(v) / rho) for v in p[:2]), -1.0])
            np.testing.assert_allclose(mirror.normal(p), n / np.linalg.norm(n), atol=1e-12)


@every_mirror
def test_chart_covers_the_surface_with_correct_derivatives(mirror):
    p = points_of(mirror, 50)
    a, b = mirror.chart_coordinates(p[:, 0], p[:, 1])
    at, slope, bend = mirror.surface(a, b)
    np.testing.assert_allclose(at.T, p, atol=1e-13)
    assert mirror.on_sheet(a, b).all()
    h = 1e-5 * np.abs(a).max()
    east, west = mirror.surface(a + h, b), mirror.surface(a - h, b)
    south, north = mirror.surface(a, b + h), mirror.surface(a, b - h)
    clear = np.hypot(p[:, 0], p[:, 1]) > 0.1 * mirror.rim  # of the tip of a cone
    for found, (plus, minus), k in ((slope[0], (east, west), 0), (slope[1], (south, north), 0)):
        np.testing.assert_allclose(found[:, clear], ((plus[k] - minus[k]) / (2 * h))[:, clear], atol=2e-6)
    for found, (plus, minus), i in (
        (bend[0], (east, west), 0),
        (bend[1], (east, west), 1),
        (bend[2], (south, north), 1),
    ):
        difference = (plus[1][i] - minus[1][i]) / (2 * h)
        np.testing.assert_allclose(found[:, clear], difference[:, clear], atol=1e-4 * np.abs(bend).max())


@every_mirror
def test_numbers_of_a_mirror_are_its_parameters(mirror):
    assert mirror.with_params(mirror.params) == mirror
    assert type(mirror).from_dict(mirror.to_dict()) == mirror
    assert {"rim", "hole"} <= set(mirror.param_names)


# -- rays -------------------------------------------------------------------------------------------------------


@every_mirror
def test_intersections_are_on_the_reflecting_side_of_the_surface(mirror):
    origins, bearings = rays_at(mirror)
    distance, valid = mirror.intersect(origins, bearings)
    assert 0.1 < valid.mean() < 0.95
    assert np.isnan(distance[~valid]).all()
    p = (origins + distance[:, None] * bearings)[valid]
    rho = np.hypot(p[:, 0], p[:, 1])
    np.testing.assert_allclose(p[:, 2], mirror.sag(np.minimum(rho, mirror.rim)), atol=1e-12 * 0.3)
    assert rho.min() >= mirror.hole * (1 - 1e-12)
    assert rho.max() <= mirror.rim * (1 + 1e-12)
    assert ((bearings[valid] * mirror.normal(p)).sum(-1) < 0).all()


@every_mirror
def test_intersection_is_the_first_one_along_the_ray(mirror):
    # March along each ray in steps far finer than the mirror and watch for the first crossing of its surface.
    origins, bearings = rays_at(mirror, 150)
    distance, valid = mirror.intersect(origins, bearings)
    t = np.linspace(0.02, 0.5, 10001)
    assert valid.sum() > 10
    for o, d, found, shown in zip(origins, bearings, distance, valid, strict=True):
        p = o + t[:, None] * d
        rho = np.hypot(p[:, 0], p[:, 1])
        with np.errstate(invalid="ignore"):
            height = p[:, 2] - mirror.sag(np.minimum(rho, mirror.rim))
        there = (rho <= mirror.rim) & (rho >= mirror.hole)
        crossed = np.flatnonzero((height[:-1] * height[1:] < 0) & there[:-1] & there[1:])
        if len(crossed) and height[crossed[0]] < 0:
            assert shown
            assert t[crossed[0]] - 1e-9 <= found <= t[crossed[0] + 1] + 1e-9
        elif len(crossed):
            assert not shown  # from behind


@convex_mirror
def test_ray_towards_a_point_of_a_convex_mirror_meets_that_point(mirror):
    p = points_of(mirror)
    origins = np.random.default_rng(0).uniform(-1, 1, p.shape) * 0.2 - [0, 0, 0.3]
    away = p - origins
    length = np.linalg.norm(away, axis=-1)
    facing = (away * mirror.normal(p)).sum(-1) / length < -1e-3
    assert facing.mean() > 0.3
    distance, valid = mirror.intersect(origins[facing], (away / length[:, None])[facing])
    assert valid.all()
    np.testing.assert_allclose(distance, length[facing], rtol=1e-12)


@pytest.mark.parametrize("mirror", [Asphere.example(), SHAPES["wavy"], SHAPES["pierced"]])
def test_asphere_intersection_matches_forty_digit_arithmetic(mirror):
    origins, bearings = rays_at(mirror, 60)
    distance, valid = mirror.intersect(origins, bearings)
    assert valid.sum() > 10
    with mpmath.workdps(40):
        for o, d, t in zip(origins[valid], bearings[valid], distance[valid], strict=True):
            o, d = [mpmath.mpf(v) for v in o], [mpmath.mpf(v) for v in d]
            x, y, z = (lambda s, o=a, d=b: o + s * d for a, b in zip(o, d, strict=True))

            def height(s, x=x, y=y, z=z):
                return z(s) - exact_sag(mirror, mpmath.sqrt(x(s) ** 2 + y(s) ** 2))

            assert t == pytest.approx(float(mpmath.findroot(height, mpmath.mpf(float(t)))), rel=1e-13)


def test_asphere_without_coefficients_is_a_conic_section():
    conic = Conic(0.05, 1.3, 0.03)
    asphere = Asphere(1 / conic.radius, -(conic.eccentricity**2), rim=0.03)
    rays = rays_at(conic)
    for actual, expected in zip(asphere.intersect(*rays), conic.intersect(*rays), strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-13)


def test_rays_pass_through_a_hole():
    ring = SHAPES["ring"]
    distance, valid = ring.intersect([[0.01, 0, -1], [0.03, 0, -1], [0.07, 0, -1]], [[0, 0, 1.0]] * 3)
    assert valid.tolist() == [False, True, False]
    assert distance[1] == 1


def test_back_of_a_mirror_blocks_rays():
    # From behind a ball's facing half, along its axis: the half is met from within.
    distance, valid = Conic.sphere(1.0).intersect([[0.0, 0, 3], [0, 0, 0.5]], [[0.0, 0, -1]] * 2)
    assert not valid.any()
    assert np.isnan(distance).all()


@pytest.mark.parametrize("radius", [0.04, -0.04])
def test_hemisphere_has_a_normal_at_its_equator(radius):
    half = Conic.sphere(radius)
    phi = np.linspace(0, 2 * np.pi, 60)
    side = np.stack([np.cos(phi), np.sin(phi), 0 * phi], -1)
    edge = 0.04 * side + [0, 0, radius]
    np.testing.assert_allclose(half.normal(edge), np.sign(radius) * side, atol=3e-7)  # a root of rounding
    towards = side * -np.sign(radius) + [0, 0, 1e-3]
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    distance, valid = half.intersect(edge - 0.01 * towards, towards)
    np.testing.assert_array_equal(valid, np.isfinite(distance))
    assert np.isfinite(half.normal(edge - 0.01 * towards + distance[:, None] * towards))[valid].all()


@pytest.mark.parametrize("shape", [(3,), (5, 3), (2, 4, 3), (0, 3)])
def test_intersect_keeps_any_leading_shape(shape):
    mirror = Conic.example()
    origins, bearings = np.zeros(shape) - [0, 0, 0.1], np.broadcast_to([0.0, 0.0, 1.0], shape)
    distance, valid = mirror.intersect(origins, bearings)
    assert distance.shape == valid.shape == shape[:-1]
    assert valid.all()


# -- reflection and foci ----------------------------------------------------------------------------------------


@every_mirror
def test_reflection_obeys_the_law_of_reflection(mirror):
    origins, bearings = rays_at(mirror)
    distance, valid = mirror.intersect(origins, bearings)
    d = bearings[valid]
    n = mirror.normal((origins + distance[:, None] * bearings)[valid])
    r = reflect(d, n)
    np.testing.assert_allclose(np.linalg.norm(r, axis=-1), 1, atol=1e-14)
    np.testing.assert_allclose((r * n).sum(-1), -(d * n).sum(-1), atol=1e-14)
    np.testing.assert_allclose((np.cross(d, n) * r).sum(-1), 0, atol=1e-14)
    np.testing.assert_allclose(np.cross(r, n), np.cross(d, n), atol=1e-14)


@every_conic
def test_rays_through_one_focus_are_reflected_through_the_other(conic):
    inner, outer = conic.foci
    p = points_of(conic)
    d = np.broadcast_to([0, 0, 1.0], p.shape) if np.isinf(outer) else p - [0, 0, outer]
    # Seen from the lens's side: along the axis, or from the focus there (an ellipse's lies before it).
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    d = d * -np.sign((d * conic.normal(p)).sum(-1, keepdims=True))
    r = reflect(d, conic.normal(p))
    off = np.cross(np.array([0, 0, inner]) - p, r)
    np.testing.assert_allclose(off, 0, atol=1e-15 + 1e-13 * abs(conic.radius))


def test_foci_of_conics():
    hyperbola = Conic.hyperbola(a=28.0, c=38.5, rim=40.0)
    assert hyperbola.foci == pytest.approx((10.5, -66.5))  # c - a before the vertex, c + a behind it
    assert hyperbola.focal_distance == pytest.approx(77)
    assert hyperbola.latus_rectum == pytest.approx(2 * (38.5**2 - 28**2) / 28)
    d, latus = hyperbola.focal_distance, hyperbola.latus_rectum
    assert hyperbola.epsilon == pytest.approx(d / np.hypot(d, latus / 2))
    assert hyperbola.epsilon == pytest.approx(0.95135, abs=5e-6)
    ellipse = Conic.ellipse(a=5.0, c=3.0, rim=3.0)
    assert ellipse.foci == pytest.approx((-2.0, -8.0))
    assert ellipse.epsilon == pytest.approx(6 / np.hypot(6, ellipse.latus_rectum / 2))
    assert Conic.parabola(4.0, 1.0).foci == (1.0, -np.inf)
    assert Conic.sphere(2.0).foci == (2.0, 2.0)
    assert Conic.parabola(4.0, 1.0).epsilon == 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Conic.hyperbola(2.0, 1.0, 1.0), "c > a > 0, got a = 2.0, c = 1.0"),
        (lambda: Conic.ellipse(1.0, 2.0, 1.0), "a > c >= 0, got a = 1.0, c = 2.0"),
        (lambda: Asphere(20.0, 0.0, (), rim=0.06), "the profile of an asphere"),
        (lambda: Conic(0.0, 1.0, 0.1), "must not be 0: positive is convex, negative is concave"),
        (lambda: Conic(0.1, 1.0, 0.1, hole=0.1), "0 <= hole < rim, got hole 0.1 and rim 0.1"),
        (lambda: Conic.parabola(0.1, -0.1), "0 <= hole < rim, got hole 0.0 and rim -0.1"),
        (lambda: Plane(np.nan), "0 <= hole < rim"),
        (lambda: Cone(np.pi, 0.1), "the half angle of a cone must be between 0 and pi"),
        (lambda: mirror_class("torus"), "unknown mirror 'torus'; there are: asphere, cone, conic, plane"),
    ],
)
def test_invalid_mirrors_are_rejected(make, message):
    with pytest.raises(ValueError, match=message):
        make()
