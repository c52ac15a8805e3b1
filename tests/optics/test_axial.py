"""Laws of all non-central camera models, and of the axial model."""

import dataclasses

import mpmath
import numpy as np
import pytest

from omnisight.geometry.sphere import angle_from_axis, cap
from omnisight.models import model_class, model_names
from omnisight.models.equirectangular import Equirectangular
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optics.models import ray_model_class, ray_model_names
from omnisight.optics.models.axial import Axial

MODELS = [pytest.param(ray_model_class(name).example(), id=name) for name in ray_model_names()]
every_model = pytest.mark.parametrize("model", MODELS)
PUPILS = [(0.006, 0.0004), (0.05, 0.01, -0.002), (-0.05, -0.01), (0.01,), (0.0, 0.004)]
every_pupil = pytest.mark.parametrize("pupil", PUPILS, ids=str)
LENS = KannalaBrandt.example()


def pixels(count=40):
    return np.random.default_rng(3).uniform(0, 960, (count, 2))


def points_and_pixels(model, distance=0.4, count=40):
    """Return the points at distances along the rays of pixels."""
    origins, bearings, valid = model.rays(pixels(count))
    assert valid.any()
    return (origins + distance * bearings)[valid], pixels(count)[valid]


@every_model
@pytest.mark.parametrize("distance", [0.15, 1.0, 40.0, 1e6])
def test_points_on_a_ray_project_to_its_pixel(model, distance):
    points, at = points_and_pixels(model, distance)
    again, valid = model.project(points)
    assert valid.all()
    np.testing.assert_allclose(again, at, atol=1e-8)


@every_model
@pytest.mark.parametrize("shape", [(), (5,), (2, 3, 4), (0,)])
def test_any_leading_shape_is_kept(model, shape):
    at = np.full((*shape, 2), 400.0)
    origins, bearings, valid = model.rays(at)
    assert (origins.shape, bearings.shape, valid.shape) == ((*shape, 3), (*shape, 3), shape)
    points = origins + bearings
    assert model.project(points)[0].shape == (*shape, 2)
    projected, fine, d_point, d_params = model.project_with_jacobians(points)
    assert (projected.shape, fine.shape) == ((*shape, 2), shape)
    assert (d_point.shape, d_params.shape) == ((*shape, 2, 3), (*shape, 2, model.params.size))


@every_model
def test_wrong_shapes_are_rejected(model):
    with pytest.raises(ValueError, match=r"shape \(\.\.\., 3\), got shape \(4, 2\)"):
        model.project(np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r"shape \(\.\.\., 2\)"):
        model.rays(np.zeros(3))


@every_model
def test_invalid_entries_are_nan(model):
    projected, valid = model.project([[np.nan, 0.0, 1.0]])
    assert not valid.any()
    assert np.isnan(projected).all()
    origins, bearings, valid = model.rays([[1e7, 0.0]])
    assert not valid.any()
    assert np.isnan(origins).all()
    assert np.isnan(bearings).all()


@every_model
def test_jacobians_match_finite_differences(model):
    points, _ = points_and_pixels(model)
    projected, valid, d_point, d_params = model.project_with_jacobians(points)
    assert valid.all()
    np.testing.assert_allclose(projected, model.project_numpy(points)[0], atol=1e-10)
    step = 1e-6
    for k in range(3):
        ahead, back = (model.project(points + sign * step * np.eye(3)[k])[0] for sign in (1, -1))
        np.testing.assert_allclose(d_point[..., k], (ahead - back) / (2 * step), rtol=1e-6, atol=1e-5)
    for k in range(model.params.size):
        step = 1e-6 * max(1.0, abs(model.params[k]))
        ahead, back = (
            model.with_params(model.params + sign * step * np.eye(model.params.size)[k]).project(points)[0]
            for sign in (1, -1)
        )
        np.testing.assert_allclose(d_params[..., k], (ahead - back) / (2 * step), rtol=1e-5, atol=1e-4)


@every_model
def test_dictionary_round_trip(model):
    assert type(model).from_dict(model.to_dict()) == model
    assert model.with_params(model.params) == model


@every_pupil
def test_rays_start_on_the_axis_and_project_back(pupil):
    model = Axial(LENS, pupil)
    origins, bearings, valid = model.rays(pixels())
    assert valid.any()
    np.testing.assert_array_equal(origins[..., :2][valid], 0.0)
    np.testing.assert_allclose(np.linalg.norm(bearings[valid], axis=-1), 1, atol=1e-14)
    np.testing.assert_array_equal(bearings[valid], LENS.unproject(pixels())[0][valid])
    points, at = points_and_pixels(model, 0.3)
    np.testing.assert_allclose(model.project(points)[0], at, atol=1e-8)


@every_pupil
def test_pupil_position_matches_gennery(pupil):
    theta = np.array([1e-9, 1e-4, 0.019, 0.0201, 0.3, 1.0, 2.0, 3.0])
    with mpmath.workdps(40):
        exact = [
            float((t / mpmath.sin(t) - 1) * sum(e * t ** (2 * k) for k, e in enumerate(pupil)))
            for t in map(mpmath.mpf, theta.tolist())
        ]
    np.testing.assert_allclose(Axial(LENS, pupil).pupil_z(theta), exact, rtol=1e-11, atol=1e-16)


@pytest.mark.parametrize("name", model_names())
def test_zero_pupil_shift_is_the_central_camera(name):
    lens = model_class(name).example()
    model = Axial(lens, (0.0, 0.0))
    points = 2.5 * cap(min(lens.theta_max, 3.0), 12)
    for own, central in zip(model.project(points), lens.project(points), strict=True):
        np.testing.assert_array_equal(own, central)
    bearings, valid = lens.unproject(pixels())
    rays = model.rays(pixels())
    np.testing.assert_array_equal(rays.bearings, bearings)
    np.testing.assert_array_equal(rays.valid, valid)
    assert not np.nan_to_num(rays.origins).any()


def test_distant_points_project_as_by_the_lens():
    model = Axial.example()
    bearings = cap(2.0, 10)
    np.testing.assert_allclose(model.project(1e9 * bearings)[0], LENS.project(bearings)[0], atol=1e-7)


def test_projection_is_accurate_to_rounding():
    model = Axial(Equirectangular.example(), (0.03, 0.01))
    rng = np.random.default_rng(0)
    points = rng.normal(size=(2000, 3))
    points *= (rng.uniform(0.2, 3.0, 2000) / np.linalg.norm(points, axis=1))[:, None]
    projected, valid = model.project(points)
    assert valid[(angle_from_axis(points) < 2.3) & (np.linalg.norm(points, axis=1) > 0.6)].all()
    origins, bearings, _ = model.rays(projected[valid])
    off = np.linalg.norm(np.cross(points[valid] - origins, bearings), axis=1)
    assert off.max() < 1e-12


def test_points_before_the_caustic_or_behind_are_not_valid():
    model = Axial(Equirectangular.example(), (0.2,))
    # Neighbouring rays at theta cross s' sin(theta) along the ray.
    theta = np.array([0.5, 1.0, 1.5])
    slope = (model.pupil_z(theta + 1e-6) - model.pupil_z(theta - 1e-6)) / 2e-6 * np.sin(theta)
    start = model.pupil_z(theta)[:, None] * (0.0, 0.0, 1.0)
    bearings = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], -1)
    beyond = model.project(start + (1.3 * slope)[:, None] * bearings)
    assert beyond[1].all()
    before = model.project(start + (0.9 * slope)[:, None] * bearings)
    # Where it is seen at all, it is by another ray.
    again = model.rays(before[0]).bearings
    assert not np.any(np.abs((again * bearings).sum(-1)[before[1]] - 1) < 1e-6)


def test_pupil_shift_is_the_range_of_pupil_positions():
    model = Axial(LENS, (0.01,))
    assert model.pupil_shift(0.0, np.pi / 2) == pytest.approx(0.01 * (np.pi / 2 - 1))
    assert model.pupil_shift(1.0, 1.0) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lens": None}, "missing lens"),
        ({"lens": "nonsense"}, "unknown camera model 'nonsense'"),
        ({"fx": None}, "missing fx"),
        ({"fx": float("nan")}, "must be a finite number"),
        ({"pupil0": None}, "unknown pupil1; expected pupil0"),
        ({"pupil1": "0"}, "axial.pupil1 must be a finite number"),
        ({"other": 1.0}, "has no other"),
    ],
)
def test_invalid_dictionaries_are_rejected(change, message):
    values = {**Axial.example().to_dict(), **change}
    with pytest.raises(ValueError, match=message):
        Axial.from_dict({key: value for key, value in values.items() if value is not None})


def test_model_is_immutable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Axial.example().pupil = ()
