"""Edges are traced to a fraction of a pixel, and images of lines calibrate mirrors and lenses."""

import numpy as np
import pytest

from omnisight.calibration.lines import Chains, apart, calibrate_lines, find_arcs, read_polylines
from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp, look
from omnisight.images import estimate_image_field, read_image, to_gray8
from omnisight.images.edges import detect_edge_chains
from omnisight.models import model_class
from omnisight.simulation import Renderer, scene_named


def disc(radius, centre=(100.3, 90.7), size=(200, 180), levels=(40, 200)):
    """Draw a disc, each pixel averaged over its area (16 x 16 samples)."""
    fine = (np.arange(16) + 0.5) / 16 - 0.5
    u = (np.arange(size[0])[:, None] + fine).ravel()
    v = (np.arange(size[1])[:, None] + fine).ravel()
    inside = (u - centre[0]) ** 2 + (v[:, None] - centre[1]) ** 2 < radius**2
    share = inside.reshape(size[1], 16, size[0], 16).mean((1, 3))
    return np.rint(levels[0] + (levels[1] - levels[0]) * share).astype(np.uint8)


# -- edges -------------------------------------------------------------------------------------------------------


def test_a_disc_is_one_chain_on_its_rim():
    (chain,) = detect_edge_chains(disc(60.0))
    away = np.linalg.norm(chain - (100.3, 90.7), axis=1)
    assert np.abs(away.mean() - 60.0) < 0.03
    assert np.abs(away - 60).max() < 0.15
    assert np.linalg.norm(np.diff(chain, axis=0), axis=1).max() < 3  # ordered along the rim
    assert len(chain) > 0.8 * 2 * np.pi * 60


def test_the_dark_side_is_the_same_all_along():
    picture = disc(60.0)
    for image in (picture, 255 - picture):
        (chain,) = detect_edge_chains(image)
        step = np.diff(chain, axis=0)
        middle = (chain[1:] + chain[:-1]) / 2 + 3 * np.stack([step[:, 1], -step[:, 0]], -1)
        gray = image[np.rint(middle[:, 1]).astype(int), np.rint(middle[:, 0]).astype(int)]
        assert (gray < 120).all() or (gray > 120).all()


def test_noise_and_flat_pictures_have_no_edges():
    rng = np.random.default_rng(0)
    noisy = np.clip(128 + 2 * rng.standard_normal((200, 200)), 0, 255).astype(np.uint8)
    assert detect_edge_chains(noisy) == []
    assert detect_edge_chains(np.full((50, 50), 7, np.uint8)) == []
    assert detect_edge_chains(np.zeros((3, 3), np.uint8)) == []


def test_edges_outside_of_what_is_visible_are_not_traced():
    visible = np.zeros((180, 200), bool)
    visible[:, :100] = True
    chains = detect_edge_chains(disc(60.0), visible)
    assert chains
    assert np.concatenate(chains)[:, 0].max() < 100.5


def test_what_is_no_gray_picture_is_refused():
    with pytest.raises(ValueError, match="expected a gray image"):
        detect_edge_chains(np.zeros((9, 9, 3), np.uint8))
    with pytest.raises(ValueError, match="the image has shape"):
        detect_edge_chains(np.zeros((9, 9), np.uint8), np.zeros((8, 9), bool))


def test_an_edge_is_cut_at_corners_and_where_its_curvature_breaks():
    import cv2

    picture = np.full((400, 400), 60, np.uint8)
    cv2.rectangle(picture, (60, 60), (220, 180), 200, -1, cv2.LINE_AA)
    arcs = find_arcs(picture)
    assert len(arcs) == 4
    assert all(min(np.ptp(arc[:, 0]), np.ptp(arc[:, 1])) < 1 for arc in arcs)
    picture = np.full((400, 400), 60, np.uint8)  # two half circles, one after the other, bent against each other
    cv2.circle(picture, (130, 200), 60, 200, -1, cv2.LINE_AA)
    cv2.rectangle(picture, (0, 0), (400, 200), 60, -1)
    arcs = find_arcs(picture)
    assert all(np.ptp(np.linalg.norm(arc - (130, 200), axis=1)) < 4 or np.ptp(arc[:, 1]) < 2 for arc in arcs)


# -- files of lines ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[[[1, 2], [3, 4], [5, 7]]]", {"": 1}),
        ('{"a.png": [[[1, 2], [3, 4], [5, 7]], [[0, 0], [1, 1], [2, 3]]], "b.png": []}', {"a.png": 2, "b.png": 0}),
        ("line,u,v\n1,1,2\n1,3,4\n1,5,7\n2,0,0\n2,1,1\n2,2,3\n", {"": 2}),
        ("a.png,top,1,2\na.png,top,3,4\na.png,top,5,7\n", {"a.png": 1}),
    ],
)
def test_lines_are_read(tmp_path, text, expected):
    (tmp_path / "lines").write_text(text)
    found = read_polylines(tmp_path / "lines")
    assert {name: len(lines) for name, lines in found.items()} == expected
    first = next(iter(found.values()))[0]
    assert first.tolist() == [[1, 2], [3, 4], [5, 7]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[[1, 2], [3, 4]]]", r"line 1 has the shape \(2, 2\); wanted three or more"),
        ('[[[1, 2], [3, "x"], [5, 6]]]', r"line 1 is not a list of pixels"),
        ('{"a.png": 3}', "'a.png' holds int"),
        ("[[[1, 2], [3, 4], [1e9, 6]]]", "holds a number that is no pixel"),
        ("1,2\n3,4\n", "row 1 has 2 columns"),
        ("[" * 100_000, "lines"),
        ("line,u,v\n1,nan,2\n1,3,4\n1,5,7\n", "holds a number that is no pixel"),
    ],
)
def test_files_that_hold_something_else_are_refused(tmp_path, text, message):
    (tmp_path / "lines").write_text(text)
    with pytest.raises(ValueError, match=message) as refused:
        read_polylines(tmp_path / "lines")
    assert str(tmp_path / "lines") in str(refused.value)


# -- images ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_rendered_room_calibrates_the_mirror_that_shows_it():
    from omnisight.simulation import mirror_setup

    setup = mirror_setup(480)
    gray = to_gray8(setup.renderer(samples=2)().image)
    field = estimate_image_field([gray])
    arcs = Chains.of(find_arcs(gray, field))
    found = calibrate_lines(arcs, setup.camera.size, centre=np.array(field.outer.centre))
    assert len(found.chains) > 20
    assert found.rms < 0.5
    # The truth has fx < 0: lines do not tell a mirror image from what it shows.
    truth = setup.camera.model
    seen = truth.with_params(truth.params * np.array([-1, 1, 1, 1, 1, 1]))
    error = apart(found.camera.model, seen, found.chains.pixels)
    assert error < 3 * found.bearing_sd
    assert np.degrees(error) < 1.5


@pytest.mark.parametrize(
    ("xi", "up", "theta_deg"),
    [(1.0, "back", (18, 100)), (0.8, "back", (20, 105)), (None, "top", (0, 85))],
    ids=["parabolic", "hyperbolic", "equidistant"],
)
def test_a_rendered_camera_is_found_within_what_is_stated(xi, up, theta_deg):
    # Wires and cubes in a hall; the mirrors' middle is not the image's.
    low, high = np.radians(theta_deg)
    size, at, radius = (400, 360), (206.0, 174.0), 165.0
    if xi is None:
        truth = model_class("equidistant")(radius / high, radius / high, *at)
    else:
        focal = radius * (np.cos(high) + xi) / np.sin(high)
        truth = model_class("unified")(focal, focal, *at, xi)
    place = Pose(look(up=up) @ exp((0.05, -0.04, 0.3)), np.array((0.2, 0.1, -0.1)))
    picture = Renderer(Camera(truth, size), place, scene_named("lines"), theta=(low, high), samples=2)
    gray = to_gray8(picture(rng=np.random.default_rng(1), blur=0.8, noise=2.0, jpeg=90).image)
    field = estimate_image_field([gray])
    found = calibrate_lines(Chains.of(find_arcs(gray, field)), size, centre=np.array(field.outer.centre))
    assert len(found.chains) > 20
    error = apart(found.camera.model, truth, found.chains.pixels)
    assert error < 2 * found.bearing_sd
    assert found.bearing_sd < np.radians(2.5)


@pytest.mark.parametrize("name", ["kaidan", "mei"])
def test_the_rows_of_real_boards_agree_with_the_boards_within_what_is_stated(data, name):
    # A board calibration of the same corners by OpenCV (cv2.omnidir): its centre, and its focal length there.
    import json

    folder = data("corners")
    with np.load(folder / f"{name}.npz") as stored:
        columns, rows = (int(n) for n in stored["pattern"])
        boards = stored["corners"].astype(float).reshape(-1, rows, columns, 2)
    theirs = json.loads((folder / "opencv_omnidir.json").read_text())[name]
    lines = [line for board in boards for line in (*board, *board.transpose(1, 0, 2))]
    found = calibrate_lines(Chains.of(lines), {"kaidan": (640, 480), "mei": (1280, 1024)}[name], trusted=True)
    off = np.hypot(found.camera.model.cx - theirs["c"][0], found.camera.model.cy - theirs["c"][1])
    values = found.camera.model.to_dict()
    focal = values["fx"] / (1 + values["xi"])
    assert np.degrees(off / focal) < 3 * np.degrees(found.bearing_sd)
    assert np.log(focal * (1 + theirs["xi"]) / theirs["f"]) == pytest.approx(0, abs=0.1)
    assert np.degrees(found.bearing_sd) < 2.0


def scene(folder, names, masked=False):
    grays = [to_gray8(read_image(folder / name)) for name in names]
    field = estimate_image_field(grays)
    masks = [None] * len(names)
    if masked:  # of this set: black is seen
        masks = [to_gray8(read_image((folder / name).with_suffix(".pbm"))) < 128 for name in names]
    found = [find_arcs(gray, field, mask) for gray, mask in zip(grays, masks, strict=True)]
    arcs = [arc for part in found for arc in part]
    pictures = [i for i, part in enumerate(found) for _ in part]
    return Chains.of(arcs, pictures), grays[0].shape[::-1], np.array(field.outer.centre)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "xi"),
    [
        (["paracat_1024x768_01.jpg"], (0.95, 1.25)),
        (["hypercat_1280x1024_01.jpg"], (0.7, 0.98)),
        (["fisheyeEquiangular_1024x768_03.jpg"], (1.5, 3.5)),
    ],
)
def test_one_picture_of_a_room_or_a_house_tells_mirrors_from_lenses(data, names, xi):
    arcs, size, centre = scene(data("line_images_unizar"), names, masked=True)
    found = calibrate_lines(arcs, size, centre=centre)
    assert len(found.chains) > 30
    assert found.rms < 0.6
    assert xi[0] < found.camera.model.to_dict()["xi"] < xi[1]
