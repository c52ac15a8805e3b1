"""Arrays of any usual shape and type are accepted; others are rejected with the given and the required shape."""

import numpy as np
import pytest

from calibrating import SIZE, observe
from lenses import lens, observe_boards
from omnisight.camera import Camera


@pytest.fixture(scope="module")
def views():
    return observe_boards(lens(180), 180, np.random.default_rng(0), count=4)


SHAPES = {
    "as documented": lambda a: a,
    "one corner a row": lambda a: a[:, None],
    "one row": lambda a: a[None],
    "lists": lambda a: a.tolist(),
    "tuples": lambda a: tuple(map(tuple, a)),
    "any order in memory": np.asfortranarray,
}


@pytest.mark.parametrize("shape", SHAPES)
def test_any_usual_array_shape_is_accepted(views, shape):
    expected = observe(views)
    found = observe([(SHAPES[shape](x), SHAPES[shape](p)) for x, p in views])
    assert np.array_equal(found.points, expected.points)
    assert np.array_equal(found.pixels, expected.pixels)
    assert found.groups == expected.groups


@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.int16, np.int64, np.uint16, object])
def test_any_real_array_type_is_accepted(views, dtype):
    x, p = (a.round().astype(dtype) for a in views[0])
    found = observe([(x, p)])
    assert found.points.dtype == found.pixels.dtype == np.float64
    assert np.array_equal(found.pixels, p.astype(float))


def test_planar_points_need_no_z(views):
    flat = observe([(x[:, :2], p) for x, p in views])
    assert np.array_equal(flat.points, observe(views).points)
    assert np.array_equal(observe([(x[:, None, :2], p[None]) for x, p in views]).points, flat.points)


def test_opencv_arrays_give_the_same_observations(views):
    # Equal observations calibrate to equal cameras.
    plain = observe([(x.astype(np.float32), p) for x, p in views])
    opencv = observe([(x[:, None].astype(np.float32), p[:, None]) for x, p in views])
    assert np.array_equal(opencv.points, plain.points)
    assert np.array_equal(opencv.pixels, plain.pixels)
    assert opencv.groups == plain.groups


@pytest.mark.parametrize(
    ("points", "pixels"),
    [((54, 4), (54, 2)), ((54, 3), (53, 2)), ((54, 3), (2, 54)), ((3,), (2,)), ((54, 2, 3), (54, 2)), ((0,), (0,))],
)
def test_a_wrong_shape_is_rejected_with_both_shapes(points, pixels):
    with pytest.raises(
        ValueError, match=r"a\.png: needs points \(n, 3\) or \(n, 2\) and pixels \(n, 2\), got"
    ) as error:
        observe([(np.zeros(points), np.zeros(pixels))], names=["a.png"])
    assert f"got {points} and {pixels}" in str(error.value)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, None])
@pytest.mark.parametrize("which", [0, 1])
def test_a_corner_that_is_not_finite_is_rejected_by_index(views, bad, which):
    damaged = [[x.astype(object), p.astype(object)] for x, p in views]
    damaged[1][which][5, 0] = bad
    with pytest.raises(ValueError, match=r"left\.png: row 5 is not finite: point \[") as error:
        observe(damaged, names=["right.png", "left.png", "top.png", "bottom.png"])
    assert str(float("nan" if bad is None else bad)) in str(error.value)
    assert "leave out corners that were not observed" in str(error.value)


@pytest.mark.parametrize("wrong", [[[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, -1.0]], [[1.0, 0.5], [-0.5, 1.0]]])
def test_an_invalid_covariance_is_rejected_by_row(views, wrong):
    points, pixels = views[0]
    certain = np.zeros((len(points), 2, 2))
    assert observe([(points, pixels, certain)], names=["a.png"]).covariance.shape == certain.shape
    certain[7] = wrong
    with pytest.raises(ValueError, match=r"a\.png: row 7: .* is not symmetric and positive semi-definite"):
        observe([(points, pixels, certain)], names=["a.png"])


def test_a_corner_outside_the_image_is_rejected_with_its_view_and_row(views):
    width, height = SIZE
    moved = [(x, p.copy()) for x, p in views]
    moved[2][1][7] += (5000, 0)
    with pytest.raises(ValueError, match=rf"c: row 7: .* outside the image of {width}x{height} .*, one of 1 of 216"):
        observe(moved, names=["a", "b", "c", "d"])


def test_exchanged_width_and_height_are_recognized(views):
    wide = [(x, p * (1, 0.5)) for x, p in views]
    assert len(observe(wide, (960, 480))) == 4
    with pytest.raises(ValueError, match="exchange width and height: all corners lie inside 960x480"):
        observe(wide, (480, 960))


@pytest.mark.parametrize(("beyond", "accepted"), [(0.4, True), (0.6, False)])
def test_a_corner_may_lie_half_a_pixel_beyond_the_edge(views, beyond, accepted):
    points, pixels = views[0][0], views[0][1].copy()
    for edge in ((-0.5 - beyond, 100.0), (100.0, SIZE[1] - 0.5 + beyond)):
        pixels[3] = edge
        if accepted:
            assert len(observe([(points, pixels)])) == 1
        else:
            with pytest.raises(ValueError, match=r"view 0: row 3: .* outside the image"):
                observe([(points, pixels)])


def test_a_board_point_or_pixel_that_occurs_twice_is_rejected(views):
    points, pixels = views[0]
    with pytest.raises(ValueError, match=r"a\.png: rows 2 and 54 are the same board point .* give each corner once"):
        observe([(np.concatenate([points, points[2:3]]), np.concatenate([pixels, pixels[2:3] + 3]))], names=["a.png"])
    pixels = pixels.copy()
    pixels[[4, 9]] = 0
    with pytest.raises(ValueError, match=r"a\.png: rows 4 and 9 are different board points at the same pixel \[0\.0,"):
        observe([(points, pixels)], names=["a.png"])


def test_collinear_corners_are_rejected(views):
    points, pixels = views[0]
    row = points[:, 1] == points[0, 1]
    with pytest.raises(ValueError, match=r"a\.png: the board points lie on one line"):
        observe([(points[row], pixels[row])], names=["a.png"])
    with pytest.raises(ValueError, match=r"a\.png: the board points lie on one line"):
        observe([(points[:1], pixels[:1])], names=["a.png"])
    on_a_line = pixels[:, :1] * (0.5, 0.5) + 100
    with pytest.raises(ValueError, match=r"a\.png: the pixels lie on one line"):
        observe([(points, on_a_line)], names=["a.png"])


@pytest.mark.parametrize("values", [[[1, 2], [3]], [["a", "b"]], "text", [[1 + 2j, 0]]])
def test_arrays_of_other_types_are_rejected_by_name(values):
    with pytest.raises(ValueError, match=r"a\.png: needs arrays of numbers"):
        observe([(np.zeros((2, 3)), values)], names=["a.png"])


def test_points_outside_the_valid_cone_are_nan_masked_and_counted():
    camera = Camera(lens(180), SIZE)  # equisolid: its image ends where the sphere does, that of a pinhole at 90 degrees
    pinhole = Camera(lens(60), SIZE)
    angles = np.radians([0, 60, 89, 91, 120, 179.9])
    points = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], 1)
    with np.errstate(all="raise"):
        pixels, valid = pinhole.project(points)
    assert not valid[3:].any()
    assert np.isnan(pixels[~valid]).all()
    assert np.isfinite(pixels[valid]).all()
    beyond, inside = camera.project(points)
    assert inside.all()  # past 90 degrees a fisheye sees on, each point farther out and none on the wrong side
    assert (np.diff(beyond[:, 0]) > 0).all()
    bearings, known = camera.unproject([[480.0, 480.0], [5000.0, 480.0], [np.nan, 0.0], [-1e9, 1e9]])
    assert known.tolist() == [True, False, False, False]
    assert np.isnan(bearings[~known]).all()
