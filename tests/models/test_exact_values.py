"""The papers' equations at 50 digits, written here once more, against the models; and rays traced off real mirrors."""

import math

import mpmath as mp
import numpy as np
import pytest

from every_model import AZIMUTHS, CAMERAS, direction, rim
from omnisight.models import model_names
from omnisight.models.unified import Unified

mp.mp.dps = 50


# -- the papers' equations: a point (x, y, z) to the plane, then to the pixel ---------------------------------------


def norm(*values):
    return mp.sqrt(sum(v * v for v in values))


def affine(p, x, y):
    return p["fx"] * x + p.get("skew", 0) * y + p["cx"], p["fy"] * y + p["cy"]


def fisheye(r_of_theta):
    """Return the plane point of a lens described by its radius as a function of theta."""

    def plane(p, x, y, z):
        rho = norm(x, y)
        r = r_of_theta(p, mp.atan2(rho, z))
        return (r * x / rho, r * y / rho) if rho else (mp.mpf(0), mp.mpf(0))

    return plane


def brown(p, x, y):
    r2 = x * x + y * y
    k = [p.get(f"k{i}", 0) for i in range(7)]
    radial = (1 + k[1] * r2 + k[2] * r2**2 + k[3] * r2**3) / (1 + k[4] * r2 + k[5] * r2**2 + k[6] * r2**3)
    return (
        x * radial + 2 * p["p1"] * x * y + p["p2"] * (r2 + 2 * x * x),
        y * radial + p["p1"] * (r2 + 2 * y * y) + 2 * p["p2"] * x * y,
    )


def pinhole(p, x, y, z):
    return x / z, y / z


def unified(p, x, y, z):
    depth = z + p["xi"] * norm(x, y, z)
    return x / depth, y / depth


def double_sphere(p, x, y, z):
    d1 = norm(x, y, z)
    d2 = norm(x, y, p["xi"] * d1 + z)
    depth = p["alpha"] * d2 + (1 - p["alpha"]) * (p["xi"] * d1 + z)
    return x / depth, y / depth


def eucm(p, x, y, z):
    depth = p["alpha"] * mp.sqrt(p["beta"] * (x * x + y * y) + z * z) + (1 - p["alpha"]) * z
    return x / depth, y / depth


def fov(p, theta):
    return mp.atan2(2 * mp.sin(theta) * mp.tan(p["omega"] / 2), mp.cos(theta)) / p["omega"]


def kannala_brandt(p, theta):
    return theta + sum(p[f"k{i}"] * theta ** (2 * i + 1) for i in range(1, 7) if f"k{i}" in p)


def division(p, x, y, z):
    # The bearing is (u, v, 1 + k (u^2 + v^2)) up to scale: with (u, v) = t (x, y), k rho^2 t^2 - z t + 1 = 0.
    k, rho2 = p["k"], x * x + y * y
    t = 2 / (z + mp.sqrt(z * z - 4 * k * rho2)) if rho2 else 1 / z
    return t * x, t * y


def thin_prism(p, x, y, z):
    x, y = fisheye(lambda _, theta: theta)(p, x, y, z)
    r2 = x * x + y * y
    radial = 1 + sum(p[f"k{i}"] * r2**i for i in range(1, 5))
    return (
        x * radial + 2 * p["p1"] * x * y + p["p2"] * (r2 + 2 * x * x) + p["s1"] * r2,
        y * radial + 2 * p["p2"] * x * y + p["p1"] * (r2 + 2 * y * y) + p["s2"] * r2,
    )


def fisheye624(p, x, y, z):
    x, y = fisheye(kannala_brandt)(p, x, y, z)
    r2 = x * x + y * y
    return (
        x + p["p1"] * (2 * x * x + r2) + 2 * p["p2"] * x * y + p["s1"] * r2 + p["s2"] * r2**2,
        y + p["p2"] * (2 * y * y + r2) + 2 * p["p1"] * x * y + p["s3"] * r2 + p["s4"] * r2**2,
    )


def ocam(p, x, y, z):
    # The first root of rho f(r) = z r: found in double precision, polished at 50 digits.
    rho = norm(x, y)
    f = [p.get(f"a{i}", mp.mpf(0)) * rho for i in range(10)]
    f[1] -= z
    roots = np.roots(np.array(f[::-1], float))
    start = roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].min()
    r = mp.findroot(lambda r: mp.fsum(value * r**i for i, value in enumerate(f)), mp.mpf(float(start)))
    return r * x / rho, r * y / rho


def cardinal(controls, place):
    """Return the cubic spline of unit knots: control value i has weight M(place - i + 3), M in truncated powers."""

    def m(t):
        return mp.fsum((-1) ** k * mp.binomial(4, k) * max(t - k, mp.mpf(0)) ** 3 for k in range(5)) / 6

    return mp.fsum(value * m(place - i + 3) for i, value in enumerate(controls) if abs(place - i + 1) < 2)


def numbered(p, field):
    return [p[f"{field}{i}"] for i in range(sum(name.strip("0123456789") == field for name in p))]


def spline(p, x, y, z):
    r = numbered(p, "r")
    x, y = fisheye(lambda p, theta: theta * cardinal([r[1], *r], theta * (len(r) - 2) / p["reach"]))(p, x, y, z)
    side = math.isqrt(len(numbered(p, "du")))
    across, down = ((side - 3) * (q / p["extent"] + 1) / 2 for q in (x, y))

    def surface(values):
        rows = (cardinal(values[i : i + side], across) for i in range(0, side * side, side))
        return cardinal(list(rows), down)

    return x + surface(numbered(p, "du")), y + surface(numbered(p, "dv"))


def panini(p, x, y, z):
    longitude = mp.atan2(x, z)
    stretch = (p["d"] + 1) / (p["d"] + mp.cos(longitude))
    return stretch * mp.sin(longitude), stretch * y / norm(x, z)


def then(first, second):
    return lambda p, *point: second(p, *first(p, *point))


def unrolled(height):
    return lambda p, x, y, z: (mp.atan2(x, z), height(y, norm(x, z)))


PLANE = {
    "cassini": lambda p, x, y, z: (mp.atan2(x, norm(y, z)), mp.atan2(y, z)),
    "cylindrical": unrolled(lambda y, q: y / q),
    "division": division,
    "double_sphere": double_sphere,
    "equidistant": fisheye(lambda p, theta: theta),
    "equirectangular": unrolled(mp.atan2),
    "equisolid": fisheye(lambda p, theta: 2 * mp.sin(theta / 2)),
    "radial_polynomial": fisheye(lambda p, t: t + p["k2"] * t**2 + p["k3"] * t**3 + p["k4"] * t**4),
    "eucm": eucm,
    "fisheye624": fisheye624,
    "fov": fisheye(fov),
    "kannala_brandt": fisheye(kannala_brandt),
    "mei": then(unified, brown),
    "mercator": unrolled(lambda y, q: mp.asinh(y / q)),
    "ocam": ocam,
    "orthographic": fisheye(lambda p, theta: mp.sin(theta)),
    "panini": panini,
    "pinhole": pinhole,
    "radial_tangential": then(pinhole, brown),
    "rational": then(pinhole, brown),
    "spline": spline,
    "stereographic": fisheye(lambda p, theta: 2 * mp.tan(theta / 2)),
    "thin_prism_fisheye": thin_prism,
    "unified": unified,
}


def exact(model, bearing):
    p = {name: mp.mpf(value) for name, value in model.to_dict().items()}
    x, y = PLANE[model.name](p, *map(mp.mpf, map(float, bearing)))
    if model.name == "ocam":
        return p["e"] * y + x + p["cx"], p["c"] * y + p["d"] * x + p["cy"]
    if model.name == "spline":
        return x + p["cx"], y + p["cy"]
    return affine(p, x, y)


def test_every_model_has_an_independent_equation():
    assert tuple(sorted(PLANE)) == model_names()


@pytest.mark.parametrize("model", CAMERAS)
def test_pixels_agree_with_the_equations(model):
    which = [1, 9, 17]
    limit, phi = rim(model)[which], AZIMUTHS[which]
    theta = np.array([1e-6, 1e-3, 0.3, 0.8, 1.2, 1.5, 1.65, 2.0, 2.4, 2.8, 3.1])[:, None]
    bearings = np.concatenate([direction(theta, phi)[theta < limit], direction(limit - 1e-6, phi)])
    aside = np.stack([np.cos(phi), np.sin(phi), 0 * phi], -1)[limit > np.pi / 2 + 1e-3]
    bearings = np.concatenate([bearings, aside])
    pixels, valid, d_point, _ = model.project_with_jacobians(bearings)
    assert valid.all()
    truth = np.array([exact(model, bearing) for bearing in bearings])
    # What the image makes of the last digit of the bearing is no one's fault; far behind, of that of its cosine.
    x, _, z = bearings.T
    sine = np.where(z < 0, np.abs(x) / np.hypot(x, z), 1)
    digits = 4e-16 * np.abs(d_point).max(axis=2) / sine[:, None]
    for found in (pixels, model.project(bearings)[0]):
        error = np.array(np.abs(found - truth), float)
        assert (error <= 1e-11 * np.abs(pixels) + digits).all()


# -- mirrors: rays traced with nothing but the surface and the law of reflection -------------------------------------


def intersect(bearing, quadric, centre, side):
    """Return the intersection of a mirror with the line of a bearing through the origin, and the normal there.

    The surface is q0 (x^2 + y^2) + q1 (z - centre)^2 + q2 (z - centre) = 1; `side` chooses the points that are mirror.
    """
    q0, q1, q2 = quadric
    s2, c = bearing[0] ** 2 + bearing[1] ** 2, bearing[2]
    a = q0 * s2 + q1 * c * c
    b = -2 * q1 * centre * c + q2 * c
    roots = np.roots(np.trim_zeros([a, b, q1 * centre**2 - q2 * centre - 1], "f"))
    points = [t.real * bearing for t in roots if abs(t.imag) < 1e-12]
    point = next(p for p in points if side(p, bearing))
    normal = np.array([2 * q0 * point[0], 2 * q0 * point[1], 2 * q1 * (point[2] - centre) + q2])
    normal /= np.linalg.norm(normal)
    return point, normal


def reflect(ray, normal):
    return ray - 2 * (ray @ normal) * normal


BEARINGS = direction(np.linspace(0.05, 1.9, 12)[:, None], np.array([0.3, 2.0, -1.1])).reshape(-1, 3)


def slopes_at(point, ray, eye):
    """Return the slopes (x, y) of a reflected ray as seen by a pinhole on the axis that faces the mirror."""
    # The ray goes through the eye: the mirror has a single viewpoint.
    miss = np.cross(point - eye, ray)
    assert np.linalg.norm(miss) < 1e-12 * np.linalg.norm(point - eye)
    return point[:2] / (eye[2] - point[2])


def assert_bearings(model, pixels, bearings):
    found, valid = model.unproject(pixels)
    assert valid.all()
    assert np.linalg.norm(found - bearings, axis=1).max() < 1e-9


@pytest.mark.parametrize(("a", "c"), [(28.0, 38.5), (1.0, 1.2), (0.5, 2.0)])
def test_hyperbolic_mirror_agrees_with_ray_tracing(a, c):
    # One focus is the origin, the pinhole is in the other, (0, 0, 2c); the mirror is the sheet around the origin.
    model, b2 = Unified.from_hyperbola(a, c, focal=700.0, centre=(511.5, 383.5)), c * c - a * a
    bearings = BEARINGS[BEARINGS[:, 2] > -0.9 * a / c]
    slopes = []
    for bearing in bearings:
        point, normal = intersect(
            bearing, (-1 / b2, 1 / a**2, 0.0), c, lambda p, d: p @ d > 0 and p[2] <= c - a + 1e-12
        )
        slopes.append(slopes_at(point, reflect(-bearing, normal), np.array([0, 0, 2 * c])))
    assert_bearings(model, 700.0 * np.array(slopes) + (511.5, 383.5), bearings)


@pytest.mark.parametrize(("a", "c"), [(30.0, 12.0), (1.0, 0.9)])
def test_elliptical_mirror_agrees_with_ray_tracing(a, c):
    # A concave mirror: light crosses the focus at the origin before it is reflected to the pinhole at (0, 0, 2c). The
    # image is upside down, u counts against x and v against y.
    model, b2 = Unified.from_ellipse(a, c, focal=700.0, centre=(511.5, 383.5)), a * a - c * c
    slopes = []
    bearings = BEARINGS[BEARINGS[:, 2] + model.xi > 0.05]
    for bearing in bearings:
        point, normal = intersect(bearing, (1 / b2, 1 / a**2, 0.0), c, lambda p, d: p @ d < 0)
        slopes.append(slopes_at(point, reflect(-bearing, normal), np.array([0, 0, 2 * c])))
    assert_bearings(model, -700.0 * np.array(slopes) + (511.5, 383.5), bearings)


@pytest.mark.parametrize("p", [1.0, 23.0])
def test_parabolic_mirror_agrees_with_ray_tracing(p):
    # z = p - (x^2 + y^2)/(4 p) with its focus in the origin, under an orthographic camera far up the axis.
    model = Unified.from_parabola(4 * p, scale=8.5, centre=(511.5, 383.5))
    spots = []
    for bearing in BEARINGS:
        point, normal = intersect(bearing, (1 / (4 * p * p), 0.0, 1 / p), 0.0, lambda q, d: q @ d > 0)
        np.testing.assert_allclose(reflect(-bearing, normal), [0, 0, 1], atol=1e-12)
        spots.append(point[:2])
    assert_bearings(model, 8.5 * np.array(spots) + (511.5, 383.5), BEARINGS)


def test_table_of_the_chapter_with_the_corrected_latus_rectum():
    a, c = 28.0, 38.5
    xi = Unified.from_hyperbola(a, c, focal=1.0, centre=(0, 0)).xi
    foci, latus_rectum = 2 * c, 2 * (c * c - a * a) / a
    assert xi == pytest.approx(0.95135, abs=5e-6)
    assert xi == pytest.approx(foci / np.hypot(foci, latus_rectum / 2), rel=1e-14)
    printed = foci / np.hypot(foci, 2 * latus_rectum)
    assert abs(printed - xi) > 0.3
    assert xi == pytest.approx(foci / np.hypot(foci, 2 * latus_rectum / 4), rel=1e-14)


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (Unified.from_hyperbola, (2.0, 1.0, 500.0), "c > a"),
        (Unified.from_ellipse, (1.0, 2.0, 500.0), "c < a"),
        (Unified.from_hyperbola, (-1.0, 2.0, 500.0), "a must be positive, got -1"),
        (Unified.from_parabola, (0.0, 1.0), "latus_rectum must be positive"),
    ],
)
def test_an_invalid_mirror_is_rejected(make, arguments, message):
    with pytest.raises(ValueError, match=message):
        make(*arguments, centre=(0.0, 0.0))
