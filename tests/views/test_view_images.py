"""The one remap and its images: their kinds, their edges, what is shrunk, and the maps that are kept."""

import itertools

import numpy as np
import pytest
from scenery import FISHEYE, INTERPOLATIONS, SPHERE, grid, image_of

import omnisight as om
from omnisight.camera import Camera
from omnisight.views.maps import map_scale, view_map, visible_fraction
from omnisight.views.remapper import magnification

DTYPES = [np.uint8, np.uint16, np.float32, np.float64]

# -- kinds of images -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shrink", [False, True])
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("channels", [(), (1,), (2,), (3,), (4,)])
@pytest.mark.parametrize("dtype", DTYPES)
def test_remap_keeps_the_type_and_constant_values(dtype, channels, interpolation, shrink):
    target = om.perspective((24, 20) if shrink else (120, 100), 70)
    value = {"u": np.iinfo(dtype).max - 3 if np.dtype(dtype).kind == "u" else 0, "f": 0.7}[np.dtype(dtype).kind]
    image = np.full((FISHEYE.height, FISHEYE.width, *channels), value, dtype)
    before = image.copy()
    image.flags.writeable = False
    view = om.remap(image, FISHEYE, target, om.look(yaw=20), interpolation=interpolation)
    assert view.dtype == dtype
    assert view.shape == (target.height, target.width, *channels)
    np.testing.assert_allclose(view.astype(float), float(value), rtol=1e-6)
    assert np.array_equal(image, before)


@pytest.mark.parametrize("view", [np.s_[::-1], np.s_[:, ::-1], np.s_[:, :, ::-1], np.s_[..., :1]])
def test_any_memory_layout_is_accepted(view):
    image = np.random.default_rng(0).integers(0, 256, (360, 400, 3), np.uint8)[view]
    target = om.perspective((60, 40), 70)
    assert np.array_equal(om.remap(image, FISHEYE, target), om.remap(image.copy(), FISHEYE, target))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((360, 400, 5), np.uint8), r"\(H, W\), \(H, W, 1 to 4\) or a batch .*, got shape \(360, 400, 5\)"),
        (np.zeros((400,), np.uint8), r"got shape \(400,\)"),
        (np.zeros((360, 400), np.int32), "uint8, uint16, float32 or float64, got int32"),
        (np.zeros((360, 400), bool), "got bool"),
    ],
)
def test_invalid_images_are_rejected(image, message):
    with pytest.raises(ValueError, match=message):
        om.remap(image, FISHEYE, om.perspective())


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((180, 200), "the image is 200x180, the camera 400x360: 0.5 times as large.*--scale-camera"),
        ((720, 800), "2 times as large; if the image was resized, scale the camera"),
        ((358, 400), "a different aspect ratio"),
        ((400, 360), "rotated by 90 degrees; images have the EXIF orientation only with --apply-exif: specify it if"),
        ((300, 400), "the image is 400x300, the camera 400x360: a different aspect ratio; a camera is valid only for"),
    ],
)
def test_image_of_another_size_is_rejected_with_the_remedy(shape, message):
    with pytest.raises(ValueError, match=message):
        om.remap(np.zeros(shape, np.uint8), FISHEYE, om.perspective())


def test_camera_without_a_size_is_rejected():
    unsized = Camera(FISHEYE.model, (0, 0))
    with pytest.raises(ValueError, match="the image is 400x360, and the camera file has no image size"):
        om.remap(np.zeros((360, 400), np.uint8), unsized, om.perspective())


@pytest.mark.parametrize("factor", [0.5, 2.0, 0.37])
def test_scaled_camera_fits_a_resized_image(factor):
    scaled = FISHEYE.scaled(factor)
    target, turn = om.perspective((80, 60), 80), om.look(yaw=15)
    first, second = (om.remap(image_of(of), of, target, turn, interpolation="bicubic") for of in (FISHEYE, scaled))
    assert np.abs(first - second).max() < 0.01


# -- edges -------------------------------------------------------------------------------------------------------


def test_uncovered_pixels_have_the_border_value():
    image = np.full((360, 400, 3), 200, np.uint8)
    target, turn = om.sphere(200), om.look()
    mask = om.Remapper(FISHEYE, target, turn).mask
    assert 0 < mask.mean() < 1
    assert (om.remap(image, FISHEYE, target, turn)[~mask] == 0).all()
    assert (om.remap(image, FISHEYE, target, turn, border=9)[~mask] == 9).all()
    assert (om.remap(image, FISHEYE, target, turn, border=(10, 20, 30))[~mask] == (10, 20, 30)).all()


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("border", ["edge", "reflect"])
def test_extrapolated_border_is_not_darker_at_the_edge(border, interpolation):
    source = om.perspective((100, 80), 80)
    target, turn = om.perspective((150, 120), 120), om.look(yaw=10.3, pitch=4.1)
    remapper = om.Remapper(source, target, turn, interpolation=interpolation, border=border)
    view = remapper(np.full((80, 100), 150, np.uint8))
    assert (view[remapper.mask] == 150).all()
    assert (view[~remapper.mask] == 0).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"interpolation": "cubic"}, "nearest, bilinear, bicubic, lanczos, got 'cubic'"),
        ({"border": "wrap"}, "a value, 'edge' or 'reflect', got 'wrap'"),
        ({"target_from_source": np.ones((3, 3))}, "orthogonal"),
        ({"target_from_source": np.eye(4)}, r"orthogonal \(3, 3\) matrix, got shape \(4, 4\)"),
        ({"target_from_source": np.full((3, 3), np.nan)}, "orthogonal"),
    ],
)
def test_unknown_options_are_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        om.Remapper(FISHEYE, om.perspective(), **options)


# -- smaller than the source -------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic", "lanczos"])
def test_fine_pattern_is_antialiased_without_moire(interpolation):
    source, target = om.perspective((808, 808), 90), om.perspective((101, 101), 90)
    columns, rows = np.arange(808)[None], np.arange(808)[:, None]
    image = np.where((columns // 3 + rows // 3) % 2 == 0, 255, 0).astype(np.uint8)
    inner = np.s_[4:-4, 4:-4]
    gray = om.remap(image, source, target, interpolation=interpolation)[inner].astype(float)
    assert gray.std() < 6
    assert gray.mean() == pytest.approx(127.5, abs=2)
    for raw in (
        om.remap(image, source, target, interpolation="nearest"),
        om.remap(image, source, target, interpolation=interpolation, antialias=False),
    ):
        assert raw[inner].std() > 40


@pytest.mark.parametrize("factor", [1.3, 2, 3, 5, 11])
def test_reduced_view_has_no_offset(factor):
    source = om.perspective((660, 660), 90)
    side = round(660 / factor)
    target = om.perspective((side, side), 90)
    view = om.remap(image_of(source), source, target)
    assert np.abs(view - image_of(target))[2:-2, 2:-2].max() < 0.004


def test_only_reduced_areas_are_averaged():
    # A wide perspective of a fisheye: its middle is enlarged, its rim is not.
    noise = np.random.default_rng(0).integers(0, 256, (360, 400), np.uint8)
    target = om.perspective((600, 400), 60)
    assert np.array_equal(om.remap(noise, FISHEYE, target), om.remap(noise, FISHEYE, target, antialias=False))


# -- kept maps and figures ---------------------------------------------------------------------------------------


def test_remapper_is_reusable():
    target, turn = om.perspective((90, 60), 100), om.look(yaw=30)
    remapper = om.Remapper(FISHEYE, target, turn, interpolation="bicubic")
    rng = np.random.default_rng(0)
    for dtype, channels in itertools.product((np.uint8, np.uint16, np.float32), ((), (3,), (4,))):
        image = (rng.random((360, 400, *channels)) * 200).astype(dtype)
        expected = om.remap(image, FISHEYE, target, turn, interpolation="bicubic")
        assert np.array_equal(remapper(image), expected)
        assert np.array_equal(remapper(image), expected)


def test_view_map_has_source_pixels_or_nan():
    target, turn = om.perspective((90, 60), 100), om.look(yaw=90)
    u, v = view_map(FISHEYE, target, turn)
    bearings, _ = target.unproject(grid(target.size))
    pixels, valid = FISHEYE.project(bearings @ turn)
    assert u.dtype == v.dtype == np.float32
    np.testing.assert_allclose(np.stack([u, v], -1), np.where(valid[..., None], pixels, np.nan), atol=2e-3)


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_magnification_is_the_size_of_a_source_pixel(factor):
    source = om.perspective((200, 160), 90)
    remapper = om.Remapper(source, om.perspective((round(200 * factor), round(160 * factor)), 90))
    found = magnification(source, remapper.target, np.eye(3))
    assert found == pytest.approx((factor, factor), rel=0.02)
    assert remapper.scale == pytest.approx((1 / factor, 1 / factor), rel=0.02)


def test_perspective_of_a_fisheye_is_stretched_at_its_edge():
    centre, rim = magnification(FISHEYE, om.perspective((400, 400), 140), np.eye(3))
    assert rim > 2 * centre


def test_visible_fraction_of_the_source():
    source = om.perspective((200, 200), 90)
    half = om.perspective((100, 100), 2 * np.degrees(np.arctan(0.5)))
    assert visible_fraction(source, source, np.eye(3)) == pytest.approx(1, abs=0.02)
    assert visible_fraction(source, half, np.eye(3)) == pytest.approx(0.25, abs=0.01)
    assert visible_fraction(source, half, om.look(yaw=180)) == 0


def test_scale_is_continuous_across_the_seam():
    u, v = view_map(SPHERE, SPHERE, om.look(yaw=90))
    assert np.nanmax(map_scale(SPHERE, u, v)) == pytest.approx(1, abs=0.01)
