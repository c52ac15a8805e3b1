"""Catadioptric cameras: `rays` and `project` are inverse, and obey the laws of reflection."""

import numpy as np
import pytest
from systems import BALL, FISHEYE, HYPERBOLA, PINHOLE, SYSTEMS, every_system, visible_points, within

from omnisight.optics import Catadioptric, PlacedMirror, Telecentric
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane

# -- there and back ---------------------------------------------------------------------------------------------


@every_system
@pytest.mark.parametrize(("near", "far"), [(1e-4, 1e-2), (0.03, 10.0), (1e3, 1e6)])
def test_projection_inverts_the_rays_of_all_pixels(system, near, far):
    if isinstance(system.lens, Telecentric):
        far = min(far, 1e4)  # of parallel rays a pixel is a place: rounding of the point alone moves it
    points, pixels = visible_points(system, near, far)
    assert len(points) > 80
    found, valid = system.project(points)
    assert valid.all()
    np.testing.assert_allclose(found, pixels, atol=1e-8)


@every_system
def test_ray_of_a_projected_point_passes_through_it(system):
    points, _ = visible_points(system)
    pixels, _ = system.project(points)
    rays = system.rays(pixels)
    assert rays.valid.all()
    towards = points - rays.origins
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    assert np.linalg.norm(towards - rays.bearings, axis=-1).max() < 1e-11


def test_every_mirror_type_projects_whether_convex_or_not():
    # Concave mirrors may show a point more than once; what is found is a place where it is shown.
    for mirror in (Conic.sphere(-0.3, 0.05), Conic.parabola(-0.2, 0.05), Conic.ellipse(0.1, 0.06, 0.05)):
        system = Catadioptric(PINHOLE, (PlacedMirror(mirror, 0.1, -0.05, 0.002, 0.001, 0.12),))
        points, _ = visible_points(system, 0.1, 10.0)
        pixels, valid = system.project(points)
        assert valid.all()
        rays = system.rays(pixels)
        towards = points - rays.origins
        towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
        assert np.linalg.norm(towards - rays.bearings, axis=-1).max() < 1e-11


# -- against what is known of light -----------------------------------------------------------------------------


@every_system
def test_paths_obey_the_law_of_reflection(system):
    points, _ = visible_points(system)
    corners, valid = system.reflection_points(points)
    assert valid.all()
    assert corners.shape == (len(points), len(system.mirrors), 3)
    start = corners[:, 0] * [1, 1, 0] if isinstance(system.lens, Telecentric) else np.zeros_like(points)
    path = [start, *corners.transpose(1, 0, 2), points]
    for placed, before, at, after in zip(system.mirrors, path[:-2], path[1:-1], path[2:], strict=True):
        pose = placed.lens_from_mirror
        local = pose.inverse() @ at
        rho = np.hypot(local[:, 0], local[:, 1])
        np.testing.assert_allclose(local[:, 2], placed.mirror.sag(rho), atol=1e-13)
        n = placed.mirror.normal(local) @ pose.rotation.T
        arriving, leaving = at - before, after - at
        arriving /= np.linalg.norm(arriving, axis=-1, keepdims=True)
        leaving /= np.linalg.norm(leaving, axis=-1, keepdims=True)
        assert ((arriving * n).sum(-1) < 0).all()
        np.testing.assert_allclose((leaving * n).sum(-1), -(arriving * n).sum(-1), atol=1e-11)
        np.testing.assert_allclose(np.cross(leaving, n), np.cross(arriving, n), atol=1e-11)


@every_system
def test_path_length_is_stationary(system):
    # Moved by h along the mirrors, a path changes as h^2 and not as h (Fermat).
    points, _ = visible_points(system, 0.1, 3.0, count=24)
    corners, _ = system.reflection_points(points)
    inside = within(system, corners)
    points, corners = points[inside], corners[inside]
    rng = np.random.default_rng(0)
    local = [p.lens_from_mirror.inverse() @ corners[:, i] for i, p in enumerate(system.mirrors)]
    way = [rng.normal(size=(len(points), 2)) for _ in system.mirrors]

    def length(h):
        path = []
        for p, at, w in zip(system.mirrors, local, way, strict=True):
            xy = at[:, :2] + h * w
            path.append(p.lens_from_mirror @ np.column_stack([xy, p.mirror.sag(np.hypot(*xy.T))]))
        total = path[0][:, 2] if isinstance(system.lens, Telecentric) else np.linalg.norm(path[0], axis=-1)
        for a, b in zip(path, [*path[1:], points], strict=True):
            total = total + np.linalg.norm(b - a, axis=-1)
        return total

    h = 1e-6
    slope = (length(h) - length(-h)) / (2 * h)
    assert len(slope) >= 20
    assert np.abs(slope).max() < 1e-6


@pytest.mark.parametrize("lens", [PINHOLE, FISHEYE])
def test_plane_mirror_is_equivalent_to_a_lens_behind_it(lens):
    placed = PlacedMirror(Plane(rim=0.3), 0.3, -0.2, 0.01, 0.02, 0.4)
    system = Catadioptric(lens, (placed,))
    points, _ = visible_points(system, 0.01, 10.0)
    mirrored = (placed.lens_from_mirror.inverse() @ points) * [1, 1, -1]
    expected, valid = lens.project(placed.lens_from_mirror @ mirrored)
    assert valid.all()
    np.testing.assert_allclose(system.project(points)[0], expected, atol=1e-9)


def test_sphere_solves_alhazens_problem():
    # In the plane of the centre, the lens a and the point b (as complex numbers, in radii), z on the circle with
    # conj(ab) z^4 - (conj(a) + conj(b)) z^3 + (a + b) z - ab = 0 sees both at the same angle from its normal.
    system = SYSTEMS["ball-decentred"]
    points, _ = visible_points(system, 0.01, 20.0, count=24)
    corners, _ = system.reflection_points(points)
    radius = BALL.radius
    centre = system.mirrors[0].lens_from_mirror @ np.array([0, 0, radius])
    for point, corner in zip(points, corners[:, 0], strict=True):
        a3, b3 = -centre / radius, (point - centre) / radius
        right = a3 / np.linalg.norm(a3)
        up = b3 - (b3 @ right) * right
        up /= np.linalg.norm(up)
        a, b = complex(np.linalg.norm(a3)), complex(b3 @ right, b3 @ up)
        roots = np.roots([np.conj(a * b), -np.conj(a + b), 0, a + b, -a * b])
        roots = roots[np.abs(np.abs(roots) - 1) < 1e-6]
        shows = ((roots.conj() * a).real > 1) & ((roots.conj() * b).real > 1)
        assert shows.sum() == 1
        z = roots[shows][0]
        np.testing.assert_allclose((corner - centre) / radius, z.real * right + z.imag * up, atol=1e-9)


def test_lens_in_a_focus_of_a_hyperboloid_has_its_viewpoint_in_the_other():
    inner, outer = HYPERBOLA.foci
    system = Catadioptric(PINHOLE, (PlacedMirror(HYPERBOLA, tz=-outer),))
    rays = system.rays(np.random.default_rng(0).uniform([400, 240], [880, 720], (500, 2)))
    viewpoint = np.array([0, 0, inner - outer])
    off = np.cross(viewpoint - rays.origins, rays.bearings)
    assert rays.valid.all()
    np.testing.assert_allclose(off, 0, atol=1e-15)


def test_parallel_rays_on_a_paraboloid_pass_its_focus():
    system = SYSTEMS["telecentric-parabola"]
    u, v = np.meshgrid(np.linspace(300, 980, 30), np.linspace(200, 800, 30))
    rays = system.rays(np.stack([u, v], -1))
    focus = np.array([0, 0, 0.1 + system.mirrors[0].mirror.foci[0]])
    np.testing.assert_allclose(np.cross(focus - rays.origins, rays.bearings)[rays.valid], 0, atol=1e-15)
