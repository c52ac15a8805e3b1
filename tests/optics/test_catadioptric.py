"""Light over mirrors, both ways: what `rays` follows and where `project` finds points again."""

import numpy as np
import pytest

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.models.equidistant import Equidistant
from omnisight.models.ocam import Ocam
from omnisight.models.pinhole import Pinhole
from omnisight.optics import Catadioptric, Orthographic, Placed, mirror_class, mirror_names
from omnisight.optics.mirrors.asphere import Asphere
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane

PINHOLE = Pinhole(fx=1300.0, fy=1310.0, cx=639.5, cy=479.5, skew=0.4)
FISHEYE = Equidistant(fx=700.0, fy=700.0, cx=639.5, cy=479.5)
TELECENTRIC = Orthographic(fx=9800.0, fy=9810.0, cx=639.5, cy=479.5)
BALL, HYPERBOLA = Conic.sphere(0.04), Conic.hyperbola(0.028, 0.0385, 0.035)
FLAT = Conic(0.2, 1.2, 0.12, hole=0.02)

# Convex mirrors show a point once, wherever they stand.
SINGLE = {name: mirror_class(name).example() for name in mirror_names()} | {
    "ball": BALL,
    "parabola": Conic.parabola(0.06, 0.04),
    "flat-ellipse": Conic(0.03, 0.6, 0.035),
    "ring": Conic(0.05, 1.1, 0.05, hole=0.01),
    "endless-plane": Plane(),
}
SYSTEMS = {
    f"{name}-{where}": Catadioptric(PINHOLE, (placed,))
    for name, mirror in SINGLE.items()
    for where, placed in (
        ("on-axis", Placed(mirror, tz=0.12)),
        ("decentred", Placed(mirror, 0.15, -0.1, 0.005, -0.004, 0.12)),
        ("oblique", Placed(mirror, 0.5, 0.4, 0.01, -0.004, 0.12)),
    )
} | {
    "telecentric-parabola": Catadioptric(TELECENTRIC, (Placed(Conic.parabola(0.06, 0.04), tz=0.1),)),
    "telecentric-ball": Catadioptric(TELECENTRIC, (Placed(BALL, 0.1, -0.2, 0.004, 0.0, 0.1),)),
    "fisheye-hyperbola": Catadioptric(FISHEYE, (Placed(HYPERBOLA, 0.02, 0.0, 0.0, 0.001, 0.03),)),
    "folded": Catadioptric(PINHOLE, (Placed(Conic.sphere(0.05, 0.02), tz=0.1), Placed(FLAT, np.pi, tz=0.01))),
    "folded-decentred": Catadioptric(
        PINHOLE,
        (
            Placed(Conic.sphere(0.05, 0.02), 0.02, 0.01, 0.001, 0.001, 0.1),
            Placed(FLAT, np.pi + 0.03, 0.02, 0.001, 0.0, 0.01),
        ),
    ),
    "periscope": Catadioptric(
        PINHOLE, (Placed(Plane(0.04), np.pi / 4, tz=0.1), Placed(HYPERBOLA, -np.pi / 2, 0.0, 0.0, 0.08, 0.1))
    ),
    "telecentric-folded": Catadioptric(
        TELECENTRIC, (Placed(Conic.sphere(0.05, 0.02), tz=0.1), Placed(FLAT, np.pi, tz=0.01))
    ),
}
every_system = pytest.mark.parametrize("system", [pytest.param(s, id=name) for name, s in SYSTEMS.items()])
few_systems = pytest.mark.parametrize(
    "system",
    [
        pytest.param(SYSTEMS[name], id=name)
        for name in (
            "conic-decentred",
            "ball-oblique",
            "asphere-decentred",
            "cone-decentred",
            "plane-oblique",
            "telecentric-ball",
            "fisheye-hyperbola",
            "folded-decentred",
            "periscope",
            "telecentric-folded",
        )
    ],
)


def seen(system, near=0.02, far=50.0, count=60, seed=1):
    """Give scene points (N, 3) that the system shows between two distances from its mirror, and their pixels (N, 2)."""
    u, v = np.meshgrid(np.linspace(0, 1279, count), np.linspace(0, 959, count * 3 // 4))
    pixels = np.stack([u, v], -1).reshape(-1, 2)
    rays = system.rays(pixels)
    length = np.exp(np.random.default_rng(seed).uniform(*np.log([near, far]), len(pixels)))
    points = rays.origins + length[:, None] * rays.bearings
    return points[rays.valid], pixels[rays.valid]


def within(system, corners):
    """Say which paths (N, M, 3) keep away from the rims, the holes and the tips of their mirrors."""
    keep = np.ones(len(corners), bool)
    for i, p in enumerate(system.mirrors):
        local = p.lens_from_mirror.inverse() @ corners[:, i]
        rho = np.hypot(local[:, 0], local[:, 1])
        keep &= (rho < 0.9 * p.mirror.rim) & (rho > 1.1 * p.mirror.hole) & (rho > 0.1 * min(p.mirror.rim, 0.04))
    return keep


# -- there and back ---------------------------------------------------------------------------------------------


@every_system
@pytest.mark.parametrize(("near", "far"), [(1e-4, 1e-2), (0.03, 10.0), (1e3, 1e6)])
def test_every_point_of_the_field_is_found_at_its_pixel(system, near, far):
    if isinstance(system.lens, Orthographic):
        far = min(far, 1e4)  # of parallel rays a pixel is a place: rounding of the point alone moves it
    points, pixels = seen(system, near, far)
    assert len(points) > 80
    found, valid = system.project(points)
    assert valid.all()
    np.testing.assert_allclose(found, pixels, atol=1e-8)


@every_system
def test_the_ray_of_a_points_pixel_goes_through_the_point(system):
    points, _ = seen(system)
    pixels, _ = system.project(points)
    rays = system.rays(pixels)
    assert rays.valid.all()
    towards = points - rays.origins
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    assert np.linalg.norm(towards - rays.bearings, axis=-1).max() < 1e-11


def test_a_mirror_of_every_kind_is_found_by_the_lens_whether_convex_or_not():
    # Concave mirrors may show a point more than once; what is found is a place where it is shown.
    for mirror in (Conic.sphere(-0.3, 0.05), Conic.parabola(-0.2, 0.05), Conic.ellipse(0.1, 0.06, 0.05)):
        system = Catadioptric(PINHOLE, (Placed(mirror, 0.1, -0.05, 0.002, 0.001, 0.12),))
        points, _ = seen(system, 0.1, 10.0)
        pixels, valid = system.project(points)
        assert valid.all()
        rays = system.rays(pixels)
        towards = points - rays.origins
        towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
        assert np.linalg.norm(towards - rays.bearings, axis=-1).max() < 1e-11


# -- against what is known of light -----------------------------------------------------------------------------


@every_system
def test_light_is_reflected_by_the_law(system):
    points, _ = seen(system)
    corners, valid = system.reflection_points(points)
    assert valid.all()
    assert corners.shape == (len(points), len(system.mirrors), 3)
    start = corners[:, 0] * [1, 1, 0] if isinstance(system.lens, Orthographic) else np.zeros_like(points)
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
def test_the_path_of_light_is_stationary(system):
    # Moved by h along the mirrors, a path changes as h^2 and not as h (Fermat).
    points, _ = seen(system, 0.1, 3.0, count=24)
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
        total = path[0][:, 2] if isinstance(system.lens, Orthographic) else np.linalg.norm(path[0], axis=-1)
        for a, b in zip(path, [*path[1:], points], strict=True):
            total = total + np.linalg.norm(b - a, axis=-1)
        return total

    h = 1e-6
    slope = (length(h) - length(-h)) / (2 * h)
    assert len(slope) >= 20
    assert np.abs(slope).max() < 1e-6


@pytest.mark.parametrize("lens", [PINHOLE, FISHEYE])
def test_a_plane_mirror_shows_what_a_lens_behind_it_would_see(lens):
    placed = Placed(Plane(rim=0.3), 0.3, -0.2, 0.01, 0.02, 0.4)
    system = Catadioptric(lens, (placed,))
    points, _ = seen(system, 0.01, 10.0)
    mirrored = (placed.lens_from_mirror.inverse() @ points) * [1, 1, -1]
    expected, valid = lens.project(placed.lens_from_mirror @ mirrored)
    assert valid.all()
    np.testing.assert_allclose(system.project(points)[0], expected, atol=1e-9)


def test_a_ball_answers_alhazens_problem():
    # In the plane of the centre, the lens a and the point b (as complex numbers, in radii), z on the circle with
    # conj(ab) z^4 - (conj(a) + conj(b)) z^3 + (a + b) z - ab = 0 sees both at the same angle from its normal.
    system = SYSTEMS["ball-decentred"]
    points, _ = seen(system, 0.01, 20.0, count=24)
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


def test_a_lens_in_the_focus_of_a_hyperbola_sees_from_the_other():
    inner, outer = HYPERBOLA.foci
    system = Catadioptric(PINHOLE, (Placed(HYPERBOLA, tz=-outer),))
    rays = system.rays(np.random.default_rng(0).uniform([400, 240], [880, 720], (500, 2)))
    viewpoint = np.array([0, 0, inner - outer])
    off = np.cross(viewpoint - rays.origins, rays.bearings)
    assert rays.valid.all()
    np.testing.assert_allclose(off, 0, atol=1e-15)


def test_parallel_rays_over_a_parabola_pass_its_focus():
    system = SYSTEMS["telecentric-parabola"]
    u, v = np.meshgrid(np.linspace(300, 980, 30), np.linspace(200, 800, 30))
    rays = system.rays(np.stack([u, v], -1))
    focus = np.array([0, 0, 0.1 + system.mirrors[0].mirror.foci[0]])
    np.testing.assert_allclose(np.cross(focus - rays.origins, rays.bearings)[rays.valid], 0, atol=1e-15)


# -- what the mirrors do not show -------------------------------------------------------------------------------


def test_what_a_mirror_cannot_show_is_not_valid():
    system = Catadioptric(PINHOLE, (Placed(BALL, tz=0.12),))
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


def test_what_is_shown_is_what_some_pixel_sees():
    # Directions all around a mirror: those that `project` shows fill the cone of the rays through its rim, and no more.
    system = Catadioptric(FISHEYE, (Placed(Conic.parabola(0.06, 0.04), tz=0.05),))
    rim = system.mirrors[0].lens_from_mirror @ np.array([0.04, 0.0, system.mirrors[0].mirror.sag(0.04)])
    ray = system.rays(FISHEYE.project(rim * [1 - 1e-9, 1, 1])[0])
    limit = np.arctan2(ray.bearings[0], ray.bearings[2])
    theta = np.linspace(limit - 0.2, np.pi, 400)
    points = ray.origins + 1e6 * np.stack([np.sin(theta), 0 * theta, np.cos(theta)], -1)
    _, valid = system.project(points)
    np.testing.assert_array_equal(valid, theta >= limit)


@pytest.mark.parametrize("name", ["conic-oblique", "ball-oblique", "cone-decentred", "asphere-on-axis", "ring-on-axis"])
def test_what_is_said_to_be_hidden_is_not_found_from_elsewhere(name, monkeypatch):
    # All around, near and far: as many points are shown as if the search went on after the first answer.
    system = SYSTEMS[name]
    rng = np.random.default_rng(7)
    points = rng.normal(size=(600, 3))
    points *= np.exp(rng.uniform(-4, 7, (600, 1))) / np.linalg.norm(points, axis=-1, keepdims=True)
    points[:, 2] += 0.12
    _, valid = system.project(points)
    assert 0.1 < valid.mean() < 0.97
    monkeypatch.setattr(Catadioptric, "_hidden", lambda _self, _u, points: np.zeros(len(points), bool))
    np.testing.assert_array_equal(system.project(points)[1], valid)


def test_every_ray_that_is_valid_has_a_place_and_a_bearing():
    # All of a ball's picture, its very limb included, and pixels that are none.
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


def test_a_smaller_rim_shows_less_and_nothing_else():
    wide = Catadioptric(PINHOLE, (Placed(HYPERBOLA, tz=0.09),))
    narrow = Catadioptric(PINHOLE, (Placed(Conic(HYPERBOLA.radius, HYPERBOLA.eccentricity, 0.02, 0.005), tz=0.09),))
    points, pixels = seen(wide)
    corners, _ = wide.reflection_points(points)
    rho = np.hypot(corners[:, 0, 0], corners[:, 0, 1])
    _, valid = narrow.project(points)
    np.testing.assert_array_equal(valid, (rho <= 0.02) & (rho >= 0.005))
    np.testing.assert_array_equal(narrow.rays(pixels).valid, valid)


def test_a_lens_behind_a_mirror_without_a_hole_sees_nothing():
    small = Placed(Conic.sphere(0.05, 0.02), tz=0.1)
    pierced = Catadioptric(PINHOLE, (small, Placed(FLAT, np.pi, tz=0.01)))
    solid = Catadioptric(PINHOLE, (small, Placed(Conic(FLAT.radius, FLAT.eccentricity, FLAT.rim), np.pi, tz=0.01)))
    points, pixels = seen(pierced)
    assert not solid.project(points)[1].any()
    assert not solid.rays(pixels).valid.any()


@pytest.mark.parametrize("rim", [0.02, 0.04])
def test_the_first_mirror_hides_what_is_behind_it_from_the_second(rim):
    # Two planes face to face: light at the slope s from the axis meets them at s D, s (2 D - d) and passes the first
    # at s (3 D - 2 d).
    system = Catadioptric(PINHOLE, (Placed(Plane(rim), tz=0.1), Placed(Plane(0.2, 0.015), np.pi, tz=0.01)))
    slope = np.linspace(0.01, 0.45, 300)
    pixels, _ = PINHOLE.project(np.stack([slope, 0 * slope, slope * 0 + 1], -1))
    expected = (0.1 * slope <= rim) & (0.19 * slope >= 0.015) & (0.28 * slope > rim)
    np.testing.assert_array_equal(system.rays(pixels).valid, expected)
    points = np.stack([slope * 1.18, 0 * slope, 0 * slope + 1], -1)  # at z = 1 of the same light
    found, valid = system.project(points)
    np.testing.assert_array_equal(valid, expected)
    np.testing.assert_allclose(found[valid], pixels[valid], atol=1e-9)


def test_the_wall_of_a_bowl_hides():
    # Of a deep bowl: light that would leave through its wall does not.
    deep = Catadioptric(FISHEYE, (Placed(Conic.sphere(-0.1, 0.0999), tx=0.05, tz=0.06),))
    shallow = Catadioptric(FISHEYE, (Placed(Conic.sphere(-0.1, 0.05), tx=0.05, tz=0.06),))
    points, pixels = seen(shallow, 1.0, 2.0)
    held = deep.rays(pixels).valid
    assert 0 < held.sum() < len(held)
    assert deep.project(points[held])[1].all()
    # Where the deep one shows such a point after all, it is elsewhere in the picture.
    found, valid = deep.project(points[~held])
    assert (np.abs(found - pixels[~held])[valid].max(-1) > 100).all()


# -- derivatives ------------------------------------------------------------------------------------------------


def differences(function, step):
    """Differentiate f(h) at h = 0 to fourth order in the step."""
    f = {k: function(k * step) for k in (-2, -1, 1, 2)}
    return (8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * step)


def well_inside(system, **options):
    """Give points (N, 3) whose neighbours are shown too."""
    points, _ = seen(system, **options)
    corners, _ = system.reflection_points(points)
    keep = within(system, corners)
    moved = [system.project(points[keep] + h * np.eye(3)[k])[1] for h in (-1e-3, 1e-3) for k in range(3)]
    return points[keep][np.all(moved, 0)]


@few_systems
def test_jacobian_by_the_point(system):
    points = well_inside(system, near=0.1, far=2.0, count=16)
    pixels, valid, d_point, _ = system.project_with_jacobians(points)
    assert valid.all()
    np.testing.assert_allclose(pixels, system.project(points)[0], atol=1e-9)
    expected = np.stack(
        [differences(lambda h, k=k: system.project(points + h * np.eye(3)[k])[0], 2e-5) for k in range(3)], -1
    )
    size = np.abs(expected).max((-1, -2), keepdims=True)
    assert (np.abs(d_point - expected) / size).max() < 1e-6


@few_systems
def test_jacobian_by_the_parameters(system):
    points = well_inside(system, near=0.1, far=2.0, count=16)
    *_, d_params = system.project_with_jacobians(points)
    assert d_params.shape == (len(points), 2, system.params.size)
    for k, parameter in enumerate(system.parameters):
        name = parameter.name.split("_")[-1]
        if name in ("rim", "hole"):
            assert not d_params[..., k].any()
            continue
        step = {"x": 1e-5, "y": 1e-5, "z": 1e-5}.get(name[-1], 1e-5 * max(abs(system.params[k]), 0.1))

        def moved(h, k=k):
            params = system.params.copy()
            params[k] += h
            return system.with_params(params).project(points)[0]

        expected = differences(moved, step)
        good = np.isfinite(expected).all(-1)
        assert good.mean() > 0.9
        error = np.abs(d_params[..., k] - expected)[good].max()
        assert error < 1e-6 * np.abs(expected[good]).max() + 1e-6, parameter.name


# -- parameters, files, shapes ----------------------------------------------------------------------------------


def test_parameters_are_the_lenss_and_the_mirrors_by_name():
    system = SYSTEMS["folded-decentred"]
    names = system.param_names
    assert names[:5] == ("fx", "fy", "cx", "cy", "skew")
    assert {"mirror_radius", "mirror_tz", "mirror2_eccentricity", "mirror2_tilt_x"} < set(names)
    assert len(names) == len(set(names)) == system.params.size
    free = {p.name for p in system.parameters if p.free}
    assert {"fx", "mirror_tilt_x", "mirror2_tz"} <= free
    assert not free & {"skew", "mirror_radius", "mirror_rim", "mirror2_hole"}
    assert {p.unit for p in system.parameters} == {"px", "m", "rad", ""}
    moved = system.with_params(system.params + 1.0)
    np.testing.assert_array_equal(moved.params, system.params + 1.0)
    assert moved.mirrors[1].tz == system.mirrors[1].tz + 1.0
    with pytest.raises(ValueError, match="catadioptric has 23 parameters"):
        system.with_params([1.0])


@every_system
def test_a_dictionary_holds_all_of_a_system(system):
    assert Catadioptric.from_dict(system.to_dict()) == system
    assert system.with_params(system.params) == system


def test_a_dictionary_tells_a_lens_and_a_mirror_with_coefficients_apart():
    lens = Ocam.example()
    system = Catadioptric(lens, (Placed(Asphere(18.0, -1.5, (900.0, -4e5, 1e3), rim=0.03), tz=0.1),))
    assert Catadioptric.from_dict(system.to_dict()) == system


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mirror": "torus"}, "unknown mirror 'torus'"),
        ({"lens": "box"}, "unknown camera model 'box'"),
        ({"mirror_radius": "wide"}, "conic.radius must be a finite number, got 'wide'"),
        ({"mirror_tz": None}, "mirror_tz must be a finite number, got None"),
        ({"mirror_height": 1.0}, "conic has no height"),
        ({"mirror2": "plane", "mirror2_tilt_z": 1.0}, "plane has no tilt_z"),
        ({"mirror3": "plane"}, "missing mirror2"),
        ({"lens": None}, "unknown camera model None"),
    ],
)
def test_a_dictionary_that_is_no_system_is_refused(change, says):
    with pytest.raises(ValueError, match=says):
        Catadioptric.from_dict(Catadioptric.example().to_dict() | change)


def test_a_dictionary_without_a_mirror_is_refused():
    with pytest.raises(ValueError, match="missing lens, mirror"):
        Catadioptric.from_dict({"fx": 1.0})
    with pytest.raises(ValueError, match="mirrors must be one or more Placed mirrors"):
        Catadioptric(PINHOLE, ())
    with pytest.raises(ValueError, match="mirrors must be one or more Placed mirrors"):
        Catadioptric(PINHOLE, (BALL,))


def test_a_pose_places_a_mirror_of_revolution():
    pose = Pose(so3.exp([0.4, -0.7, 0.3]), np.array([0.1, 0.2, 0.3]))
    placed = Placed.at(BALL, pose)
    ours = placed.lens_from_mirror
    np.testing.assert_allclose(ours.rotation[:, 2], pose.rotation[:, 2], atol=1e-15)  # the axis; its turn is nothing
    np.testing.assert_allclose(ours.rotation @ ours.rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_array_equal(ours.translation, pose.translation)
    np.testing.assert_allclose(
        so3.exp([0.4, 0, 0]) @ so3.exp([0, 0.3, 0]), Placed(BALL, 0.4, 0.3).lens_from_mirror.rotation
    )


@pytest.mark.parametrize("lead", [(), (5,), (2, 3, 4), (0,)])
def test_points_and_pixels_come_in_any_shape(lead):
    system = SYSTEMS["folded"]
    points = np.broadcast_to(seen(system)[0][7], (*lead, 3))
    pixels, valid = system.project(points)
    assert (pixels.shape, valid.shape) == ((*lead, 2), lead)
    rays = system.rays(pixels)
    assert (rays.origins.shape, rays.bearings.shape, rays.valid.shape) == ((*lead, 3), (*lead, 3), lead)
    *_, d_point, d_params = system.project_with_jacobians(points)
    assert d_point.shape == (*lead, 2, 3)
    assert d_params.shape == (*lead, 2, system.params.size)
    assert valid.all()
    with pytest.raises(ValueError, match="points must be real numbers of shape"):
        system.project(np.zeros((3, 2)))


def test_a_telecentric_lens_is_one_affine_map():
    lens = Orthographic.example()
    pixels = np.array([[0.0, 0.0], [511.2, 384.9], [1000.0, 3.0]])
    rays = lens.rays(pixels)
    np.testing.assert_array_equal(rays.bearings, [[0, 0, 1]] * 3)
    found, valid, d_point, d_params = lens.project_with_jacobians(rays.origins + 0.3 * rays.bearings)
    assert valid.all()
    np.testing.assert_allclose(found, pixels, atol=1e-10)
    np.testing.assert_allclose(found, d_point @ [0, 0, 1] + np.einsum("nij,j->ni", d_params, lens.params), atol=1e-10)
    assert not lens.project([0.0, 0.0, -1.0])[1]
    assert not lens.rays([np.nan, 1.0]).valid
