"""Detection of edges and arcs, files of drawn lines, and calibration from images of lines."""

import numpy as np
import pytest

from arcs import calibrate_arcs, calibrate_drawn
from omnisight.calibration.lines import PixelChains, bearing_difference, detect_arcs, read_polylines
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


def test_a_disc_has_one_edge_on_its_circle():
    (chain,) = detect_edge_chains(disc(60.0))
    away = np.linalg.norm(chain - (100.3, 90.7), axis=1)
    assert np.abs(away.mean() - 60.0) < 0.03
    assert np.abs(away - 60).max() < 0.15
    assert np.linalg.norm(np.diff(chain, axis=0), axis=1).max() < 3  # ordered along the circle
    assert len(chain) > 0.8 * 2 * np.pi * 60


def test_the_dark_side_is_the_same_along_an_edge():
    bright = disc(60.0)
    for image in (bright, 255 - bright):
        (chain,) = detect_edge_chains(image)
        step = np.diff(chain, axis=0)
        middle = (chain[1:] + chain[:-1]) / 2 + 3 * np.stack([step[:, 1], -step[:, 0]], -1)
        gray = image[np.rint(middle[:, 1]).astype(int), np.rint(middle[:, 0]).astype(int)]
        assert (gray < 120).all() or (gray > 120).all()


def test_noise_and_uniform_images_have_no_edges():
    rng = np.random.default_rng(0)
    noisy = np.clip(128 + 2 * rng.standard_normal((200, 200)), 0, 255).astype(np.uint8)
    assert detect_edge_chains(noisy) == []
    assert detect_edge_chains(np.full((50, 50), 7, np.uint8)) == []
    assert detect_edge_chains(np.zeros((3, 3), np.uint8)) == []


def test_edges_outside_the_mask_are_not_detected():
    visible = np.zeros((180, 200), bool)
    visible[:, :100] = True
    chains = detect_edge_chains(disc(60.0), visible)
    assert chains
    assert np.concatenate(chains)[:, 0].max() < 100.5


def test_images_of_other_shapes_are_rejected():
    with pytest.raises(ValueError, match="expected a gray image"):
        detect_edge_chains(np.zeros((9, 9, 3), np.uint8))
    with pytest.raises(ValueError, match="expected a mask of the image's shape"):
        detect_edge_chains(np.zeros((9, 9), np.uint8), np.zeros((8, 9), bool))


def test_an_edge_is_split_at_corners_and_curvature_changes():
    import cv2

    image = np.full((400, 400), 60, np.uint8)
    cv2.rectangle(image, (60, 60), (220, 180), 200, -1, cv2.LINE_AA)
    arcs = detect_arcs(image)
    assert len(arcs) == 4
    assert all(min(np.ptp(arc[:, 0]), np.ptp(arc[:, 1])) < 1 for arc in arcs)
    image = np.full((400, 400), 60, np.uint8)  # a half disc: a half circle and a straight line
    cv2.circle(image, (130, 200), 60, 200, -1, cv2.LINE_AA)
    cv2.rectangle(image, (0, 0), (400, 200), 60, -1)
    arcs = detect_arcs(image)
    assert len(arcs) >= 2
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
def test_drawn_lines_are_read(tmp_path, text, expected):
    (tmp_path / "lines").write_text(text)
    found = read_polylines(tmp_path / "lines")
    assert {name: len(lines) for name, lines in found.items()} == expected
    first = next(iter(found.values()))[0]
    assert first.tolist() == [[1, 2], [3, 4], [5, 7]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[[1, 2], [3, 4]]]", r"line 1 has shape \(2, 2\); expected 3 or more"),
        ('[[[1, 2], [3, "x"], [5, 6]]]', r"line 1 is not a list of pixels"),
        ('{"a.png": 3}', "'a.png' is of type int"),
        ("[[[1, 2], [3, 4], [1e9, 6]]]", "has a coordinate that is not a valid pixel"),
        ("1,2\n3,4\n", "row 1 has 2 columns"),
        ("[" * 100_000, "lines"),
        ("line,u,v\n1,nan,2\n1,3,4\n1,5,7\n", "has a coordinate that is not a valid pixel"),
    ],
)
def test_files_with_other_content_are_rejected(tmp_path, text, message):
    (tmp_path / "lines").write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_polylines(tmp_path / "lines")
    assert str(tmp_path / "lines") in str(error.value)


# -- images ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_rendered_room_calibrates_its_mirror():
    from omnisight.simulation import mirror_setup

    setup = mirror_setup(480)
    gray = to_gray8(setup.renderer(samples=2)().image)
    field = estimate_image_field([gray])
    arcs = PixelChains.from_arrays(detect_arcs(gray, field))
    found = calibrate_arcs(arcs, setup.camera.size, np.array(field.outer.centre))
    assert len(found.lines) > 20
    assert found.rms < 0.5
    # The truth has fx < 0: lines do not determine the handedness.
    truth = setup.camera.model
    seen = truth.with_params(truth.params * np.array([-1, 1, 1, 1, 1, 1]))
    error = bearing_difference(found.camera.model, seen, found.lines.pixels)
    assert error < 3 * found.bearing_sigma
    assert np.degrees(error) < 1.5


@pytest.mark.parametrize(
    ("xi", "up", "theta_deg"),
    [(1.0, "back", (18, 100)), (0.8, "back", (20, 105)), (None, "top", (0, 85))],
    ids=["parabolic", "hyperbolic", "equidistant"],
)
def test_a_rendered_camera_is_estimated_within_its_stated_uncertainty(xi, up, theta_deg):
    # Wires and cubes in a hall; the principal point is off the image centre.
    low, high = np.radians(theta_deg)
    size, at, radius = (400, 360), (206.0, 174.0), 165.0
    if xi is None:
        truth = model_class("equidistant")(radius / high, radius / high, *at)
    else:
        focal = radius * (np.cos(high) + xi) / np.sin(high)
        truth = model_class("unified")(focal, focal, *at, xi)
    place = Pose(look(up=up) @ exp((0.05, -0.04, 0.3)), np.array((0.2, 0.1, -0.1)))
    renderer = Renderer(Camera(truth, size), place, scene_named("lines"), theta=(low, high), samples=2)
    gray = to_gray8(renderer(rng=np.random.default_rng(1), blur=0.8, noise=2.0, jpeg=90).image)
    field = estimate_image_field([gray])
    found = calibrate_arcs(PixelChains.from_arrays(detect_arcs(gray, field)), size, np.array(field.outer.centre))
    assert len(found.lines) > 20
    error = bearing_difference(found.camera.model, truth, found.lines.pixels)
    assert error < 2 * found.bearing_sigma
    assert found.bearing_sigma < np.radians(2.5)


@pytest.mark.parametrize("name", ["kaidan", "mei"])
def test_rows_of_real_boards_agree_with_a_board_calibration(data, name):
    # The reference is a calibration of the same corners by OpenCV (cv2.omnidir).
    import json

    folder = data("corners")
    with np.load(folder / f"{name}.npz") as stored:
        columns, rows = (int(n) for n in stored["pattern"])
        boards = stored["corners"].astype(float).reshape(-1, rows, columns, 2)
    theirs = json.loads((folder / "opencv_omnidir.json").read_text())[name]
    lines = [line for board in boards for line in (*board, *board.transpose(1, 0, 2))]
    found = calibrate_drawn(lines, size={"kaidan": (640, 480), "mei": (1280, 1024)}[name])
    off = np.hypot(found.camera.model.cx - theirs["c"][0], found.camera.model.cy - theirs["c"][1])
    values = found.camera.model.to_dict()
    focal = values["fx"] / (1 + values["xi"])
    assert np.degrees(off / focal) < 3 * np.degrees(found.bearing_sigma)
    assert np.log(focal * (1 + theirs["xi"]) / theirs["f"]) == pytest.approx(0, abs=0.1)
    assert np.degrees(found.bearing_sigma) < 2.0


def scene(folder, names, masked=False):
    grays = [to_gray8(read_image(folder / name)) for name in names]
    field = estimate_image_field(grays)
    masks = [None] * len(names)
    if masked:  # in this data set, black is visible
        masks = [to_gray8(read_image((folder / name).with_suffix(".pbm"))) < 128 for name in names]
    found = [detect_arcs(gray, field, mask) for gray, mask in zip(grays, masks, strict=True)]
    arcs = [arc for part in found for arc in part]
    image_ids = [i for i, part in enumerate(found) for _ in part]
    return PixelChains.from_arrays(arcs, image_ids), grays[0].shape[::-1], np.array(field.outer.centre)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "xi"),
    [
        (["paracat_1024x768_01.jpg"], (0.95, 1.25)),
        (["hypercat_1280x1024_01.jpg"], (0.7, 0.98)),
        (["fisheyeEquiangular_1024x768_03.jpg"], (1.5, 3.5)),
    ],
)
def test_one_image_distinguishes_mirrors_from_lenses(data, names, xi):
    arcs, size, centre = scene(data("line_images_unizar"), names, masked=True)
    found = calibrate_arcs(arcs, size, centre)
    assert len(found.lines) > 30
    assert found.rms < 0.6
    assert xi[0] < found.camera.model.to_dict()["xi"] < xi[1]
