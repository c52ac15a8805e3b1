import cv2
import numpy as np
import pytest
from scipy.io import loadmat

from omnisight.images import ImageField, collect_images, estimate_image_field, read_image, to_gray8
from omnisight.images.ellipse import Ellipse

SIZE = (1152, 864)  # 1 MP


def texture(rng, size=SIZE, low=20.0, high=230.0):
    """Return a random scene of several octaves of noise with sharp regions."""
    w, h = size
    scene = np.zeros((h, w))
    for cells, weight in ((5, 1.0), (13, 0.7), (40, 0.4), (120, 0.2)):
        scene += weight * cv2.resize(rng.normal(size=(cells, cells)), size)
    blocks = cv2.resize(rng.normal(size=(9, 12)), size, interpolation=cv2.INTER_NEAREST)
    scene += np.where(blocks > 0.5, blocks, 0)
    scene = (scene - scene.min()) / np.ptp(scene)
    return low + (high - low) * scene


def pixel_grid(size=SIZE):
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(float)


def expose(rng, image, noise=2.0):
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def render(rng, outer, inner=None, soft=1.5, vignetting=0.4, stray=0.0, noise=2.0, size=SIZE):
    """Render a scene inside `outer` and outside `inner`, with blurred boundaries."""
    pixels = pixel_grid(size)
    level = outer.level(pixels)

    def within(ellipse):
        return 1 / (1 + np.exp((ellipse.level(pixels) - 1) * ellipse.radius / soft))

    transmission = within(outer) * (1 - vignetting * np.minimum(level, 1) ** 4)
    transmission = transmission if inner is None else transmission * (1 - within(inner))
    glare = stray * (0.5 + 0.5 * np.sin(pixels[..., 0] / 170 + 1)) if stray else 0.0
    return expose(rng, texture(rng, size) * transmission + glare, noise)


def max_distance_px(estimate, truth):
    """Return the largest distance between two boundaries over the part inside the image."""
    outline = truth.outline(720)
    outline = outline[((outline >= 0) & (outline <= np.array(SIZE) - 1)).all(axis=1)]
    return np.abs(estimate.level(outline) - 1).max() * truth.radius


CIRCLES = {
    "complete": {"outer": Ellipse((580.3, 430.6), (400.4, 400.4))},
    "cropped above and below": {"outer": Ellipse((560.2, 440.7), (520.3, 520.3))},
    "cropped on all sides": {"outer": Ellipse((570.0, 428.0), (600.5, 600.5))},
    "small and off centre": {"outer": Ellipse((380.6, 500.1), (262.2, 262.2))},
    "slightly elliptic": {"outer": Ellipse((575.5, 425.5), (410.0, 398.0), 0.5)},
    "stretched": {"outer": Ellipse((575.5, 425.5), (520.0, 400.0))},
    "soft rim": {"outer": Ellipse((580.3, 430.6), (380.4, 380.4)), "soft": 3.0},
    "stray light": {"outer": Ellipse((580.3, 430.6), (390.4, 390.4)), "stray": 15.0},
    "noise": {"outer": Ellipse((580.3, 430.6), (390.4, 390.4)), "noise": 12.0},
    "strong vignetting": {"outer": Ellipse((580.3, 430.6), (405.0, 405.0)), "vignetting": 0.7},
}


@pytest.mark.parametrize("name", CIRCLES)
def test_image_circle_of_a_rendered_lens_is_accurate_to_half_a_pixel(name):
    rng = np.random.default_rng(len(name))
    field = estimate_image_field([render(rng, **CIRCLES[name])])
    assert field.size == SIZE
    assert field.outer is not None
    assert field.inner is None
    # Vignetting moves the steepest fall of a soft rim inwards.
    assert max_distance_px(field.outer, CIRCLES[name]["outer"]) < (1.0 if name in ("soft rim", "noise") else 0.5)


@pytest.mark.parametrize("count", [1, 3])
def test_both_boundaries_of_a_rendered_mirror_are_detected(count):
    rng = np.random.default_rng(count)
    outer, inner = Ellipse((580.3, 430.6), (390.4, 390.4)), Ellipse((584.3, 427.6), (80.2, 80.2))
    field = estimate_image_field([render(rng, outer, inner) for _ in range(count)])
    assert max_distance_px(field.outer, outer) < 0.4
    assert max_distance_px(field.inner, inner) < 0.4
    assert field.describe() == "mirror between radius 80 and 390 px centred at (580, 431)"


def test_a_flare_in_one_image_does_not_change_the_boundary():
    rng = np.random.default_rng(3)
    outer = CIRCLES["complete"]["outer"]
    images = [render(rng, outer) for _ in range(4)]
    images[2][:400, 700:] = 255
    assert max_distance_px(estimate_image_field(iter(images)).outer, outer) < 0.3


def test_boundaries_of_large_images_are_in_original_pixels():
    rng = np.random.default_rng(5)
    outer = CIRCLES["cropped above and below"]["outer"]
    large = render(rng, outer).repeat(3, axis=0).repeat(3, axis=1)
    field = estimate_image_field([large])
    assert field.size == (3 * SIZE[0], 3 * SIZE[1])
    assert field.outer.centre == pytest.approx((3 * 560.2 + 1, 3 * 440.7 + 1), abs=1)
    assert field.outer.axes == pytest.approx((3 * 520.3, 3 * 520.3), abs=1)


def images_without_boundary(rng):
    """Return images of lenses that fill the image, by name."""
    w, h = SIZE
    from_centre = pixel_grid() - np.array(SIZE) / 2
    radius = np.hypot(*from_centre.T).T
    squares = np.floor(from_centre * (1 + (radius / 900) ** 2)[..., None] / 55).sum(axis=-1) % 2
    cos4 = np.cos(np.arctan(radius / 500)) ** 4
    bell = np.exp(-((radius / 300) ** 2) / 2)
    ceiling = texture(rng)
    ceiling[: h // 3] *= 0.05
    corner = texture(rng)
    corner[np.hypot(*(pixel_grid() - (w, 0)).T).T < 450] *= 0.02
    return {
        "black": np.zeros((h, w)),
        "white": np.full((h, w), 255.0),
        "noise": rng.uniform(0, 255, (h, w)),
        "scene": texture(rng),
        "vignetted scene": texture(rng) * cos4,
        "vignetted wall": 240 * cos4,
        "dark corners": texture(rng) * bell,
        "wall with dark corners": 240 * bell,
        "checkerboard": 30 + 190 * squares,
        "checkerboard on dark": np.where((np.abs(from_centre) < (330, 275)).all(axis=-1), 30 + 190 * squares, 25),
        "sheet of paper on dark": np.where((np.abs(from_centre) < (330, 275)).all(axis=-1), 220, 25),
        "dark ceiling": ceiling,
        "dark corner": corner,
    }


def test_no_boundary_is_detected_if_the_lens_fills_the_image():
    rng = np.random.default_rng(1)
    images = images_without_boundary(rng).items()
    fields = {name: estimate_image_field([expose(rng, image[::2, ::2])]) for name, image in images}
    assert {name: field.outer for name, field in fields.items()} == dict.fromkeys(dict(images))
    assert fields["scene"].describe() == "no image circle detected: the lens fills the image"


@pytest.mark.parametrize("shape", [(1, 1), (1, 900), (16, 16), (33, 40), (2000, 33)])
def test_small_and_narrow_images_have_no_boundary(shape):
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    assert estimate_image_field([image]) == ImageField(shape[::-1])


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ([], "at least one image"),
        ([np.zeros((40, 40), np.uint8), np.zeros((40, 50), np.uint8)], "one size, got 40 x 40 and 50 x 40"),
        ([np.zeros((40, 40, 3), np.uint8)], r"shape \(40, 40, 3\)"),
        ([np.zeros((40, 40), np.float32)], "float32"),
    ],
)
def test_invalid_images_raise_value_error(images, message):
    with pytest.raises(ValueError, match=message):
        estimate_image_field(images)


def test_contains_pixels_between_the_boundaries():
    field = ImageField((200, 100), Ellipse((100, 50), (80, 80)), Ellipse((100, 50), (10, 10)))
    pixels = np.array([[100, 65], [100, 55], [175, 50], [185, 50], [100, 101], [np.nan, 50]])
    assert field.contains(pixels).tolist() == [True, False, True, False, False, False]
    assert field.contains(pixels, margin_px=6).tolist() == [False, False, False, False, False, False]
    assert field.contains(pixels, margin_px=-6).tolist() == [True, True, True, True, False, False]
    assert field.contains((100, 65)).shape == ()
    assert field.contains(pixels.reshape(2, 3, 2)).shape == (2, 3)
    assert ImageField((200, 100)).contains(pixels).tolist() == [True, True, True, True, False, False]


def test_field_includes_a_soft_rim():
    rng = np.random.default_rng(0)
    outer = Ellipse((580.3, 430.6), (380.4, 380.4))
    sharp, soft = (estimate_image_field([render(rng, outer, soft=width) for _ in range(3)]) for width in (1.0, 6.0))
    assert sharp.outer_fade < 4
    assert 6 < soft.outer_fade < 18
    dim = outer.outline() + 4 * (outer.outline() - outer.centre) / 380.4
    assert soft.contains(dim).all()
    assert not sharp.contains(dim, margin_px=1).any()
    assert ImageField(SIZE, outer, outer_fade=20.0).describe().endswith("px centred at (580, 431), fading over 20 px")


def test_description_lists_the_sides_that_crop_the_circle():
    def describe(u, v, a, b):
        return ImageField((200, 100), Ellipse((u, v), (a, b))).describe()

    assert describe(100, 50, 45, 45) == "image circle of radius 45 px centred at (100, 50)"
    assert describe(100, 50, 60, 60).endswith(", cropped above and below")
    assert describe(50, 50, 60, 60).endswith(", cropped above, below and left")
    assert describe(100, 50, 120, 120).endswith(", cropped on all sides")
    assert describe(100, 50, 60, 40) == "image ellipse of semi-axes 60 and 40 px centred at (100, 50)"


def test_outline_points_have_level_one():
    ellipse = Ellipse((30, 20), (9, 4), 0.7)
    np.testing.assert_allclose(ellipse.level(ellipse.outline(50)), 1)
    tip = np.array([30 + 9 * np.cos(0.7), 20 + 9 * np.sin(0.7)])
    assert ellipse.level(tip) == pytest.approx(1)
    assert ellipse.level(2 * tip - (30, 20)) == pytest.approx(2)
    again = Ellipse.from_matrix(ellipse.centre, ellipse.matrix)
    assert (*again.centre, *again.axes, again.angle) == pytest.approx((30, 20, 9, 4, 0.7))


REAL = [
    # folder, file pattern, corners; measured manually: centre and semi-axes of the outer boundary, radius of the inner
    ("fisheye1_urban", "*.jpg", "fish1", (548, 365), (532, 522), None),
    ("kaidan_catadioptric", "*.jpg", "kaidan", (325, 246), (223, 223), 54),
    ("mei_paracatadioptric", "*.png", "mei", (642, 521), (353, 353), 54),
    ("camodocal_fisheye", "*.png", "camo", (640, 480), (605, 465), None),
    ("stereo_fisheye_sourishg", "left*", "fstereo_left", (471, 309), (384, 384), None),
    ("stereo_fisheye_sourishg", "right*", "fstereo_right", (476, 298), (381, 381), None),
    ("ai360_lens_a", "*.jpg", "ai360_a", (959, 960), (960, 960), None),
    ("gopro_derlunz_static_board", "*.JPG", "derlunz", None, None, None),
]


@pytest.mark.slow
@pytest.mark.parametrize(("folder", "names", "corners", "centre", "axes", "hole"), REAL)
def test_real_lenses_and_mirrors(data, folder, names, corners, centre, axes, hole):
    paths = collect_images([data(folder) / names])
    corners = np.load(data("corners") / f"{corners}.npz")["corners"].reshape(-1, 2)
    images = [to_gray8(read_image(path)) for path in paths]
    field = estimate_image_field(images)
    assert (field.outer is None, field.inner is None) == (centre is None, hole is None)
    if centre is not None:
        assert field.outer.centre == pytest.approx(centre, abs=4)
        assert field.outer.axes == pytest.approx(axes, abs=4)
    if hole is not None:
        assert field.inner.radius == pytest.approx(hole, abs=3)
    # The field contains every corner, also if it is estimated from a single image.
    corners = corners[np.isfinite(corners).all(axis=-1)]
    assert len(corners) > 0
    for estimate in [field, *(estimate_image_field([image]) for image in images[::2])]:
        assert estimate.contains(corners).all()


@pytest.mark.slow
def test_field_contains_corners_in_a_soft_rim(data):
    folder = data("babelcalib_ov_plane")
    views = loadmat(folder / "train.mat", squeeze_me=True, struct_as_record=False)["corners"]
    corners = np.concatenate([view.x.T - 1 for view in views])
    images = [to_gray8(read_image(path)) for path in collect_images([folder / "*.png"])]
    field = estimate_image_field(images)
    assert field.outer.centre == pytest.approx((658, 394), abs=5)
    assert field.outer.radius == pytest.approx(467, abs=5)
    assert field.contains(corners).all()
    assert all(estimate_image_field([image]).contains(corners).mean() > 0.999 for image in images)


@pytest.mark.slow
def test_real_fields_agree_with_manual_masks(data):
    paths = collect_images([data("line_images_unizar") / "*.jpg"])
    assert len(paths) > 0
    for path in paths:
        mask = read_image(path.with_suffix(".pbm")) > 0
        mask = mask == mask[mask.shape[0] // 4, mask.shape[1] // 2]  # true inside the image circle
        field = estimate_image_field([to_gray8(read_image(path))])
        inside = field.contains(pixel_grid(mask.shape[::-1]))
        # The masks were drawn a few pixels inside the boundaries.
        assert (inside & mask).sum() > 0.998 * mask.sum(), path.name
        assert (inside & mask).sum() > 0.9 * (inside | mask).sum(), path.name
