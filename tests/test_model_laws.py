"""What every camera model must do. A new model is tested by existing: nothing here lists them."""

import dataclasses
import re

import numpy as np
import pytest

from omnisight.models import CameraModel, model_class, model_names

# Shapes on which formulas change their form or lose a term, beside the example and cameras near it.
EDGES = {
    "division": [{"k": 0.0}, {"k": 1e-9}, {"k": 0.05}, {"k": -2.0}],
    "double_sphere": [
        {"xi": 0.0, "alpha": 0.0},
        {"xi": 0.0, "alpha": 0.5},
        {"xi": 0.3, "alpha": 0.2},
        {"xi": 1.4, "alpha": 0.6},
    ],
    "eucm": [{"alpha": 0.0}, {"alpha": 0.5, "beta": 2.0}, {"alpha": 0.3, "beta": 0.5}, {"alpha": 0.9}],
    "fisheye624": [{f"k{i}": 0.0 for i in range(1, 7)}],
    "fov": [{"omega": 0.05}, {"omega": np.pi / 2}, {"omega": 3.0}],
    "kannala_brandt": [
        {"k1": 0.0, "k2": 0.0, "k3": 0.0, "k4": 0.0},
        {"k1": 0.1, "k2": 0.05, "k3": 0.01, "k4": 0.001},
        {"k1": -0.15, "k2": 0.0, "k3": 0.0, "k4": 0.0},
    ],
    "mei": [
        {"xi": 1.0},
        {"xi": 0.6},
        {"xi": 2.2},
        {"xi": 1.8, "k1": 0.1, "k2": 0.0},
        {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0},
    ],
    "ocam": [{"a2": 0.0, "a3": 0.0, "a4": 0.0}, {"a2": -2.1e-3, "a3": 0.0, "a4": 0.0}],
    "panini": [{"d": 0.0}, {"d": 1.0}, {"d": 2.5}],
    "radial_tangential": [{"k1": 0.1, "k2": 0.02, "k3": 0.0}],
    "thin_prism_fisheye": [dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2", "s1", "s2"), 0.0)],
    "unified": [{"xi": xi} for xi in (-0.4, 0.0, 1.0, 1.000001, 2.5)],
}


def cameras(name):
    """Give the example, three cameras near it, and those of `EDGES`."""
    example = model_class(name).example()
    rng = np.random.default_rng(sum(name.encode()))
    yield example
    for _ in range(3):
        size = [0.05 if re.fullmatch(r"a\d+", p.name) else 0.2 for p in example.parameters]
        params = example.params * (1 + size * rng.uniform(-1, 1, len(size)))
        yield example.with_params(np.clip(params, *bounds(example)))
    for edge in EDGES.get(name, ()):
        yield type(example).from_dict(example.to_dict() | edge)


def bounds(model):
    return [p.low for p in model.parameters], [p.high for p in model.parameters]


CAMERAS = [pytest.param(camera, id=f"{name}-{i}") for name in model_names() for i, camera in enumerate(cameras(name))]
EXAMPLES = [pytest.param(model_class(name).example(), id=name) for name in model_names()]
every_camera = pytest.mark.parametrize("model", CAMERAS)
every_model = pytest.mark.parametrize("model", EXAMPLES)

AZIMUTHS = np.linspace(-np.pi, np.pi, 24, endpoint=False) + 0.05


def direction(theta, phi):
    """Give bearings (..., 3) from angles off the axis and azimuths."""
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def rim(model):
    """Give the angle where the valid domain ends, by azimuth: halved down between the axis and its opposite."""
    low, high = np.zeros_like(AZIMUTHS), np.full_like(AZIMUTHS, np.pi)
    low[model.project(direction(high, AZIMUTHS))[1]] = np.pi
    for _ in range(60):
        middle = (low + high) / 2
        valid = model.project(direction(middle, AZIMUTHS))[1]
        low, high = np.where(valid, middle, low), np.where(valid, high, middle)
    return low


def to_the_rim(model):
    """Give bearings (N, 3) over the valid domain but its last millionth, dense towards its rim and its axis."""
    share = np.concatenate(
        [np.linspace(0, 1, 90, endpoint=False), np.geomspace(1e-9, 1e-2, 15), 1 - np.geomspace(1e-6, 1e-2, 15)]
    )
    return direction(share[:, None] * rim(model), AZIMUTHS).reshape(-1, 3)


def inside(model, share=0.9, count=60):
    """Give bearings (count, 3) well inside the valid domain, near the axis and far from it."""
    rng = np.random.default_rng(7)
    which = rng.integers(len(AZIMUTHS), size=count)
    bearings = direction(rng.uniform(0, share, count) * rim(model)[which], AZIMUTHS[which])
    # On the axis, but where r(theta) is bent there and has no second derivative.
    bearings[0] = direction(0.01 if model.name == "radial_polynomial" else 0.0, 0.3)
    return bearings


def angle(a, b):
    """Give the angles between bearings, exact for small ones."""
    return 2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=-1) / 2, 1))


def central_difference(function, step):
    """Differentiate f(h) at h = 0 to fourth order in the step."""
    f = {k: function(k * step) for k in (-2, -1, 1, 2)}
    return (8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * step)


def param_steps(model):
    """Give a step for each parameter: a share of it, or where it is 0 of what it is in the example."""
    typical = np.where(model.params == 0, type(model).example().params, model.params)
    return 1e-4 * np.abs(typical)


def assert_jacobian(found, expected, rtol):
    """Compare (N, R, C) column by column, relative to the largest entry of the point and of the column."""
    error = np.abs(found - expected).max(axis=1)
    scale = np.abs(expected).max(axis=1)
    np.testing.assert_array_less(error, rtol * (scale + np.median(scale, axis=0)) + 1e-9)


# -- there and back ---------------------------------------------------------------------------------------------


@every_camera
def test_round_trip_over_the_whole_valid_sphere(model):
    bearings = to_the_rim(model)
    pixels, valid = model.project(bearings)
    assert valid.all()
    assert np.isfinite(pixels).all()
    back, seen = model.unproject(pixels)
    assert seen.all()
    np.testing.assert_allclose(np.linalg.norm(back, axis=-1), 1, atol=1e-14)
    assert angle(back, bearings).max() < 1e-9


@every_camera
def test_pixels_come_back_where_a_bearing_exists(model):
    centre = model.project([0, 0, 1])[0]
    extent = np.nanmax(np.abs(model.project(inside(model))[0] - centre))
    u, v = np.meshgrid(*2 * [np.linspace(-1.5, 1.5, 41) * extent])
    pixels = np.stack([u, v], -1) + centre
    bearings, valid = model.unproject(pixels)
    assert valid.any()
    back, seen = model.project(bearings[valid])
    # A pixel on the very rim may fall to either side of it.
    assert seen.mean() > 0.999
    np.testing.assert_allclose(back[seen], pixels[valid][seen], rtol=1e-12, atol=1e-8)


@every_camera
def test_valid_is_one_domain_around_the_axis(model):
    limit = rim(model)
    assert limit.min() > 0.1
    assert limit.max() <= model.theta_max + 1e-6
    assert model.project(direction(np.linspace(0, 1 - 1e-6, 200)[:, None] * limit, AZIMUTHS))[1].all()
    outside = limit < np.pi - 1e-3
    beyond = limit + (np.pi - limit) * np.linspace(1e-3, 1, 200)[:, None]
    assert not model.project(direction(beyond, AZIMUTHS)[:, outside])[1].any()


@every_camera
def test_two_bearings_have_two_pixels(model):
    # Along each azimuth the picture never turns back: the pixels' path keeps going outward.
    share = np.linspace(0.001, 0.999, 300)[:, None]
    *_, d_point, _ = model.project_with_jacobians(direction(share * rim(model), AZIMUTHS))
    bearings = direction(share * rim(model), AZIMUTHS)
    # The volume that (pixel, bearing) spans keeps its sign exactly while the map is one-to-one.
    volume = np.linalg.det(np.concatenate([d_point, bearings[..., None, :]], -2))
    assert (volume > 0).all() or (volume < 0).all()


@every_camera
def test_scale_of_a_point_does_not_matter(model):
    bearings = inside(model)
    pixels, _ = model.project(bearings)
    for scale in (1e-12, 1e-3, 7.0, 1e12):
        scaled, valid = model.project(scale * bearings)
        assert valid.all()
        np.testing.assert_allclose(scaled, pixels, rtol=1e-11, atol=1e-9)


# -- derivatives ------------------------------------------------------------------------------------------------


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


# -- what may come in -------------------------------------------------------------------------------------------


@every_model
@pytest.mark.parametrize("lead", [(), (5,), (2, 3, 4), (0,), (3, 0, 2)])
def test_any_leading_shape_comes_back(model, lead):
    count = int(np.prod(lead))
    points = inside(model, count=60)[:count].reshape(*lead, 3)
    pixels, valid = model.project(points)
    assert pixels.shape == (*lead, 2)
    assert valid.shape == lead
    assert pixels.dtype == float
    assert valid.dtype == bool
    bearings, seen = model.unproject(pixels)
    assert bearings.shape == (*lead, 3)
    assert seen.shape == lead
    shapes = [a.shape for a in model.project_with_jacobians(points)]
    assert shapes == [(*lead, 2), lead, (*lead, 2, 3), (*lead, 2, model.params.size)]
    shapes = [a.shape for a in model.unproject_with_jacobians(pixels)]
    assert shapes == [(*lead, 3), lead, (*lead, 3, 2), (*lead, 3, model.params.size)]
    # Each point is on its own: the shape around it changes nothing.
    flat = model.project(points.reshape(-1, 3))[0]
    np.testing.assert_array_equal(pixels, flat.reshape(pixels.shape))


@every_model
def test_any_real_type_comes_in_and_stays_as_it_is(model):
    points = np.array([[1, 2, 9], [-2, 1, 8], [0, 0, 3]])
    expected, _ = model.project(points.astype(float))
    for given in (points, points.astype(np.float32), points.astype(np.int16), points.tolist(), points[::-1][::-1]):
        kept = np.array(given)
        pixels, valid = model.project(given)
        assert valid.all()
        np.testing.assert_array_equal(pixels, expected)
        np.testing.assert_array_equal(given, kept)
    locked = points.astype(float)
    locked.flags.writeable = False
    model.project(locked)
    model.unproject(np.asfortranarray(expected))


@every_model
@pytest.mark.parametrize("method", ["project", "project_with_jacobians", "unproject", "unproject_with_jacobians"])
@pytest.mark.parametrize("given", [np.zeros((3, 4)), np.zeros(5), 1.0, None, "abc", [["a", "b", "c"]], [[1j, 0, 1]]])
def test_what_is_no_array_of_points_is_refused_by_name(model, method, given):
    what, width = ("points", 3) if method.startswith("project") else ("pixels", 2)
    received = re.escape(str(np.shape(given)))
    with pytest.raises(ValueError, match=rf"{what} .*\(\.\.\., {width}\).*{received}"):
        getattr(model, method)(given)


@every_camera
def test_no_direction_warns_and_what_is_not_valid_is_nan(model):
    theta = np.radians([0, 1e-9, 45, 90 - 1e-6, 90 + 1e-6, 120, 179.99, 180 - 1e-6])[:, None]
    odd = [[0, 0, 0], [np.nan, 0, 1], [0, 0, np.inf], [-np.inf, 1, 1]]
    aside = [[1, 0, 0], [0, 1, 0], [-3, -4, 0], [0, 0, -1], [0.0, -0.0, -2]]
    points = np.concatenate([direction(theta, AZIMUTHS).reshape(-1, 3), aside, odd])
    far = np.array([[np.nan, 0], [np.inf, 0], [1e300, -1e300], [1e6, 1e6], [-1e6, 0]])
    with np.errstate(all="raise", under="ignore"):
        pixels, valid, *jacobians = model.project_with_jacobians(points)
        assert not valid[-len(odd) :].any()
        back, seen, *derivatives = model.unproject_with_jacobians(far)
        for answer in (model.project(points), model.project_numpy(points)):
            np.testing.assert_array_equal(answer[1], valid)
        for answer in (model.unproject(far), model.unproject_numpy(far)):
            np.testing.assert_array_equal(answer[1], seen)
    # Straight up and down a panorama has a pixel, but no derivative.
    smooth = valid & (np.hypot(points[:, 0], points[:, 2]) > 0)
    for array in (pixels, *jacobians):
        assert np.isnan(array[~valid]).all()
        assert np.isfinite(array[smooth]).all()
    for array in (back, *derivatives):
        assert np.isnan(array[~seen]).all()


@every_camera
def test_compiled_and_plain_agree(model):
    bearings = to_the_rim(model)
    pixels, valid = model.project(bearings)
    plain, plain_valid = model.project_numpy(bearings)
    np.testing.assert_array_equal(valid, plain_valid)
    differentiated, _, d_point, _ = model.project_with_jacobians(bearings)
    # Where the picture goes to infinity, what a change of the bearing by 1e-10 rad makes in it.
    rounding = 1e-10 + 1e-10 * np.abs(d_point).max(axis=2)
    assert (np.abs(pixels - plain) < rounding).all()
    assert (np.abs(pixels - differentiated) < rounding).all()
    back, seen = model.unproject(pixels)
    plain_back, plain_seen = model.unproject_numpy(pixels)
    np.testing.assert_array_equal(seen, plain_seen)
    assert angle(back, plain_back).max() < 1e-9


# -- the camera as a value --------------------------------------------------------------------------------------


@every_model
def test_a_camera_is_a_frozen_value(model):
    assert dataclasses.is_dataclass(model)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(model, dataclasses.fields(model)[0].name, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        model.params[0] = 1.0
    assert model == type(model).example()
    assert hash(model) == hash(type(model).example())
    assert type(model).name in model_names()
    assert isinstance(model, CameraModel)


@every_model
def test_dictionary_and_vector_bring_the_camera_back(model):
    assert type(model).from_dict(model.to_dict()) == model
    assert tuple(model.to_dict()) == model.param_names
    assert model.with_params(model.params) == model
    other = model.with_params(model.params + 1)
    np.testing.assert_array_equal(other.params, model.params + 1)
    for wrong in (model.params[:-1], np.append(model.params, 0.0), model.params[None]):
        with pytest.raises(ValueError, match=rf"{model.name} has {model.params.size} parameters.*{wrong.shape[0]}"):
            model.with_params(wrong)


@every_model
def test_a_wrong_dictionary_is_refused_by_name(model):
    cls, good = type(model), model.to_dict()
    first = model.param_names[0]
    with pytest.raises(ValueError, match=f"{cls.name}.*missing.*{first}"):
        cls.from_dict({n: v for n, v in good.items() if n != first})
    with pytest.raises(ValueError, match=f"{cls.name}.*zoom"):
        cls.from_dict(good | {"zoom": 2.0})
    for bad in (np.nan, np.inf, True, None, "1", [1.0]):
        with pytest.raises(ValueError, match=f"{cls.name}.{first}.*finite"):
            cls.from_dict(good | {first: bad})


@every_model
def test_parameters_say_what_they_are(model):
    low, high = bounds(model)
    assert (low <= model.params).all()
    assert (model.params <= high).all()
    for p in model.parameters:
        assert len(p.doc) > 5
        assert p.unit in ("", "px")
    assert len(set(model.param_names)) == model.params.size


@every_model
def test_the_docs_hold_equations(model):
    doc = type(model).__doc__
    assert re.search(r"\b\w+'? = ", doc)
    assert "alid" in doc


@every_model
def test_fit_recovers_the_example(model):
    share = 0.9 if model.theta_max > np.pi / 2 else np.radians(80) / model.theta_max
    rng = np.random.default_rng(3)
    which = rng.integers(len(AZIMUTHS), size=500)
    limit = np.minimum(rim(model)[which], share * model.theta_max)
    bearings = direction(limit * np.sqrt(rng.uniform(0, 1, 500)) * 0.999, AZIMUTHS[which])
    pixels, valid = model.project(bearings)
    assert valid.all()
    fitted = type(model).fit(bearings, pixels)
    again, seen = fitted.project(bearings)
    assert seen.all()
    assert np.abs(again - pixels).max() < 1e-6


def test_an_unknown_model_is_refused_with_the_names():
    with pytest.raises(ValueError, match=r"unknown camera model 'pinhol'.*pinhole"):
        model_class("pinhol")
