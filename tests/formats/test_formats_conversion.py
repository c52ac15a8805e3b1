"""One camera in the terms of any other model: either it comes near, or it is refused with how far off it is."""

from functools import cache

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.conversion import DENSE_GRID, MIN_DENSE_SAMPLES, convert_model, flip_frame, max_convertible_theta
from omnisight.formats import format_names, get_format, save
from omnisight.models import model_class, model_names

CONE = np.radians(25)
NEAR_PX = 1.0


FISHEYES = ("kannala_brandt", "ocam", "fisheye624", "thin_prism_fisheye", "mei", "eucm", "double_sphere")
SLOW = ("rational", "spline")  # a fit takes a second or more: fitted to one fisheye only


@cache
def narrow(model):
    """Return the example of a model, calibrated over a narrow cone."""
    return Camera(model_class(model).example(), (960, 720), theta_max=CONE)


@pytest.mark.parametrize("source", model_names())
def test_reported_conversion_error_holds_for_every_model_pair(source):
    camera, refused = narrow(source), {}
    rng = np.random.default_rng(5)
    bearings, pixels = camera.samples()
    if len(bearings) < MIN_DENSE_SAMPLES:
        bearings, pixels = camera.samples(None, DENSE_GRID)
    for target in model_names():
        if target in SLOW and source != FISHEYES[0]:
            continue
        try:
            found = convert_model(camera, target)
        except ValueError as error:
            refused[target] = str(error)
            continue
        assert 0 <= found.rms_px <= found.max_px, target
        assert found.camera.model.name == target
        # The reported maximum holds at the samples, and approximately between them.
        projected, valid = found.camera.model.project_numpy(bearings)
        errors = np.linalg.norm(projected - pixels, axis=1)
        assert np.max(np.where(valid, errors, np.inf)) == pytest.approx(found.max_px, abs=1e-9), target
        if found.max_px > NEAR_PX:
            assert found.worst_theta <= CONE + 1e-9, target
            continue
        theta, phi = CONE * 0.9 * np.sqrt(rng.uniform(0, 1, 300)), rng.uniform(0, 2 * np.pi, 300)
        between = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
        expected, valid = camera.project(between)
        use = valid & camera.in_image(expected)
        projected, valid = found.camera.project(between[use])
        assert valid.all(), target
        assert np.linalg.norm(projected - expected[use], axis=1).max() < 2 * found.max_px + 1e-3, target
    assert all(f"{target} cannot be fitted to" in message for target, message in refused.items()), refused
    assert len(refused) < 3


@pytest.mark.parametrize("target", FISHEYES)
@pytest.mark.parametrize("source", ["kannala_brandt", "ocam", "radial_polynomial"])
def test_fisheyes_represent_each_other_over_a_hundred_degrees(source, target):
    camera = Camera(model_class(source).example(), (960, 720), theta_max=np.radians(50))
    assert convert_model(camera, target).max_px < NEAR_PX


def test_worst_theta_of_model_with_smaller_domain():
    camera = Camera(model_class("equidistant").example(), (960, 720), theta_max=np.radians(110))
    found = convert_model(camera, "radial_tangential")
    assert found.max_px == np.inf
    assert found.rms_px == np.inf
    assert np.radians(20) < found.worst_theta <= np.radians(91)


def test_max_convertible_theta_is_largest_valid_angle():
    camera = Camera(model_class("kannala_brandt").example(), (960, 960))
    widest = max_convertible_theta(camera, "equidistant", 0.5)
    assert convert_model(camera, "equidistant", theta_max=widest).max_px <= 0.5
    assert convert_model(camera, "equidistant", theta_max=widest + np.radians(6)).max_px > 0.5
    assert max_convertible_theta(camera, "equidistant", 1e-9) is None


def test_narrow_conversion_limits_calibrated_theta():
    camera = Camera(model_class("ocam").example(), (1024, 768), theta_max=np.radians(80))
    found = convert_model(camera, "eucm", theta_max=np.radians(40))
    assert found.camera.theta_max == np.radians(40)
    assert found.camera.provenance["conversion_max_px"] == found.max_px


# The camera of each format that a converted fisheye comes to: what is written reads back.
@pytest.mark.parametrize("name", sorted(set(format_names()) - {"woodscape"}))
def test_fisheye_converts_to_every_format(name, tmp_path):
    camera = Camera(model_class("equidistant")(300.0, 300.0, 479.5, 359.5), (960, 720), theta_max=np.radians(40))
    near = []
    for model in get_format(name).MODELS:
        try:
            found = convert_model(camera, model)
            if found.max_px < NEAR_PX:
                near.append(save(found.camera, tmp_path / "c", format=name).error_px)
        except ValueError:
            continue
    assert near
    assert min(near) < 1e-3  # a polynomial of four coefficients in place of more


@pytest.mark.parametrize("name", model_names())
def test_a_flipped_camera_sees_the_mirror_image_of_the_world(name):
    model = model_class(name).example()
    camera = Camera(model, (1000, 800), covariance=np.diag(np.arange(1.0, len(model.params) + 1)))
    if name in ("ocam", "spline"):
        with pytest.raises(ValueError, match="exchanges left and right"):
            flip_frame(camera)
        return
    flipped = flip_frame(camera)
    bearings, pixels = camera.samples()
    projected, valid = flipped.project(bearings * (-1, 1, 1))
    assert valid.all()
    np.testing.assert_allclose(projected, pixels, atol=1e-9)
    assert flipped != camera
    assert flip_frame(flipped) == camera
    assert np.array_equal(np.diag(flipped.covariance), np.diag(camera.covariance))
