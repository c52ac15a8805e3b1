"""Laws that hold for every registered camera model; a new model needs no change here."""

import re

import numpy as np
import pytest

from every_model import AZIMUTHS, direction, every_camera, every_model, inside, rim
from omnisight.models import model_class


def bearings_to_the_rim(model):
    """Return bearings (N, 3) over the valid domain except its last millionth, dense near its rim and its axis."""
    share = np.concatenate(
        [np.linspace(0, 1, 90, endpoint=False), np.geomspace(1e-9, 1e-2, 15), 1 - np.geomspace(1e-6, 1e-2, 15)]
    )
    return direction(share[:, None] * rim(model), AZIMUTHS).reshape(-1, 3)


def angle(a, b):
    """Return the angles between bearings, accurate for small angles too."""
    return 2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=-1) / 2, 1))


# -- round trips -----------------------------------------------------------------------------------------------


@every_camera
def test_round_trip_over_the_whole_valid_sphere(model):
    bearings = bearings_to_the_rim(model)
    pixels, valid = model.project(bearings)
    assert valid.all()
    assert np.isfinite(pixels).all()
    back, back_valid = model.unproject(pixels)
    assert back_valid.all()
    np.testing.assert_allclose(np.linalg.norm(back, axis=-1), 1, atol=1e-14)
    assert angle(back, bearings).max() < 1e-9


@every_camera
def test_valid_pixels_are_projected_again(model):
    centre = model.project([0, 0, 1])[0]
    extent = np.nanmax(np.abs(model.project(inside(model))[0] - centre))
    u, v = np.meshgrid(*2 * [np.linspace(-1.5, 1.5, 41) * extent])
    pixels = np.stack([u, v], -1) + centre
    bearings, valid = model.unproject(pixels)
    assert valid.any()
    back, back_valid = model.project(bearings[valid])
    # A pixel on the very rim may fall to either side of it.
    assert back_valid.mean() > 0.999
    np.testing.assert_allclose(back[back_valid], pixels[valid][back_valid], rtol=1e-12, atol=1e-8)


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
def test_distinct_bearings_have_distinct_pixels(model):
    # Along each azimuth the image never turns back: the pixels' path keeps going outward.
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


# -- what may come in -------------------------------------------------------------------------------------------


@every_model
@pytest.mark.parametrize("lead", [(), (5,), (2, 3, 4), (0,), (3, 0, 2)])
def test_any_leading_shape_is_preserved(model, lead):
    count = int(np.prod(lead))
    points = inside(model, count=60)[:count].reshape(*lead, 3)
    pixels, valid = model.project(points)
    assert pixels.shape == (*lead, 2)
    assert valid.shape == lead
    assert pixels.dtype == float
    assert valid.dtype == bool
    bearings, back_valid = model.unproject(pixels)
    assert bearings.shape == (*lead, 3)
    assert back_valid.shape == lead
    shapes = [a.shape for a in model.project_with_jacobians(points)]
    assert shapes == [(*lead, 2), lead, (*lead, 2, 3), (*lead, 2, model.params.size)]
    shapes = [a.shape for a in model.unproject_with_jacobians(pixels)]
    assert shapes == [(*lead, 3), lead, (*lead, 3, 2), (*lead, 3, model.params.size)]
    # Each point is on its own: the shape around it changes nothing.
    flat = model.project(points.reshape(-1, 3))[0]
    np.testing.assert_array_equal(pixels, flat.reshape(pixels.shape))


@every_model
def test_any_real_type_is_accepted_and_not_modified(model):
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
def test_invalid_arrays_are_rejected_by_name(model, method, given):
    what, width = ("points", 3) if method.startswith("project") else ("pixels", 2)
    received = re.escape(str(np.shape(given)))
    with pytest.raises(ValueError, match=rf"{what} .*\(\.\.\., {width}\).*{received}"):
        getattr(model, method)(given)


@every_camera
def test_no_direction_warns_and_invalid_entries_are_nan(model):
    theta = np.radians([0, 1e-9, 45, 90 - 1e-6, 90 + 1e-6, 120, 179.99, 180 - 1e-6])[:, None]
    odd = [[0, 0, 0], [np.nan, 0, 1], [0, 0, np.inf], [-np.inf, 1, 1]]
    aside = [[1, 0, 0], [0, 1, 0], [-3, -4, 0], [0, 0, -1], [0.0, -0.0, -2]]
    points = np.concatenate([direction(theta, AZIMUTHS).reshape(-1, 3), aside, odd])
    far = np.array([[np.nan, 0], [np.inf, 0], [1e300, -1e300], [1e6, 1e6], [-1e6, 0]])
    with np.errstate(all="raise", under="ignore"):
        pixels, valid, *jacobians = model.project_with_jacobians(points)
        assert not valid[-len(odd) :].any()
        back, back_valid, *derivatives = model.unproject_with_jacobians(far)
        for answer in (model.project(points), model.project_numpy(points)):
            np.testing.assert_array_equal(answer[1], valid)
        for answer in (model.unproject(far), model.unproject_numpy(far)):
            np.testing.assert_array_equal(answer[1], back_valid)
    # At its poles, on the y or the x axis, a panorama has a pixel, but no derivative.
    smooth = valid & (np.hypot(points[:, 0], points[:, 2]) > 0) & (np.hypot(points[:, 1], points[:, 2]) > 0)
    for array in (pixels, *jacobians):
        assert np.isnan(array[~valid]).all()
        assert np.isfinite(array[smooth]).all()
    for array in (back, *derivatives):
        assert np.isnan(array[~back_valid]).all()


@every_camera
def test_compiled_and_numpy_agree(model):
    bearings = bearings_to_the_rim(model)
    pixels, valid = model.project(bearings)
    plain, plain_valid = model.project_numpy(bearings)
    np.testing.assert_array_equal(valid, plain_valid)
    differentiated, _, d_point, _ = model.project_with_jacobians(bearings)
    # Where the image goes to infinity, what a change of the bearing by 1e-10 rad makes in it.
    rounding = 1e-10 + 1e-10 * np.abs(d_point).max(axis=2)
    assert (np.abs(pixels - plain) < rounding).all()
    assert (np.abs(pixels - differentiated) < rounding).all()
    back, back_valid = model.unproject(pixels)
    plain_back, plain_seen = model.unproject_numpy(pixels)
    np.testing.assert_array_equal(back_valid, plain_seen)
    assert angle(back, plain_back).max() < 1e-9


def test_the_rational_domain_ends_before_the_pole():
    """With d = 1/(1 - r^2/4) the radius of r = 2 is infinite."""
    focal = {"fx": 100.0, "fy": 100.0, "cx": 0.0, "cy": 0.0}
    model = model_class("rational")
    camera = model.from_dict(dict.fromkeys(model.example().param_names, 0.0) | focal | {"k4": -0.25})
    last = np.tan(camera.rim)
    assert 1 < last < 2
    r = last - np.array([1e-6, 0.0])
    radius = camera.project(np.stack([r * (1 - 1e-9), 0 * r, np.ones(2)], -1))[0][:, 0]
    assert np.diff(radius)[0] / 1e-6 == pytest.approx(4 * 100, rel=1e-3)
    assert not camera.project([1.001 * last, 0, 1])[1]
