"""The visual compass on panoramas whose rotation is known."""

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.places.panorama_rotation import OVERSAMPLING, correlations, estimate_rotation, wrap_deg
from omnisight.places.panorama_signature import PanoramaSignature
from omnisight.places.visual_compass import VisualCompass
from omnisight.simulation import Renderer, mirror_setup, scene_named
from omnisight.views import Remapper

WIDTH, HEIGHT = 120, 25


def textured(seed=0, width=WIDTH, height=HEIGHT):
    """Return a smooth periodic random panorama, 40 to 220."""
    noise = np.random.default_rng(seed).standard_normal((height, 3 * width))
    noise[:, width:] = np.tile(noise[:, :width], 2)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)[:, width : 2 * width]
    return 130 + 90 * smooth / np.abs(smooth).max()


def rolled(image, columns):
    """Return a panorama rolled left by columns, which may be a fraction, by the shift theorem."""
    spectrum = np.fft.rfft(image, axis=1)
    phase = np.exp(2j * np.pi * np.arange(spectrum.shape[1]) * columns / image.shape[1])
    return np.fft.irfft(spectrum * phase, n=image.shape[1], axis=1)


def rotation(query, reference):
    return estimate_rotation(PanoramaSignature(query), PanoramaSignature(reference))


def render(yaw_deg, place, width=240):
    pose = om.Pose(so3.exp([0.0, np.radians(yaw_deg), 0.0]), np.array(place, float))
    return Renderer(om.sphere(width), pose, scene_named("room"), samples=1)().image


@pytest.mark.parametrize("columns", [0, 1, 17, 60, 90, 119])
def test_a_panorama_rolled_left_by_whole_columns(columns):
    image = textured().astype(np.uint8)
    found = rotation(np.roll(image, -columns, axis=1), image)
    assert wrap_deg(found.yaw_deg - 360 * columns / WIDTH) == pytest.approx(0, abs=1e-6)
    assert found.sigma_deg < 1e-6
    assert found.similarity == pytest.approx(1)


@pytest.mark.parametrize("columns", [0.25, 7.5, 33.1, -20.37])
def test_a_panorama_rolled_by_a_fraction_of_a_column(columns):
    image = textured()
    found = rotation(rolled(image, columns), image)
    assert wrap_deg(found.yaw_deg - 360 * columns / WIDTH) == pytest.approx(0, abs=0.02)


@pytest.mark.parametrize("size", [(120, 25), (121, 30), (16, 4), (9, 1)])
def test_any_size_also_odd_widths(size):
    image = textured(1, *size)
    found = rotation(np.roll(image, -3, axis=1), image)
    assert found.yaw_deg == pytest.approx(wrap_deg(3 * 360 / size[0]), abs=1e-6)


def test_increasing_functions_of_the_gray_values_change_nothing():
    image, columns = textured(), 31
    query = np.roll(image, -columns, axis=1)
    expected = rotation(query, image)
    for changed in (0.3 * query + 60, np.sqrt(query), query**3):
        assert rotation(changed, image) == pytest.approx(expected, abs=1e-9)


def masked(image, first, last, level):
    changed = image.copy()
    changed[:, first:last] = level
    return changed


@pytest.mark.parametrize("level", [0, 130, 255])
@pytest.mark.parametrize("is_reference_masked", [False, True])
def test_half_of_the_panorama_may_be_masked(level, is_reference_masked):
    image, columns = textured(), 30
    query = masked(np.roll(image, -columns, axis=1), 20, 80, level)
    reference = masked(image, 20, 80, level) if is_reference_masked else image
    found = rotation(query, reference)
    error = abs(found.yaw_deg - 90)
    assert error < 1.0  # a third of a column; the ranks are those of other columns
    assert error < 3 * found.sigma_deg + 1e-6
    others = [textured(seed) for seed in range(1, 6)]
    compass = VisualCompass([PanoramaSignature(each) for each in (*others, reference)])
    assert compass.locate(PanoramaSignature(query))[0] == len(others)


def test_correlations_of_common_columns_equal_those_of_their_definition():
    image = textured()
    query, reference = (
        PanoramaSignature(masked(each, *columns, 0))
        for each, columns in ((np.roll(image, -13, axis=1), (10, 40)), (image, (70, 115)))
    )
    found = correlations(query, [reference])[0, ::OVERSAMPLING]
    common = [query.observed & np.roll(reference.observed, -k) for k in range(WIDTH)]
    most = max(each.sum() for each in common)
    for k, both in enumerate(common):
        a, b = (each[:, both] for each in (query.values, np.roll(reference.values, -k, axis=1)))
        a, b = (each - each.mean(axis=1, keepdims=True) for each in (a, b))
        true = (a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())
        expected = np.sign(true) * np.sqrt(1 - (1 - true**2) ** (both.sum() / most))
        assert found[k] == pytest.approx(expected, abs=2e-3)


def test_columns_of_an_unmasked_panorama_are_observed():
    assert PanoramaSignature(textured()).observed.all()
    stripes = np.repeat(np.repeat([20, 200], 30)[None, :], 10, axis=0)
    assert PanoramaSignature(stripes).observed.all()  # nothing else is seen
    mask = masked(textured(), 5, 20, 7)
    assert np.flatnonzero(~PanoramaSignature(mask).observed).tolist() == list(range(5, 20))


def test_the_standard_deviation_is_that_of_the_errors():
    rng, image, columns = np.random.default_rng(3), textured(), 12.3
    query = rolled(image, columns)
    found = [rotation(query + rng.normal(0, 25, query.shape), image) for _ in range(300)]
    errors = np.array([wrap_deg(each.yaw_deg - 360 * columns / WIDTH) for each in found])
    stated = np.sqrt(np.mean([each.sigma_deg**2 for each in found]))
    assert 0.05 < stated < 1
    assert np.std(errors) == pytest.approx(stated, rel=0.18)
    assert np.mean(np.abs(errors) < 3 * np.array([each.sigma_deg for each in found])) > 0.97


def test_repeated_surroundings_are_uncertain():
    one = textured(4, WIDTH // 2)
    image = np.concatenate([one, one], axis=1)
    noise = np.random.default_rng(0).normal(0, 3, image.shape)
    assert rotation(image + noise, image).sigma_deg > 90


def test_light_from_one_side_affects_neither_the_heading_nor_its_uncertainty():
    azimuth = 2 * np.pi * np.arange(240) / 240
    errors, sigmas = [], []
    gray = cv2.cvtColor(render(0, (0, 0, 0)), cv2.COLOR_RGB2GRAY)
    for phase in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        near = cv2.cvtColor(render(50, (0.04 * np.sin(phase), 0, 0.04 * np.cos(phase))), cv2.COLOR_RGB2GRAY)
        found = rotation(near * (1 + 0.5 * np.cos(azimuth - phase)), gray)
        errors.append(abs(wrap_deg(found.yaw_deg - 50)))
        sigmas.append(found.sigma_deg)
    assert max(errors) < 0.5  # some above 90 with white residuals
    assert max(sigmas) < 1.0  # above 30 with white residuals
    assert (np.array(errors) < 3 * np.array(sigmas)).all()


def test_light_from_one_side_and_a_translation_are_part_of_the_uncertainty():
    rng = np.random.default_rng(3)
    azimuth = 2 * np.pi * np.arange(120) / 120
    deviations = []
    for phase in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        place, direction = rng.uniform(-1, 1, 2), rng.uniform(0, 2 * np.pi)
        moved = place + 0.5 * np.array([np.sin(direction), np.cos(direction)])
        before, after = (
            cv2.cvtColor(render(yaw, (x, 0, z), width=120), cv2.COLOR_RGB2GRAY)
            for yaw, (x, z) in ((0, place), (50, moved))
        )
        found = rotation(after * (1 + 0.5 * np.cos(azimuth - phase)), before)
        deviations.append(abs(wrap_deg(found.yaw_deg - 50)) / found.sigma_deg)
    assert max(deviations) < 3  # up to 37 if the differences were noise


def test_panoramas_with_nothing_in_common_are_uncertain():
    upper, lower = np.full((2, HEIGHT, WIDTH), 50.0)
    upper[3], lower[9] = textured(6)[3], textured(7)[9]
    upper[3] += 200
    lower[9] += 200
    assert rotation(upper, lower).sigma_deg == pytest.approx(360 / np.sqrt(12), rel=0.05)
    sigmas = [rotation(textured(2 * k), textured(2 * k + 1)).sigma_deg for k in range(10)]
    assert np.median(sigmas) > 30


def test_a_translation_shifts_the_heading_less_than_the_image_difference():
    rng = np.random.default_rng(5)
    ours, difference, inside = [], [], []
    reference = render(0, (0, 0, 0))
    for yaw in rng.uniform(-180, 180, 6):
        azimuth = rng.uniform(0, 2 * np.pi)
        query = render(yaw, (0.3 * np.sin(azimuth), 0, 0.3 * np.cos(azimuth)))
        found = om.compass_rotation(reference, query)
        error = abs(wrap_deg(found.yaw_deg - yaw))
        ours.append(error)
        inside.append(error < 3 * found.sigma_deg)
        a, b = (cv2.cvtColor(each, cv2.COLOR_RGB2GRAY).astype(float) for each in (reference, query))
        shifts = [np.mean((b - np.roll(a, -k, axis=1)) ** 2) for k in range(240)]
        difference.append(abs(wrap_deg(1.5 * float(np.argmin(shifts)) - yaw)))
    assert np.median(ours) < 1.5
    assert np.median(ours) < 0.5 * np.median(difference)
    assert all(inside)


def test_images_of_a_camera_are_unwrapped_about_the_vertical():
    setup = mirror_setup(360)
    camera = om.Camera(setup.camera.model, setup.camera.size, theta_min=setup.theta[0], theta_max=setup.theta[1])
    mount = setup.world_from_cam.rotation
    a, b = (
        Renderer(
            camera,
            om.Pose(so3.exp([0.0, np.radians(yaw), 0.0]) @ mount, np.zeros(3)),
            scene_named("room"),
            samples=1,
            theta=setup.theta,
        )()
        for yaw in (0.0, 40.0)
    )
    found = om.compass_rotation(a.image, b.image, camera)
    assert found.yaw_deg == pytest.approx(40, abs=0.3)
    b_from_a = mount.T @ so3.exp([0.0, np.radians(-40), 0.0]) @ mount
    level = om.look(up="back")
    assert found.deviation(b_from_a, level) < 4
    assert found.deviation(b_from_a.T, level) > 50


def test_images_of_one_size_share_the_map_to_a_panorama(monkeypatch):
    made = []

    def remapper(*arguments):
        made.append(Remapper(*arguments))
        return made[-1]

    monkeypatch.setattr("omnisight.pipeline.localization.compass_images.Remapper", remapper)
    image = cv2.resize(textured().astype(np.uint8), (128, 64))
    assert om.compass([image, np.roll(image, 5, axis=1), image], camera=om.sphere(128))
    assert len(made) == 1


def test_invalid_arguments():
    image = np.rint(textured()).astype(np.uint8)
    with pytest.raises(ValueError, match="image b: is uniform along its rows"):
        om.compass_rotation(image, np.full_like(image, 9))
    with pytest.raises(ValueError, match="image b: is 120x50 px, the first panorama 120x25"):
        om.compass_rotation(image, np.repeat(image, 2, axis=0))
    with pytest.raises(ValueError, match="specify the camera"):
        om.compass_rotation(image[:, :40], image)
    with pytest.raises(ValueError, match="needs at least 8 columns"):
        om.compass_rotation(image[:2, :4], image)
    with pytest.raises(ValueError, match="options must be CompassOptions"):
        om.compass(image, image, om.StereoOptions())
    with pytest.raises(ValueError, match="either files or arrays"):
        om.compass([image, "image.png"])
