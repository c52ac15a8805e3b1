"""Caustics, compared with closed forms and with neighbouring rays in high precision."""

import mpmath
import numpy as np
import pytest

from omnisight.geometry.rays import Rays
from omnisight.models.mei import Mei
from omnisight.models.pinhole import Pinhole
from omnisight.optics import Catadioptric, PlacedMirror, Telecentric
from omnisight.optics.caustic import caustic
from omnisight.optics.mirrors.asphere import Asphere
from omnisight.optics.mirrors.cone import Cone
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.ray_jacobians import ray_jacobians

TELECENTRIC = Telecentric(1e4, 1e4, 0.0, 0.0)
LENS = Pinhole(1000.0, 1000.0, 0.0, 0.0)
PHI = np.linspace(0.1, 6.2, 7)
PIXELS = np.linspace(15, 250, 9)[:, None, None] * np.stack([np.cos(PHI), np.sin(PHI)], -1)
TILTED = {"tilt_x": 0.03, "tilt_y": -0.02, "tx": 0.001, "ty": -0.002}


def outwards(camera, pixels):
    """Return the caustic of pixels in their meridional planes: signed distance from the axis, and z."""
    found = caustic(camera, pixels)
    side = pixels / np.linalg.norm(pixels, axis=-1, keepdims=True)
    return [np.stack([(part[..., :2] * side).sum(-1), part[..., 2]], -1) for part in (found.tangential, found.sagittal)]


@pytest.mark.parametrize(
    ("lens", "mirror", "z", "focus"),
    [
        (LENS, Conic.hyperbola(0.028, 0.0385, 0.03), 0.0665, 0.0105),
        (LENS, Conic.hyperbola(0.02, 0.1, 0.03), 0.12, 0.08),
        (LENS, Conic.ellipse(0.12, 0.05, 0.06), 0.17, -0.07),
        (LENS, Conic.ellipse(0.12, 0.05, 0.03), 0.07, -0.17),
        (TELECENTRIC, Conic.parabola(0.05, 0.03), 0.1, 0.0125),
        (TELECENTRIC, Conic.parabola(-0.1, 0.03), 0.1, -0.025),
    ],
)
def test_caustic_of_a_central_camera_is_its_viewpoint(lens, mirror, z, focus):
    found = caustic(Catadioptric(lens, (PlacedMirror(mirror, tz=z),)), PIXELS)
    seen = np.isfinite(found.along).all(-1)
    assert seen.mean() > 0.6
    for sheet in (found.tangential, found.sagittal):
        assert np.abs(sheet - [0, 0, z + focus])[seen].max() < 1e-13


def test_caustic_of_a_tilted_central_camera_is_its_viewpoint():
    """The lens in the focus may be tilted."""
    mirror = Conic.hyperbola(0.028, 0.0385, 0.06)
    askew = PlacedMirror(mirror, tilt_x=0.1)
    axis = askew.lens_from_mirror.rotation[:, 2]
    at = 0.0665 * axis  # the lens stays in the far focus
    found = caustic(Catadioptric(LENS, (PlacedMirror(mirror, 0.1, 0.0, *at),)), PIXELS)
    seen = np.isfinite(found.along).all(-1)
    assert seen.mean() > 0.6
    for sheet in (found.tangential, found.sagittal):
        assert np.abs(sheet - (0.0665 + 0.0105) * axis)[seen].max() < 1e-13


@pytest.mark.parametrize(("sign", "reach"), [(1, 0.035), (-1, 0.02)])
def test_parallel_rays_on_a_sphere_make_a_nephroid(sign, reach):
    """x = R (3 sin a - sin 3a)/4, z = R (3 cos a - cos 3a)/4 from the centre; on the axis at R/(2 cos a)."""
    radius, z = 0.04 * sign, 0.3
    system = Catadioptric(TELECENTRIC, (PlacedMirror(Conic.sphere(radius, reach), tz=z),))
    pixels = np.linspace(1, 0.99e4 * reach, 60)[:, None] * np.array([[0.6, 0.8]])
    tangential, sagittal = outwards(system, pixels)
    a = np.arcsin(np.linalg.norm(pixels, axis=1) / 1e4 / abs(radius))
    centre = z + radius
    nephroid = np.stack(
        [abs(radius) * (3 * np.sin(a) - np.sin(3 * a)) / 4, centre - radius * (3 * np.cos(a) - np.cos(3 * a)) / 4], -1
    )
    np.testing.assert_allclose(tangential, nephroid, atol=1e-15)
    np.testing.assert_allclose(sagittal, np.stack([0 * a, centre - radius / (2 * np.cos(a))], -1), atol=1e-15)


def test_cusp_is_half_a_radius_behind_the_vertex():
    system = Catadioptric(TELECENTRIC, (PlacedMirror(Conic.sphere(0.04, 0.03), tz=0.3),))
    for sheet in outwards(system, np.array([[1e-6, 0.0]])):
        np.testing.assert_allclose(sheet, [[0, 0.32]], atol=1e-13)


def test_caustic_of_a_circle_and_a_near_lens_matches_the_closed_form():
    """The envelope of rays from a point, reflected by a circle: in 40 digits, by its own derivative."""
    mpmath.mp.dps = 40
    radius, lens = mpmath.mpf("0.04"), mpmath.mpf("0.11")  # the lens, from the centre

    def ray(a):
        """Point and direction of the ray reflected at the angle a from the axis, the centre at 0, the lens at -z."""
        p = mpmath.matrix([radius * mpmath.sin(a), -radius * mpmath.cos(a)])
        d = p - mpmath.matrix([0, -lens])
        d /= mpmath.norm(d)
        n = p / radius
        r = d - 2 * (d[0] * n[0] + d[1] * n[1]) * n
        return p, r

    def envelope(a):
        p, r = ray(a)
        dp = [mpmath.diff(lambda t, k=k: ray(t)[0][k], a) for k in range(2)]
        dr = [mpmath.diff(lambda t, k=k: ray(t)[1][k], a) for k in range(2)]
        cross = [dp[0] * r[1] - dp[1] * r[0], dr[0] * r[1] - dr[1] * r[0]]
        return p - cross[0] / cross[1] * r

    system = Catadioptric(LENS, (PlacedMirror(Conic.sphere(0.04, 0.04), tz=0.07),))
    for angle in ("0.05", "0.3", "0.7", "1.1"):
        a = mpmath.mpf(angle)
        p, _ = ray(a)
        pixel = float(1000 * p[0] / (p[1] + lens))
        expected = envelope(a)
        tangential, sagittal = outwards(system, np.array([[0.6 * pixel, 0.8 * pixel]]))
        assert tangential[0] == pytest.approx([float(expected[0]), float(expected[1] + lens)], rel=1e-12)
        # The secondary caustic of Coddington: 1/s + 1/s' = 2 cos(i)/R, measured against the light.
        s = mpmath.norm(p - mpmath.matrix([0, -lens]))
        cosine = (lens * mpmath.cos(a) - radius) / s
        along = -1 / (2 * cosine / radius + 1 / s)
        p, r = ray(a)
        assert sagittal[0] == pytest.approx([float(p[0] + along * r[0]), float(p[1] + along * r[1] + lens)], abs=1e-15)


@pytest.mark.parametrize(
    "mirror",
    [
        Conic.hyperbola(0.028, 0.0385, 0.035),
        Conic.ellipse(0.12, 0.05, 0.06),
        Conic(0.03, 0.6, 0.025),
        Conic.parabola(0.05, 0.04),
        Asphere.example(),
        Cone(np.radians(55.0), 0.05),
    ],
)
def test_sheets_satisfy_the_coddington_equations(mirror):
    """1/s + 1/t = -2 k_t/cos(i) and -2 k_s cos(i), k the curvatures along and across (Coddington 1829)."""
    z = 0.09
    rho = np.linspace(0.1, 0.9, 9) * mirror.rim
    height = z + mirror.sag(rho)
    system = Catadioptric(LENS, (PlacedMirror(mirror, tz=z),))
    pixels = np.stack([1000 * rho / height, 0 * rho], -1)
    found = caustic(system, pixels)
    h = 1e-5 * mirror.rim
    slope = (mirror.sag(rho + h) - mirror.sag(rho - h)) / (2 * h)
    second = (mirror.sag(rho + h) - 2 * mirror.sag(rho) + mirror.sag(rho - h)) / h**2
    along = second / (1 + slope**2) ** 1.5
    across = slope / (rho * np.sqrt(1 + slope**2))
    s = np.hypot(rho, height)
    cosine = (height - slope * rho) / (s * np.sqrt(1 + slope**2))
    tangential, sagittal = -1 / (2 * along / cosine + 1 / s), -1 / (2 * across * cosine + 1 / s)
    np.testing.assert_allclose(found.along[:, 0], tangential, rtol=2e-5)
    np.testing.assert_allclose(found.along[:, 1], sagittal, rtol=1e-8)


def test_sagittal_sheet_of_a_system_of_revolution_is_on_the_axis():
    found = caustic(Catadioptric(LENS, (PlacedMirror(Asphere.example(), tz=0.2),)), PIXELS * 0.7)
    assert np.abs(found.sagittal[..., :2]).max() < 1e-15
    assert np.ptp(found.sagittal[..., 2]) > 1e-3


@pytest.mark.parametrize("moved", [{}, TILTED])
@pytest.mark.parametrize(
    ("lens", "mirror"),
    [
        (LENS, Conic.hyperbola(0.028, 0.0385, 0.06)),
        (TELECENTRIC, Conic.sphere(0.06, 0.05)),
        (Mei(1800.0, 1810.0, 1.0, 2.0, 0.9, k1=-0.1, k2=0.02, p1=1e-3, p2=-1e-3), Asphere.example()),
    ],
)
def test_differential_of_reflection_matches_finite_differences(moved, lens, mirror):
    system = Catadioptric(lens, (PlacedMirror(mirror, **moved | {"tz": 0.1}),))

    class OnlyRays:
        rays = system.rays

    exact, close = ray_jacobians(system, PIXELS * 0.6), ray_jacobians(OnlyRays(), PIXELS * 0.6)
    assert exact.rays.valid.mean() > 0.9
    for one, other in zip(exact[1:], close[1:], strict=True):
        use = np.isfinite(other)
        assert use.mean() > 0.9
        assert np.abs(one - other)[use].max() < 1e-10 * np.abs(one[use]).max()


def test_derivatives_over_two_mirrors():
    """A telecentric lens, a parabola, and in its focus one of a hyperbola: central (Gregory and Cassegrain)."""
    primary = PlacedMirror(Conic(-0.1, 1.0, 0.05, 0.01), tz=0.2)
    # The primary gathers light in its focus, at z = 0.15; the convex secondary has it, from behind, as one of its own.
    secondary = PlacedMirror(Conic(0.03, 2.0, 0.012), tilt_x=np.pi, tz=0.15 + 0.01)
    system = Catadioptric(TELECENTRIC, (primary, secondary))
    pixels = np.linspace(150, 300, 6)[:, None] * np.array([[0.6, 0.8]])
    assert system.rays(pixels).valid.all()
    found = caustic(system, pixels)
    meeting = 0.16 + 0.03  # the far focus, R/(e - 1) before its vertex, which looks to +z
    np.testing.assert_allclose(found.tangential, np.broadcast_to([0, 0, meeting], (6, 3)), atol=1e-12)
    np.testing.assert_allclose(found.sagittal, np.broadcast_to([0, 0, meeting], (6, 3)), atol=1e-12)


@pytest.mark.parametrize("moved", [{}, TILTED])
def test_neighbouring_rays_intersect_at_the_caustic(moved):
    """The sheets are where the rays' density is infinite: the determinant of d point/d (u, v, t) is zero there."""
    system = Catadioptric(LENS, (PlacedMirror(Conic.sphere(0.05, 0.05), **moved | {"tz": 0.1}),))
    found = caustic(system, PIXELS)
    (_, bearings, valid), d_origins, d_bearings = ray_jacobians(system, PIXELS)
    assert valid.all()
    assert np.isfinite(found.along).all()  # one lens sends out wavefronts: the roots are real
    for k in range(2):
        moves = d_origins + found.along[..., k, None, None] * d_bearings
        volume = np.linalg.det(np.concatenate([moves, bearings[..., None]], -1))
        whole = np.linalg.det(np.concatenate([d_origins, bearings[..., None]], -1))
        assert np.abs(volume / whole).max() < 1e-12


class Axial:
    """Rays at theta from the z axis that cross it at shift theta^2: a fisheye with an entrance pupil shift."""

    def __init__(self, shift, focal=300.0):
        self.shift, self.focal = shift, focal

    def rays(self, pixels):
        p = np.asarray(pixels, float) / self.focal
        theta = np.linalg.norm(p, axis=-1)
        side = p / theta[..., None]
        bearings = np.stack([*np.moveaxis(side * np.sin(theta)[..., None], -1, 0), np.cos(theta)], -1)
        origins = np.stack([0 * theta, 0 * theta, self.shift * theta**2], -1)
        return Rays(origins, bearings, np.ones(theta.shape, bool))


def test_caustic_of_an_entrance_pupil_shift():
    """For a pupil s(theta) the tangential sheet is s'(theta) sin(theta) along the ray, the sagittal one the pupil."""
    found = caustic(Axial(0.004), PIXELS)
    theta = np.linalg.norm(PIXELS, axis=-1) / 300
    np.testing.assert_allclose(found.along[..., 0], 2 * 0.004 * theta * np.sin(theta), atol=1e-12)
    np.testing.assert_allclose(found.along[..., 1], 0, atol=1e-12)


def test_invalid_pixels_have_no_caustic():
    system = Catadioptric(LENS, (PlacedMirror(Conic.sphere(0.05, 0.02), tz=0.1),))
    found = caustic(system, [[10.0, 0.0], [900.0, 0.0], [np.nan, 0.0]])
    assert np.isfinite(found.along).all(1).tolist() == [True, False, False]
    assert caustic(system, np.zeros((0, 2))).tangential.shape == (0, 3)
    assert caustic(system, [10.0, 5.0]).sagittal.shape == (3,)


def test_caustic_of_parallel_rays_is_at_infinity():
    from omnisight.optics.mirrors.plane import Plane

    found = caustic(Catadioptric(TELECENTRIC, (PlacedMirror(Plane(), tz=0.1),)), PIXELS)
    assert np.isnan(found.along).all()
