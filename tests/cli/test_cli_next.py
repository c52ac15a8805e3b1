"""omnisight next."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.io
from shooting import BOARD, SIZE, TRUTH, seen

from omnisight.formats import save
from omnisight.images import read_image, write_image


@pytest.fixture
def calibrated(tmp_path):
    """Give the file of a camera that knows its board."""
    camera = replace(TRUTH, provenance={"target": {**BOARD.to_dict(), "square": "30mm"}})
    return save(camera, tmp_path / "calibrated.json").path


def test_it_says_where_how_far_and_how_tilted(run, shots, calibrated):
    status, out, err = run("next", shots, "--camera", calibrated)
    assert (status, err) == (0, "")
    assert "6 of 6 images show the 9x6 board" in out
    assert re.search(r"^least sure: \d+\.\d+ px at \d+ degrees \w+", out, re.MULTILINE)
    gains = re.findall(r"^(\d)\. worst uncertainty (\d+\.\d+) px .* -> (\d+\.\d+) px", out, re.MULTILINE)
    assert [number for number, _, _ in gains] == ["1", "2", "3"]
    assert all(float(after) < float(before) for _, before, after in gains)
    assert [after for *_, after in gains[:-1]] == [before for _, before, _ in gains[1:]]
    assert len(re.findall(r"Where: .* at pixel \(\d+, \d+\), \d+ degrees from the axis\.", out)) == 3
    # The length of the board comes with the camera's file: 8 squares of 30 mm.
    for widths, centimetres in re.findall(r"How far: (\d\.\d) board widths \((\d+) cm\)", out):
        assert float(centimetres) == pytest.approx(24 * float(widths), abs=2)
    tilts = re.findall(r"How tilted: (.*)\.$", out, re.MULTILINE)
    assert len(tilts) == 3
    for tilt in tilts:
        told = r"(30|45) degrees, its (upper|lower|left|right) edge towards the camera|not at all: it faces the camera"
        assert re.fullmatch(told, tilt)
    # A lens with four numbers is known well from six images.
    assert "more images will hardly help" in out


def test_json_is_one_object_with_poses(run, shots, calibrated):
    status, out, err = run("next", shots, "--camera", calibrated, "--count", 2, "--json")
    assert (status, err) == (0, "")
    said = json.loads(out)
    assert said["images"] == 6
    assert said["board"]["square"] == "30mm"
    assert said["worst"]["px"] >= said["worst_calibrated"]["px"] > 0
    assert len(said["next"]) == 2
    for view in said["next"]:
        rotation = np.array(view["cam_from_board"]["rotation"])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        middle = rotation @ [0.12, 0.075, 0] + view["cam_from_board"]["translation"]
        assert np.linalg.norm(middle) == pytest.approx(view["distance"])
        np.testing.assert_allclose(TRUTH.project(middle)[0], view["pixel"], atol=3)
        assert view["unit"] == "m"
        assert view["after"]["px"] < view["before"]["px"]
        assert view["words"].startswith("Where: ")


def test_the_nearer_edge_is_named_as_the_picture_shows_it(run, shots, calibrated):
    said = json.loads(run("next", shots, "--camera", calibrated, "--json")[1])
    tilted = [view for view in said["next"] if view["tilt_deg"]]
    assert tilted
    for view in tilted:
        rotation, translation = (np.array(view["cam_from_board"][key]) for key in ("rotation", "translation"))
        corners = BOARD.points * 0.03 @ rotation.T + translation
        pixels, _ = TRUTH.project(corners)
        # The nearest corners lie, from the board's middle, towards the edge that is named.
        near = pixels[np.argsort(np.linalg.norm(corners, axis=1))[:6]].mean(0) - view["pixel"]
        u, v = near
        name = ("right" if u > 0 else "left") if abs(u) > abs(v) else ("lower" if v > 0 else "upper")
        assert view["nearer_edge"] == name


def test_the_drawing_shows_the_boards_over_a_picture(run, shots, calibrated, tmp_path):
    drawn = tmp_path / "next.png"
    status, out, _ = run("next", shots, "--camera", calibrated, "-o", drawn, "--count", 1)
    assert status == 0
    assert f"drawn: {drawn}" in out
    image = read_image(drawn)
    assert image.shape[1] > image.shape[0] > SIZE[1]
    # The proposed board is black and white, at the pixel that is told.
    u, v = map(int, re.search(r"at pixel \((\d+), (\d+)\)", out).groups())
    zoom = image.shape[0] / SIZE[1]
    patch = image[round(v * zoom) - 80 : round(v * zoom) + 80, round(u * zoom) - 80 : round(u * zoom) + 80]
    assert patch.min() < 60
    assert (patch.min(2) > 180).mean() > 0.1


def test_a_camera_without_a_board_leaves_it_to_the_pictures(run, shots, camera_file):
    status, out, _ = run("next", shots, "--camera", camera_file, "--count", 1)
    assert status == 0
    assert "the 9x6 board" in out
    assert "squares) from the camera" in out


def test_another_camera_is_refused(refuses, shots, tmp_path):
    other = save(replace(TRUTH, size=(1280, 960)), tmp_path / "other.json").path
    said = refuses("next", shots, "--camera", other)
    assert "the images are 640x480, the camera 1280x960" in said
    narrow = save(
        replace(TRUTH, model=TRUTH.model.with_params([9.0, 900.0, 10.0, 10.0])), tmp_path / "narrow.json"
    ).path
    assert "does not explain these images" in refuses("next", shots, "--camera", narrow)


def test_a_size_that_the_file_does_not_say_is_that_of_the_pictures(run, shots, tmp_path):
    unsized = save(replace(TRUTH, size=(0, 0)), tmp_path / "unsized.json").path
    assert run("next", shots, "--camera", unsized, "--count", 1)[0] == 0


@pytest.mark.parametrize("target", [{"target": "checkerboard"}, {"target": "../x", "columns": 9}, {"columns": "many"}])
def test_a_board_in_the_file_that_is_none_is_refused(refuses, shots, tmp_path, target):
    spoilt = save(replace(TRUTH, provenance={"target": target}), tmp_path / "spoilt.json").path
    said = refuses("next", shots, "--camera", spoilt)
    assert "spoilt.json: provenance, target" in said
    assert "give --pattern or --target" in said


def test_what_cannot_work_is_said_before_the_work(refuses, folder, calibrated, tmp_path):
    assert "--count is 0" in refuses("next", folder, "--camera", calibrated, "--count", 0)
    assert "holds the images" in refuses("next", folder, "--camera", calibrated, "-o", folder / "next.png")
    assert "is one of the images" in refuses("next", folder, "--camera", calibrated, "-o", folder / "1.png")
    assert "no folder" in refuses("next", folder, "--camera", calibrated, "-o", tmp_path / "none" / "next.png")
    assert ".png or .jpg" in refuses("next", folder, "--camera", calibrated, "-o", tmp_path / "next.txt")


def test_pictures_without_a_board_are_refused(refuses, calibrated, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    write_image(empty / "1.png", np.full(SIZE[::-1], 90, np.uint8))
    said = refuses("next", empty, "--camera", calibrated)
    assert "found in none of 1 images" in said
    assert "1.png" in said


@pytest.fixture
def corners(tmp_path):
    np.savez(tmp_path / "shots.npz", corners=seen(6), pattern=(9, 6), image_size=SIZE)
    return tmp_path / "shots.npz"


def test_corners_are_taken_in_place_of_pictures(run, corners, camera_file, tmp_path):
    drawn = tmp_path / "next.png"  # beside the corners: nothing there is taken for an image
    status, out, err = run("next", corners, "--camera", camera_file, "-o", drawn)
    assert (status, err) == (0, "")
    assert "6 of 6 images show the 9x6 board, 324 corners" in out
    gains = re.findall(r"^\d\. worst uncertainty (\d+\.\d+) px .* -> (\d+\.\d+) px", out, re.MULTILINE)
    assert len(gains) == 3
    assert all(float(after) < float(before) for before, after in gains)
    # The frame that it is drawn over is empty: as high as an image, and grey where there is nothing.
    image = read_image(drawn)
    assert image.shape[0] == 1500 * SIZE[1] // SIZE[0]
    assert image.shape[1] > 1500
    u, v = map(int, re.search(r"at pixel \((\d+), (\d+)\)", out).groups())
    zoom = 1500 / SIZE[0]
    patch = image[round(v * zoom) - 80 : round(v * zoom) + 80, round(u * zoom) - 80 : round(u * zoom) + 80]
    assert patch.min() < 60


def test_corners_and_the_pictures_they_are_from_propose_alike(run, shots, calibrated, tmp_path):
    (tmp_path / "corners.json").write_text(run("detect", shots, "--pattern", "9x6", "--square", "30mm", "--json")[1])
    said = [
        json.loads(run("next", given, "--camera", calibrated, "--json")[1])
        for given in (shots, tmp_path / "corners.json")
    ]
    assert said[0]["board"] == said[1]["board"]
    for ours, theirs in zip(said[0]["next"][:1], said[1]["next"], strict=False):
        assert theirs["after"]["px"] == pytest.approx(ours["after"]["px"], rel=0.2)
        assert theirs["unit"] == ours["unit"] == "m"
        assert theirs["distance_widths"] == pytest.approx(ours["distance_widths"], rel=0.2)


def test_what_is_drawn_over_is_the_picture_beside_the_corners(run, camera_file, tmp_path):
    for k in range(4):
        write_image(tmp_path / f"{k}.png", np.full(SIZE[::-1], 20, np.uint8))
    np.savez(tmp_path / "v.npz", corners=seen(4), pattern=(9, 6), files=[f"{k}.png" for k in range(4)])
    out = tmp_path / "out"
    out.mkdir()
    assert run("next", tmp_path / "v.npz", "--camera", camera_file, "-o", out / "beside.png")[0] == 0
    np.savez(tmp_path / "w.npz", corners=seen(4), pattern=(9, 6), image_size=SIZE)
    assert run("next", tmp_path / "w.npz", "--camera", camera_file, "-o", out / "bare.png")[0] == 0
    dark, empty = (read_image(out / name)[: 1500 * SIZE[1] // SIZE[0], :1500] for name in ("beside.png", "bare.png"))
    assert np.median(dark) + 20 < np.median(empty)


def test_a_camera_calibrated_from_corners_goes_on_from_them(run, corners, tmp_path):
    quick = ("--model", "equidistant", "--square", "30mm", "--quiet")
    assert run("calibrate", corners, *quick, "-o", tmp_path / "camera.json")[0] == 0
    status, out, _ = run("next", corners, "--camera", tmp_path / "camera.json", "--square", "30mm", "--json")
    assert status == 0
    said = json.loads(out)
    assert said["board"] == {"target": "checkerboard", "columns": 9, "rows": 6, "square": "30mm"}
    assert said["next"][0]["unit"] == "m"


def test_the_bend_of_a_board_that_was_given_stays_where_it_was(run, tmp_path):
    """Points in another order and from another origin are the same board."""
    found, moved = seen(6), np.add(BOARD.points[:, :2][::-1], (4, -7))
    np.savez(tmp_path / "a.npz", corners=found, pattern=(9, 6), image_size=SIZE)
    np.savez(tmp_path / "b.npz", imgpoints=found[:, ::-1], objpoints=moved, image_size=SIZE)
    camera = save(replace(TRUTH, calibration={"board_warp": [0.0, 0.0]}), tmp_path / "camera.json").path
    one, other = (
        json.loads(run("next", tmp_path / name, "--camera", camera, "--count", 1, "--json")[1])["next"][0]
        for name in ("a.npz", "b.npz")
    )
    assert other["after"]["px"] == pytest.approx(one["after"]["px"], rel=1e-3)
    assert other["pixel"] == pytest.approx(one["pixel"], abs=0.5)


@pytest.fixture
def of_a_cube(tmp_path):
    """Corners of two boards at right angles, in a .mat of BabelCalib."""
    folded = np.array([(0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
    points = np.concatenate([BOARD.points, BOARD.points @ folded.T])
    which = np.stack([np.tile(np.arange(54) + 1.0, 2), np.repeat((1.0, 2.0), 54)])
    pixels = [TRUTH.project(np.add(points, (k - 2.0, 0.5 * k - 1, 14.0)))[0] for k in range(5)]
    noise = np.random.default_rng(0)
    corners = {"x": [found.T + 1 + noise.normal(0, 0.1, (2, 108)) for found in pixels], "cspond": [which] * 5}

    def structs(**fields):
        made = np.empty((1, len(next(iter(fields.values())))), [(name, object) for name in fields])
        for name, values in fields.items():
            made[name][0] = [*values]
        return made

    poses = [np.eye(3, 4), np.column_stack([folded, np.zeros(3)])]
    boards = structs(X=[BOARD.points[:, :2].T] * 2, Rt=poses)
    scipy.io.savemat(
        tmp_path / "cube.mat", {"corners": structs(**corners), "boards": boards, "imgsize": np.array(SIZE[::-1], float)}
    )
    return tmp_path / "cube.mat"


def test_of_a_solid_body_it_is_asked_what_to_hold_up(run, refuses, of_a_cube, camera_file, calibrated):
    said = refuses("next", of_a_cube, "--camera", camera_file)
    assert "which board to hold up is not known, for the corners are of 102 points of a solid body" in said
    assert "give --pattern, such as 9x6, or --target" in said
    status, out, _ = run("next", of_a_cube, "--camera", calibrated, "--count", 1)
    assert status == 0
    assert "5 of 5 images show 102 points of a solid body" in out


def test_of_points_that_are_no_grid_a_board_as_large_is_held(run, camera_file, tmp_path):
    kept = np.random.default_rng(0).permutation(54)[:40]
    np.savez(tmp_path / "some.npz", imgpoints=seen(6)[:, kept], objpoints=BOARD.points[kept], image_size=SIZE)
    status, out, _ = run("next", tmp_path / "some.npz", "--camera", camera_file, "--json")
    assert status == 0
    board = json.loads(out)["board"]
    assert (board["columns"], board["rows"]) == (9, 6)
    assert "show 40 points, 240 corners" in run("next", tmp_path / "some.npz", "--camera", camera_file)[1]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("no size", "give --image-size, such as 1280x800 (corners reach"),
        ("a size with images", "--image-size is for files of corners; images say how large they are"),
        ("a camera with images", "--which is for files of corners of several cameras"),
        ("a drawing over an image beside", "is one of the images and would be lost"),
        ("too few", "none of 2 images has corners enough"),
        ("a board of another unit", " is in squares is not known: give --pattern, such as 9x6, instead"),
    ],
)
def test_what_is_wrong_with_corners_is_said(given, said, refuses, corners, shots, camera_file, tmp_path):
    command = [corners]
    match given:
        case "no size":
            np.savez(corners, corners=seen(4), pattern=(9, 6))
        case "a size with images":
            command = [shots, "--image-size", "640x480"]
        case "a camera with images":
            command = [shots, "--which", "left"]
        case "a board of another unit":
            np.savez(corners, imgpoints=seen(6), objpoints=BOARD.points, image_size=SIZE)
            grid = {"target": "aprilgrid", "columns": 6, "rows": 6, "tag": "30mm", "spacing": 0.3}
            (tmp_path / "grid.json").write_text(json.dumps(grid))
            command += ["--target", tmp_path / "grid.json"]
        case "too few":
            found = seen(2)
            found[:, 4:] = np.nan
            np.savez(corners, corners=found, pattern=(9, 6), image_size=SIZE)
        case _:
            write_image(tmp_path / "0.png", np.zeros(SIZE[::-1], np.uint8))
            np.savez(corners, corners=seen(1), pattern=(9, 6), files=["0.png"])
            command += ["-o", tmp_path / "0.png"]
    assert said in refuses("next", *command, "--camera", camera_file)
