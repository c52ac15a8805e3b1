"""Catadioptric cameras: derivatives, parameters, dictionaries and array shapes."""

import numpy as np
import pytest
from systems import BALL, PINHOLE, SYSTEMS, every_system, few_systems, visible_points, within

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.models.ocam import Ocam
from omnisight.optics import Catadioptric, PlacedMirror, Telecentric
from omnisight.optics.mirrors.asphere import Asphere

# -- derivatives ------------------------------------------------------------------------------------------------


def differences(function, step):
    """Differentiate f(h) at h = 0 to fourth order in the step."""
    f = {k: function(k * step) for k in (-2, -1, 1, 2)}
    return (8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * step)


def well_inside(system, **options):
    """Return visible points (N, 3) whose neighbours are visible."""
    points, _ = visible_points(system, **options)
    corners, _ = system.reflection_points(points)
    keep = within(system, corners)
    moved = [system.project(points[keep] + h * np.eye(3)[k])[1] for h in (-1e-3, 1e-3) for k in range(3)]
    return points[keep][np.all(moved, 0)]


@few_systems
def test_jacobian_by_point(system):
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
def test_jacobian_by_parameters(system):
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


def test_parameters_combine_lens_and_mirror_parameters():
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
def test_dictionary_round_trip(system):
    assert Catadioptric.from_dict(system.to_dict()) == system
    assert system.with_params(system.params) == system


def test_dictionary_keeps_lens_and_mirror_coefficients_separate():
    lens = Ocam.example()
    system = Catadioptric(lens, (PlacedMirror(Asphere(18.0, -1.5, (900.0, -4e5, 1e3), rim=0.03), tz=0.1),))
    assert Catadioptric.from_dict(system.to_dict()) == system


@pytest.mark.parametrize(
    ("change", "message"),
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
def test_invalid_dictionaries_are_rejected(change, message):
    with pytest.raises(ValueError, match=message):
        Catadioptric.from_dict(Catadioptric.example().to_dict() | change)


def test_dictionary_without_a_mirror_is_rejected():
    with pytest.raises(ValueError, match="missing lens, mirror"):
        Catadioptric.from_dict({"fx": 1.0})
    with pytest.raises(ValueError, match="mirrors must be one or more PlacedMirror mirrors"):
        Catadioptric(PINHOLE, ())
    with pytest.raises(ValueError, match="mirrors must be one or more PlacedMirror mirrors"):
        Catadioptric(PINHOLE, (BALL,))


def test_placed_mirror_from_a_pose():
    pose = Pose(so3.exp([0.4, -0.7, 0.3]), np.array([0.1, 0.2, 0.3]))
    placed = PlacedMirror.at(BALL, pose)
    turned = placed.lens_from_mirror
    # The rotation about the axis has no effect.
    np.testing.assert_allclose(turned.rotation[:, 2], pose.rotation[:, 2], atol=1e-15)
    np.testing.assert_allclose(turned.rotation @ turned.rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_array_equal(turned.translation, pose.translation)
    np.testing.assert_allclose(
        so3.exp([0.4, 0, 0]) @ so3.exp([0, 0.3, 0]), PlacedMirror(BALL, 0.4, 0.3).lens_from_mirror.rotation
    )


@pytest.mark.parametrize("lead", [(), (5,), (2, 3, 4), (0,)])
def test_any_leading_shape_is_kept(lead):
    system = SYSTEMS["folded"]
    points = np.broadcast_to(visible_points(system)[0][7], (*lead, 3))
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


def test_telecentric_lens_is_an_affine_map():
    lens = Telecentric.example()
    pixels = np.array([[0.0, 0.0], [511.2, 384.9], [1000.0, 3.0]])
    rays = lens.rays(pixels)
    np.testing.assert_array_equal(rays.bearings, [[0, 0, 1]] * 3)
    found, valid, d_point, d_params = lens.project_with_jacobians(rays.origins + 0.3 * rays.bearings)
    assert valid.all()
    np.testing.assert_allclose(found, pixels, atol=1e-10)
    np.testing.assert_allclose(found, d_point @ [0, 0, 1] + np.einsum("nij,j->ni", d_params, lens.params), atol=1e-10)
    assert not lens.project([0.0, 0.0, -1.0])[1]
    assert not lens.rays([np.nan, 1.0]).valid
