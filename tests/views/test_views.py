"""The one remap: where things go, and what the bearings say."""

import numpy as np
import pytest
from scenery import FISHEYE, INTERPOLATIONS, MIRROR, SPHERE, brightest, grid, image_of, spot

import omnisight as om
from omnisight.views.cube import CUBE_FACES, cube_rotation

# -- where things go ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("source", [FISHEYE, MIRROR, SPHERE, om.perspective((200, 150), 80)])
def test_remap_to_the_same_camera_is_the_identity(source, interpolation):
    noise = np.random.default_rng(0).integers(0, 256, (source.height, source.width, 3), np.uint8)
    remapper = om.Remapper(source, source, interpolation=interpolation)
    assert np.array_equal(remapper(noise)[remapper.mask], noise[remapper.mask])
    shown = source.unproject(grid(source.size))[1]
    # A model's domain may end within the image; there alone pixels are missing.
    assert (remapper.mask == shown).mean() > 0.999


@pytest.mark.parametrize("columns", [1, 64, 128, -37])
def test_yaw_by_whole_columns_rolls_a_360_image(columns):
    noise = np.random.default_rng(0).integers(0, 65536, (128, 256), np.uint16)
    turn = om.look(yaw=columns * 360 / 256)
    assert np.array_equal(om.remap(noise, SPHERE, SPHERE, turn, interpolation="nearest"), np.roll(noise, -columns, 1))


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic", "lanczos"])
@pytest.mark.parametrize("shift", [0.25, 0.5, 100.3])
def test_seam_of_a_360_image_is_invisible(interpolation, shift):
    source = om.sphere(512)
    turn = om.look(yaw=(256 + shift) * 360 / 512)  # the seam lands near the middle of the view
    remapper = om.Remapper(source, source, turn, interpolation=interpolation)
    view = remapper(image_of(source)).astype(float)
    assert remapper.mask.all()
    assert np.abs(view - image_of(source, turn=turn)).max() < 2e-3
    steps = np.abs(np.diff(view, axis=1, append=view[:, :1])).max((0, 2))
    seam = [256, 255, 254, 511 - 100, 511, 0]
    assert steps[seam].max() <= 1.05 * steps.max()
    rolled = np.abs(np.diff(view - image_of(source, turn=turn), axis=1)).max((0, 2))
    assert rolled.max() < 3 * np.median(rolled) + 1e-4


@pytest.mark.parametrize("width", [64, 32, 16])
def test_seam_of_a_reduced_360_image_is_invisible(width):
    source, target = om.sphere(1024), om.sphere(width)
    turn = om.look(yaw=180.0)
    view = om.remap(image_of(source), source, target, turn)
    error = np.abs(view - image_of(target, turn=turn)).max(2)
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
def test_view_has_the_requested_direction(source, angles, place):
    target, turn = om.perspective((121, 91), 60), om.look(**angles)
    view = om.remap(image_of(source, spot(*place, 0.1)), source, target, turn, interpolation="lanczos")
    assert brightest(view) == (60, 45)


def test_yaw_of_90_degrees_centres_the_right_of_a_360_image():
    view = om.remap(image_of(SPHERE, spot(90, 0)), SPHERE, om.perspective((101, 101), 90), om.look(yaw=90))
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
def test_positive_yaw_is_right_and_positive_pitch_is_up(angles, place, side):
    view = om.remap(image_of(SPHERE, spot(*place)), SPHERE, om.perspective((101, 101), 90), om.look(**angles))
    column, row = brightest(view)
    off = round(50 * np.tan(np.radians(20)))
    at = {"right": (50 + off, 50), "left": (50 - off, 50), "above": (50, 50 - off), "below": (50, 50 + off)}[side]
    assert abs(column - at[0]) <= 1
    assert abs(row - at[1]) <= 1


@pytest.mark.parametrize(("up", "axis"), [("back", (0, -90)), ("front", (0, 90))])
def test_axis_of_a_camera_looking_down_or_up_is_at_the_edge_of_a_panorama(up, axis):
    view = om.remap(image_of(FISHEYE, spot(0, 0, 0.2)), FISHEYE, om.sphere(200), om.look(up=up))
    low = view[-3:] if axis[1] < 0 else view[:3]
    assert low.mean() > 0.9
    assert view[45:55].max() < 0.01


# -- against direct evaluation -----------------------------------------------------------------------------------

VIEWS = {
    "perspective": (om.perspective((240, 160), 100), om.look(yaw=25, pitch=-15, roll=10)),
    "panini": (om.panini((240, 140), 140), om.look(yaw=-10)),
    "cylinder": (om.cylinder(300, (-30, 30), (-60, 60)), om.look(pitch=5)),
    "mercator": (om.mercator(300, (-40, 40), (-60, 60)), om.look()),
    "sphere": (om.sphere(300, (-40, 40), (-60, 60)), om.look(roll=-20)),
    "cube face": (om.cube_face(180), om.look(yaw=20)),
    "fisheye": (om.fisheye(260, 140, "equisolid"), om.look(pitch=10)),
    "planet": (om.planet(200, 130), om.look()),
}


@pytest.mark.parametrize("name", VIEWS)
def test_view_of_a_fisheye_matches_its_bearings(name):
    target, turn = VIEWS[name]
    remapper = om.Remapper(FISHEYE, target, turn, interpolation="bicubic", antialias=False)
    view = remapper(image_of(FISHEYE))
    inside = remapper.mask.copy()
    inside[1:-1, 1:-1] &= inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    error = np.abs(view - image_of(target, turn=turn)).max(2)
    assert np.median(error[inside]) < 1e-3
    assert np.quantile(error[inside], 0.99) < 5e-3
    assert inside.mean() > 0.5
    assert (view[~remapper.mask] == 0).all()


@pytest.mark.parametrize("name", VIEWS)
def test_mask_marks_covered_pixels(name):
    target, turn = VIEWS[name]
    mask = om.Remapper(FISHEYE, target, turn).mask
    bearings, exists = target.unproject(grid(target.size))
    pixels, valid = FISHEYE.project(bearings @ turn)
    expected = exists & valid & FISHEYE.in_image(pixels)
    assert mask.dtype == bool
    # On the very edge float32 decides.
    assert (mask != expected).mean() < 1e-3


def test_view_is_empty_outside_the_domain_of_the_source():
    front = om.perspective((60, 40), 90)
    back = om.Remapper(front, om.perspective((50, 50), 60), om.look(yaw=180), border=7.0)
    assert not back.mask.any()
    assert (back(np.ones((40, 60), np.uint8)) == 7).all()


# -- the cube ----------------------------------------------------------------------------------------------------


def test_cube_faces_cover_every_direction_once():
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
def test_adjacent_cube_faces_agree_along_their_edge(edge):
    source = om.sphere(1024)
    image, face = image_of(source), om.cube_face(128)
    one, other = (om.remap(image, source, face, cube_rotation(name, np.eye(3))) for name in edge)
    along = EDGES[edge]
    assert np.abs(one[along[0]] - other[along[1]]).max() < 0.035  # a pixel apart
    assert np.abs(one[along[0]] - other[along[1]][::-1]).max() > 0.05  # and not the other way around


def test_360_image_to_cube_and_back():
    source, face = om.sphere(512), om.cube_face(256)
    image = image_of(source)
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


def test_strong_reduction_keeps_the_brightness_of_the_last_row_and_column():
    source, target = om.perspective((640, 480), 90), om.perspective((40, 30), 90)
    view = om.remap(np.full((480, 640), 100, np.uint8), source, target, border=7)
    assert (view == 100).all()
    outside = om.remap(np.full((480, 640), 100, np.uint8), source, target, om.look(yaw=60), border=7)
    assert set(np.unique(outside)) == {7, 100}
