"""The derivatives of every camera model, against differences."""

import numpy as np

from every_model import every_camera, inside


def central_difference(function, step):
    """Differentiate f(h) at h = 0 to fourth order in the step."""
    f = {k: function(k * step) for k in (-2, -1, 1, 2)}
    return (8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * step)


def param_steps(model):
    """Return a step for each parameter, relative to its value, or to that of the example if it is 0."""
    typical = np.where(model.params == 0, type(model).example().params, model.params)
    return 1e-4 * np.abs(typical)


def assert_jacobian(found, expected, rtol):
    """Compare (N, R, C) column by column, relative to the largest entry of the point and of the column."""
    error = np.abs(found - expected).max(axis=1)
    scale = np.abs(expected).max(axis=1)
    np.testing.assert_array_less(error, rtol * (scale + np.median(scale, axis=0)) + 1e-9)


@every_camera
def test_jacobian_by_the_point_matches_differences_and_ignores_scale(model):
    bearings = inside(model)
    points = bearings * np.random.default_rng(1).uniform(0.2, 5, (len(bearings), 1))
    pixels, valid, d_point, _ = model.project_with_jacobians(points)
    assert valid.all()
    np.testing.assert_allclose(pixels, model.project(points)[0], rtol=1e-12, atol=1e-10)
    reach = np.linalg.norm(points, axis=1, keepdims=True)
    along = np.einsum("nij,nj->ni", d_point, points)
    assert np.abs(along).max() <= 1e-11 * np.abs(d_point * reach[..., None]).max()
    expected = [central_difference(lambda h, e=e: model.project(points + h * reach * e)[0], 1e-4) for e in np.eye(3)]
    assert_jacobian(d_point * reach[..., None], np.stack(expected, -1), 1e-7)


@every_camera
def test_jacobian_by_the_point_alone_is_the_same(model):
    points = 2.0 * inside(model)
    for alone, value in zip(
        model.project_with_point_jacobian(points), model.project_with_jacobians(points), strict=False
    ):
        np.testing.assert_array_equal(alone, value)


@every_camera
def test_jacobian_by_the_parameters_matches_differences(model):
    bearings = inside(model)
    *_, d_params = model.project_with_jacobians(bearings)
    steps = param_steps(model)
    expected = [
        central_difference(lambda h, e=e: model.with_params(model.params + h * e).project(bearings)[0], 1.0) / e.sum()
        for e in np.diag(steps)
    ]
    assert_jacobian(d_params * steps, np.stack(expected, -1) * steps, 1e-6)


@every_camera
def test_jacobians_of_unproject_match_differences(model):
    pixels, _ = model.project(inside(model))
    bearings, valid, d_pixel, d_params = model.unproject_with_jacobians(pixels)
    assert valid.all()
    # A bearing moves on the sphere.
    assert np.abs(np.einsum("ni,nij->nj", bearings, d_pixel)).max() < 1e-12
    expected = [central_difference(lambda h, e=e: model.unproject(pixels + h * e)[0], 1e-2) for e in np.eye(2)]
    assert_jacobian(100 * d_pixel, 100 * np.stack(expected, -1), 1e-6)
    steps = param_steps(model)
    expected = [
        central_difference(lambda h, e=e: model.with_params(model.params + h * e).unproject(pixels)[0], 1.0) / e.sum()
        for e in np.diag(steps)
    ]
    assert_jacobian(d_params * steps, np.stack(expected, -1) * steps, 1e-5)
