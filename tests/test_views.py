"""The one remap and the cameras to remap to."""

import itertools

import numpy as np
import pytest

import omnisight as om
from omnisight.camera import Camera
from omnisight.models import model_class
from omnisight.views.maps import kept_share, map_scale, view_map
from omnisight.views.remapper import magnification
from omnisight.views.targets import CUBE_FACES, cube_rotation

INTERPOLATIONS = ["nearest", "bilinear", "bicubic", "lanczos"]
DTYPES = [np.uint8, np.uint16, np.float32, np.float64]


def camera(name, size, **values):
    return Camera(model_class(name).from_dict(values), size)


FISHEYE = camera(
    "kannala_brandt", (400, 360), fx=118.0, fy=117.0, cx=203.2, cy=177.6, k1=0.03, k2=-0.01, k3=0.002, k4=-0.0004
)
MIRROR = camera("unified", (320, 320), fx=90.0, fy=90.0, cx=161.0, cy=158.5, xi=0.96)
SPHERE = om.sphere(256)


def colour(bearings):
    """Give three smooth channels (..., 3) in 0 to 1 of bearings (..., 3); where they are NaN, 0."""
    x, y, z = np.moveaxis(bearings, -1, 0)
    waves = np.stack([np.sin(2 * x + y - 0.3), np.cos(2 * z - x + 0.2), np.sin(y * 2 + z * x + 1)], -1)
    return np.nan_to_num(0.5 + 0.45 * waves)


def grid(size):
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1).astype(float)


def picture(of, function=colour, turn=None):
    """Evaluate a function of the bearing through a camera; `turn` is target_from_source, the function the source's."""
    bearings, _ = of.unproject(grid(of.size))
    return function(bearings if turn is None else bearings @ turn).astype(np.float32)


def spot(azimuth, elevation, width=0.05):
    """Give a bright spot in a direction (degrees: right, up)."""
    a, e = np.radians([azimuth, elevation])
    towards = np.array([np.cos(e) * np.sin(a), -np.sin(e), np.cos(e) * np.cos(a)])
    return lambda bearings: np.exp((np.nan_to_num(bearings) @ towards - 1) / width**2)


def brightest(image):
    """Give the (column, row) of the brightest pixel."""
    row, column = np.unravel_index(np.argmax(image), image.shape)
    return int(column), int(row)


# -- where things go ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("source", [FISHEYE, MIRROR, SPHERE, om.perspective(80, (200, 150))])
def test_the_same_camera_gives_the_same_picture(source, interpolation):
    noise = np.random.default_rng(0).integers(0, 256, (source.height, source.width, 3), np.uint8)
    remapper = om.Remapper(source, source, interpolation=interpolation)
    assert np.array_equal(remapper(noise)[remapper.mask], noise[remapper.mask])
    shown = source.unproject(grid(source.size))[1]
    # A model's domain may end within the picture; there alone pixels are missing.
    assert (remapper.mask == shown).mean() > 0.999


@pytest.mark.parametrize("columns", [1, 64, 128, -37])
def test_a_whole_number_of_columns_rolls_a_360_picture(columns):
    noise = np.random.default_rng(0).integers(0, 65536, (128, 256), np.uint16)
    turn = om.look(yaw=columns * 360 / 256)
    assert np.array_equal(om.remap(noise, SPHERE, SPHERE, turn, interpolation="nearest"), np.roll(noise, -columns, 1))


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic", "lanczos"])
@pytest.mark.parametrize("shift", [0.25, 0.5, 100.3])
def test_the_seam_of_a_360_picture_does_not_show(interpolation, shift):
    source = om.sphere(512)
    turn = om.look(yaw=(256 + shift) * 360 / 512)  # the seam lands near the middle of the view
    remapper = om.Remapper(source, source, turn, interpolation=interpolation)
    view = remapper(picture(source)).astype(float)
    assert remapper.mask.all()
    assert np.abs(view - picture(source, turn=turn)).max() < 2e-3
    steps = np.abs(np.diff(view, axis=1, append=view[:, :1])).max((0, 2))
    seam = [256, 255, 254, 511 - 100, 511, 0]
    assert steps[seam].max() <= 1.05 * steps.max()
    rolled = np.abs(np.diff(view - picture(source, turn=turn), axis=1)).max((0, 2))
    assert rolled.max() < 3 * np.median(rolled) + 1e-4


@pytest.mark.parametrize("width", [64, 32, 16])
def test_the_seam_does_not_show_in_a_shrunk_360_picture(width):
    source, target = om.sphere(1024), om.sphere(width)
    turn = om.look(yaw=180.0)
    view = om.remap(picture(source), source, target, turn)
    error = np.abs(view - picture(target, turn=turn)).max(2)
    rows = slice(width // 8, -width // 8)  # at the poles a pixel of the view spans all longitudes
    seam = error[rows, width // 2 - 1 : width // 2 + 1]
    assert seam.max() < error[rows].max() * 1.01
    assert seam.max() < 1.5 * np.median(error[rows]) + 0.005


@pytest.mark.parametrize("source", [om.sphere(1024), FISHEYE])
@pytest.mark.parametrize(
    ("angles", "place"),
    [
        ({"yaw": 60}, (60, 0)),
        ({"yaw": -45}, (-45, 0)),
        ({"pitch": 50}, (0, 50)),
        ({"pitch": -30}, (0, -30)),
        ({"yaw": 40, "pitch": 35}, (40, 35)),
        ({"yaw": 40, "pitch": 35, "roll": 70}, (40, 35)),
    ],
)
def test_a_view_looks_where_it_is_told(source, angles, place):
    target, turn = om.perspective(60, (121, 91)), om.look(**angles)
    view = om.remap(picture(source, spot(*place, 0.1)), source, target, turn, interpolation="lanczos")
    assert brightest(view) == (60, 45)


def test_what_stands_at_the_right_of_a_360_picture_comes_to_the_middle_by_a_quarter_turn():
    view = om.remap(picture(SPHERE, spot(90, 0)), SPHERE, om.perspective(90, (101, 101)), om.look(yaw=90))
    assert brightest(view) == (50, 50)


@pytest.mark.parametrize(
    ("angles", "place", "side"),
    [
        ({}, (20, 0), "right"),
        ({}, (0, 20), "above"),
        ({"roll": 90}, (0, 20), "left"),  # the view turns clockwise, so what it shows turns the other way
        ({"roll": 90}, (20, 0), "above"),
        ({"roll": -90}, (0, 20), "right"),
        ({"flip": True}, (20, 0), "left"),
        ({"yaw": 180}, (160, 0), "left"),
    ],
)
def test_right_and_up_are_where_they_are_said_to_be(angles, place, side):
    view = om.remap(picture(SPHERE, spot(*place)), SPHERE, om.perspective(90, (101, 101)), om.look(**angles))
    column, row = brightest(view)
    off = round(50 * np.tan(np.radians(20)))
    at = {"right": (50 + off, 50), "left": (50 - off, 50), "above": (50, 50 - off), "below": (50, 50 + off)}[side]
    assert abs(column - at[0]) <= 1
    assert abs(row - at[1]) <= 1


@pytest.mark.parametrize(("up", "axis"), [("back", (0, -90)), ("front", (0, 90))])
def test_a_camera_that_looks_down_or_up_has_its_axis_at_the_bottom_or_top_of_a_panorama(up, axis):
    view = om.remap(picture(FISHEYE, spot(0, 0, 0.2)), FISHEYE, om.sphere(200), om.look(up=up))
    low = view[-3:] if axis[1] < 0 else view[:3]
    assert low.mean() > 0.9
    assert view[45:55].max() < 0.01


# -- against direct evaluation -----------------------------------------------------------------------------------

VIEWS = {
    "perspective": (om.perspective(100, (240, 160)), om.look(yaw=25, pitch=-15, roll=10)),
    "panini": (om.panini(140, (240, 140)), om.look(yaw=-10)),
    "cylinder": (om.cylinder(300, (-30, 30), (-60, 60)), om.look(pitch=5)),
    "mercator": (om.mercator(300, (-40, 40), (-60, 60)), om.look()),
    "sphere": (om.sphere(300, (-40, 40), (-60, 60)), om.look(roll=-20)),
    "cube face": (om.cube_face(180), om.look(yaw=20)),
    "fisheye": (om.fisheye(260, 140, "equisolid"), om.look(pitch=10)),
    "planet": (om.planet(200, 130), om.look()),
}


@pytest.mark.parametrize("name", VIEWS)
def test_a_view_of_a_fisheye_is_what_the_bearings_say(name):
    target, turn = VIEWS[name]
    remapper = om.Remapper(FISHEYE, target, turn, interpolation="bicubic", antialias=False)
    view = remapper(picture(FISHEYE))
    inside = remapper.mask.copy()
    inside[1:-1, 1:-1] &= inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    error = np.abs(view - picture(target, turn=turn)).max(2)
    assert np.median(error[inside]) < 1e-3
    assert np.quantile(error[inside], 0.99) < 5e-3
    assert inside.mean() > 0.5
    assert (view[~remapper.mask] == 0).all()


@pytest.mark.parametrize("name", VIEWS)
def test_the_mask_is_what_the_source_shows(name):
    target, turn = VIEWS[name]
    mask = om.Remapper(FISHEYE, target, turn).mask
    bearings, exists = target.unproject(grid(target.size))
    pixels, valid = FISHEYE.project(bearings @ turn)
    expected = exists & valid & FISHEYE.in_image(pixels)
    assert mask.dtype == bool
    # On the very edge float32 decides.
    assert (mask != expected).mean() < 1e-3


def test_a_view_past_the_sources_domain_is_empty_there_and_not_mirrored():
    front = om.perspective(90, (60, 40))
    back = om.Remapper(front, om.perspective(60, (50, 50)), om.look(yaw=180), border=7.0)
    assert not back.mask.any()
    assert (back(np.ones((40, 60), np.uint8)) == 7).all()


# -- the cube ----------------------------------------------------------------------------------------------------


def test_the_faces_of_a_cube_hold_every_direction_once():
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    face = om.cube_face(64)
    seen = [face.project(directions @ cube_rotation(name, np.eye(3)).T) for name in CUBE_FACES]
    assert np.array_equal(sum((valid & face.in_image(pixels)).astype(int) for pixels, valid in seen), np.ones(2000))


EDGES = {
    ("front", "right"): (np.s_[:, -1], np.s_[:, 0]),
    ("right", "back"): (np.s_[:, -1], np.s_[:, 0]),
    ("back", "left"): (np.s_[:, -1], np.s_[:, 0]),
    ("left", "front"): (np.s_[:, -1], np.s_[:, 0]),
    ("up", "front"): (np.s_[-1, :], np.s_[0, :]),
    ("front", "down"): (np.s_[-1, :], np.s_[0, :]),
    ("up", "right"): (np.s_[::-1, -1], np.s_[0, :]),
    ("left", "down"): (np.s_[-1, ::-1], np.s_[:, 0]),
}


@pytest.mark.parametrize("edge", EDGES, ids="-".join)
def test_neighbouring_faces_agree_along_their_edge(edge):
    source = om.sphere(1024)
    image, face = picture(source), om.cube_face(128)
    one, other = (om.remap(image, source, face, cube_rotation(name, np.eye(3))) for name in edge)
    along = EDGES[edge]
    assert np.abs(one[along[0]] - other[along[1]]).max() < 0.035  # a pixel apart
    assert np.abs(one[along[0]] - other[along[1]][::-1]).max() > 0.05  # and not the other way around


def test_a_360_picture_goes_to_a_cube_and_back():
    source, face = om.sphere(512), om.cube_face(256)
    image = picture(source)
    back, seen = np.zeros_like(image), np.zeros(image.shape[:2], int)
    for name in CUBE_FACES:
        turn = cube_rotation(name, np.eye(3))
        there = om.remap(image, source, face, turn, interpolation="bicubic")
        remapper = om.Remapper(face, source, turn.T, interpolation="bicubic", border="edge")
        back[remapper.mask] = remapper(there)[remapper.mask]
        seen += remapper.mask
    assert (seen >= 1).all()
    assert (seen > 1).mean() < 0.01
    assert np.abs(back - image).max() < 0.02
    assert np.abs(back - image).mean() < 5e-4


# -- kinds of pictures -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shrink", [False, True])
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("channels", [(), (1,), (2,), (3,), (4,)])
@pytest.mark.parametrize("dtype", DTYPES)
def test_every_kind_of_picture_keeps_its_type_and_a_flat_one_its_value(dtype, channels, interpolation, shrink):
    target = om.perspective(70, (24, 20) if shrink else (120, 100))
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
def test_a_picture_may_lie_in_memory_as_it_likes(view):
    image = np.random.default_rng(0).integers(0, 256, (360, 400, 3), np.uint8)[view]
    target = om.perspective(70, (60, 40))
    assert np.array_equal(om.remap(image, FISHEYE, target), om.remap(image.copy(), FISHEYE, target))


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (np.zeros((360, 400, 5), np.uint8), r"\(H, W\) or \(H, W, 1 to 4\), got shape \(360, 400, 5\)"),
        (np.zeros((400,), np.uint8), r"got shape \(400,\)"),
        (np.zeros((360, 400), np.int32), "uint8, uint16, float32 or float64, got int32"),
        (np.zeros((360, 400), bool), "got bool"),
    ],
)
def test_what_is_no_picture_is_refused_with_what_it_is(image, said):
    with pytest.raises(ValueError, match=said):
        om.remap(image, FISHEYE, om.perspective())


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ((180, 200), "the picture is 200x180, the camera 400x360: the same shape, 0.5 times as large.*--scale-camera"),
        ((720, 800), "2 times as large; if it was resized, scale the camera"),
        ((400, 360), "turned by 90 degrees; was its EXIF rotation applied"),
        ((300, 400), "the picture is 400x300, the camera 400x360: another shape; a camera is only valid for"),
    ],
)
def test_a_picture_of_another_size_is_refused_with_the_remedy(shape, said):
    with pytest.raises(ValueError, match=said):
        om.remap(np.zeros(shape, np.uint8), FISHEYE, om.perspective())


def test_a_camera_without_a_size_says_that_it_has_none():
    unsized = Camera(FISHEYE.model, (0, 0))
    with pytest.raises(ValueError, match="the picture is 400x360, and the camera's file does not say its size"):
        om.remap(np.zeros((360, 400), np.uint8), unsized, om.perspective())


@pytest.mark.parametrize("factor", [0.5, 2.0, 0.37])
def test_a_scaled_camera_fits_a_resized_picture(factor):
    scaled = FISHEYE.scaled(factor)
    target, turn = om.perspective(80, (80, 60)), om.look(yaw=15)
    first, second = (om.remap(picture(of), of, target, turn, interpolation="bicubic") for of in (FISHEYE, scaled))
    assert np.abs(first - second).max() < 0.01


# -- edges -------------------------------------------------------------------------------------------------------


def test_what_the_source_does_not_show_takes_the_border():
    image = np.full((360, 400, 3), 200, np.uint8)
    target, turn = om.sphere(200), om.look()
    mask = om.Remapper(FISHEYE, target, turn).mask
    assert 0 < mask.mean() < 1
    assert (om.remap(image, FISHEYE, target, turn)[~mask] == 0).all()
    assert (om.remap(image, FISHEYE, target, turn, border=9)[~mask] == 9).all()
    assert (om.remap(image, FISHEYE, target, turn, border=(10, 20, 30))[~mask] == (10, 20, 30)).all()


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("border", ["edge", "reflect"])
def test_a_continued_picture_is_not_darker_at_its_edge(border, interpolation):
    source = om.perspective(80, (100, 80))
    target, turn = om.perspective(120, (150, 120)), om.look(yaw=10.3, pitch=4.1)
    remapper = om.Remapper(source, target, turn, interpolation=interpolation, border=border)
    view = remapper(np.full((80, 100), 150, np.uint8))
    assert (view[remapper.mask] == 150).all()
    assert (view[~remapper.mask] == 0).all()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"interpolation": "cubic"}, "nearest, bilinear, bicubic, lanczos, got 'cubic'"),
        ({"border": "wrap"}, "a value, 'edge' or 'reflect', got 'wrap'"),
        ({"target_from_source": np.ones((3, 3))}, "orthogonal"),
        ({"target_from_source": np.eye(4)}, r"orthogonal \(3, 3\) matrix, got shape \(4, 4\)"),
        ({"target_from_source": np.full((3, 3), np.nan)}, "orthogonal"),
    ],
)
def test_an_option_that_is_none_is_refused(options, said):
    with pytest.raises(ValueError, match=said):
        om.Remapper(FISHEYE, om.perspective(), **options)


# -- smaller than the source -------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic", "lanczos"])
def test_a_fine_pattern_shrinks_to_gray_and_not_to_moire(interpolation):
    source, target = om.perspective(90, (808, 808)), om.perspective(90, (101, 101))
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
def test_a_shrunk_view_is_still_where_it_was(factor):
    source = om.perspective(90, (660, 660))
    side = round(660 / factor)
    target = om.perspective(90, (side, side))
    view = om.remap(picture(source), source, target)
    assert np.abs(view - picture(target))[2:-2, 2:-2].max() < 0.004


def test_only_what_is_shrunk_is_averaged():
    # A wide perspective of a fisheye: its middle is enlarged, its rim is not.
    noise = np.random.default_rng(0).integers(0, 256, (360, 400), np.uint8)
    target = om.perspective(60, (600, 400))
    assert np.array_equal(om.remap(noise, FISHEYE, target), om.remap(noise, FISHEYE, target, antialias=False))


# -- kept maps and figures ---------------------------------------------------------------------------------------


def test_a_kept_map_gives_the_same_views_again_and_again():
    target, turn = om.perspective(100, (90, 60)), om.look(yaw=30)
    remapper = om.Remapper(FISHEYE, target, turn, interpolation="bicubic")
    rng = np.random.default_rng(0)
    for dtype, channels in itertools.product((np.uint8, np.uint16, np.float32), ((), (3,), (4,))):
        image = (rng.random((360, 400, *channels)) * 200).astype(dtype)
        expected = om.remap(image, FISHEYE, target, turn, interpolation="bicubic")
        assert np.array_equal(remapper(image), expected)
        assert np.array_equal(remapper(image), expected)


def test_the_map_holds_source_pixels_and_nan_where_there_are_none():
    target, turn = om.perspective(100, (90, 60)), om.look(yaw=90)
    u, v = view_map(FISHEYE, target, turn)
    bearings, _ = target.unproject(grid(target.size))
    pixels, valid = FISHEYE.project(bearings @ turn)
    assert u.dtype == v.dtype == np.float32
    np.testing.assert_allclose(np.stack([u, v], -1), np.where(valid[..., None], pixels, np.nan), atol=2e-3)


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_magnification_is_of_a_source_pixel_in_the_view(factor):
    source = om.perspective(90, (200, 160))
    remapper = om.Remapper(source, om.perspective(90, (round(200 * factor), round(160 * factor))))
    assert magnification(remapper) == pytest.approx((factor, factor), rel=0.02)
    assert remapper.scale == pytest.approx((1 / factor, 1 / factor), rel=0.02)


def test_a_perspective_of_a_fisheye_is_stretched_at_its_rim():
    centre, rim = magnification(om.Remapper(FISHEYE, om.perspective(140, (400, 400))))
    assert rim > 2 * centre


def test_the_share_of_the_source_that_a_view_keeps():
    source = om.perspective(90, (200, 200))
    half = om.perspective(2 * np.degrees(np.arctan(0.5)), (100, 100))
    assert kept_share(source, source, np.eye(3)) == pytest.approx(1, abs=0.02)
    assert kept_share(source, half, np.eye(3)) == pytest.approx(0.25, abs=0.01)
    assert kept_share(source, half, om.look(yaw=180)) == 0


def test_a_scale_across_the_seam_is_no_jump():
    u, v = view_map(SPHERE, SPHERE, om.look(yaw=90))
    assert np.nanmax(map_scale(SPHERE, u, v)) == pytest.approx(1, abs=0.01)


# -- the cameras to remap to -------------------------------------------------------------------------------------


@pytest.mark.parametrize("fov", [150.1, 180, 360, 0, -10, np.nan])
def test_a_perspective_too_wide_is_refused_with_what_can_show_it(fov):
    with pytest.raises(ValueError, match=r"perspective view cannot show .* 150 at most: use cylinder, panini, sphere"):
        om.perspective(fov)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: om.panini(360), "Panini view of distance 1 cannot show 360 degrees, 353 at most"),
        (lambda: om.panini(190, distance=0.0), "distance 0 cannot show 190 degrees, 176 at most"),
        (lambda: om.panini(np.nan), "Panini view .* cannot show nan degrees"),
        (lambda: om.fisheye(100, 361), "equidistant fisheye cannot show 361 degrees, 360 at most"),
        (lambda: om.fisheye(100, 200, "orthographic"), "orthographic fisheye cannot show 200 degrees, 180 at most"),
        (lambda: om.fisheye(100, 0), "cannot show 0 degrees"),
        (lambda: om.fisheye(100, 180, "fthetalens"), "unknown fisheye projection 'fthetalens'; there are: equidistant"),
        (lambda: om.planet(100, 360), "stereographic fisheye cannot show 360 degrees, 359 at most"),
        (lambda: om.cylinder(100, (-95, 30)), r"within -89 to 89 degrees, got \(-95, 30\)"),
        (lambda: om.mercator(100, (-30, 90)), "within -89 to 89"),
        (lambda: om.sphere(100, (30, -30)), r"elevation must be \(low, high\) within -90 to 90"),
        (lambda: om.sphere(100, (-90, 91)), "within -90 to 90 degrees"),
        (lambda: om.sphere(100, (-90, 90), (-200, 10)), "azimuth must be .* within -180 to 180"),
        (lambda: om.sphere(0), "a view is 1 to 32767 px a side, got 0"),
        (lambda: om.sphere(70000), "1 to 32767 px a side"),
        (lambda: om.perspective(90, (40000, 10)), "1 to 32767 px a side, got 40000 x 10"),
        (lambda: om.cube_face(-3), "1 to 32767 px a side"),
        (lambda: om.look(up="bottom"), "up must be one of top, back, front, got 'bottom'"),
    ],
)
def test_a_view_that_cannot_be_is_refused_with_its_limit(make, said):
    with pytest.raises(ValueError, match=said):
        make()


@pytest.mark.parametrize(
    ("target", "half"),
    [
        (om.perspective(110, (301, 201)), 55),
        (om.panini(170, (301, 201)), 85),
        (om.fisheye(301, 220), 110),
        (om.fisheye(301, 150, "equisolid"), 75),
        (om.fisheye(301, 150, "stereographic"), 75),
        (om.fisheye(301, 150, "orthographic"), 75),
        (om.planet(301, 260), 130),
        (om.cube_face(301), 45),
    ],
)
def test_the_field_of_view_reaches_the_outermost_pixel_edges(target, half):
    middle = (target.height - 1) / 2
    angles = target.angle_of([[-0.5 + 1e-9, middle], [target.width - 0.5 - 1e-9, middle]])
    np.testing.assert_allclose(np.degrees(angles), half, atol=1e-4)


@pytest.mark.parametrize("make", [om.sphere, om.cylinder, om.mercator])
def test_the_ranges_reach_the_outermost_pixel_edges(make):
    target = make(400, (-20.0, 35.0), (-100.0, 60.0))
    corners = [[-0.5, -0.5], [target.width - 0.5, target.height - 0.5]]
    (x, y, z) = target.unproject(corners)[0].T
    np.testing.assert_allclose(np.degrees(np.arctan2(x, z)), [-100, 60], atol=1e-6)
    np.testing.assert_allclose(np.degrees(np.arcsin(-y)), [35, -20], atol=1e-6)
