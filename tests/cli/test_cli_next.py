"""omnisight next."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.io
from cli_scene import BOARD, SIZE, TRUTH, project_boards

from omnisight.formats import save
from omnisight.images import read_image, write_image


@pytest.fixture
def calibrated(tmp_path):
    """Write a camera file that contains its board."""
    camera = replace(TRUTH, provenance={"target": {**BOARD.to_dict(), "square": "30mm"}})
    return save(camera, tmp_path / "calibrated.json").path


PLACEMENT = re.compile(
    r"^(\d)\. hold the board (?:in the centre|half-way to the [a-z ]+ edge|near the [a-z ]+ edge)"
    r" \(pixel (\d+), (\d+)\), (\S+ (?:m|squares)) \((\d\.\d) board widths\) away, (.*):"
    r" worst-case uncertainty (\d[.\d]*) px -> (\d[.\d]*) px$",
    re.MULTILINE,
)


def test_it_prints_where_how_far_and_how_tilted(run, shots, calibrated):
    status, out, err = run("next", shots, "--camera", calibrated)
    assert (status, err) == (0, "")
    assert "6 of 6 show the 9x6 board" in out
    assert re.search(r"^worst +\d[.\d]* px \(1σ\), \d+° off-axis, \w+", out, re.MULTILINE)
    views = PLACEMENT.findall(out)
    assert [view[0] for view in views] == ["1", "2", "3"]
    assert all(float(view[7]) < float(view[6]) for view in views)
    assert [view[7] for view in views[:-1]] == [view[6] for view in views[1:]]
    for *_, length, widths, tilt, _, _ in views:
        # The size of the board comes from the camera file: 8 squares of 30 mm.
        assert float(length.removesuffix(" m")) == pytest.approx(0.24 * float(widths), abs=0.02)
        assert re.fullmatch(r"tilted (30|45)° with its (upper|lower|left|right) edge nearer|facing the camera", tilt)
    # Six images determine a lens with four parameters well.
    assert "further images would reduce it only slightly" in out


def test_json_is_one_object_with_poses(run, shots, calibrated):
    status, out, err = run("next", shots, "--camera", calibrated, "--count", 2, "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert result["images"] == 6
    assert result["board"]["square"] == "30mm"
    assert result["worst"]["px"] >= result["worst_calibrated"]["px"] > 0
    assert len(result["next"]) == 2
    for view in result["next"]:
        rotation = np.array(view["cam_from_board"]["rotation"])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        middle = rotation @ [0.12, 0.075, 0] + view["cam_from_board"]["translation"]
        assert np.linalg.norm(middle) == pytest.approx(view["distance"])
        np.testing.assert_allclose(TRUTH.project(middle)[0], view["pixel"], atol=3)
        assert view["unit"] == "m"
        assert view["after"]["px"] < view["before"]["px"]
        assert view["description"].startswith("hold the board ")


def test_the_nearer_edge_is_named_as_seen_in_the_image(run, shots, calibrated):
    result = json.loads(run("next", shots, "--camera", calibrated, "--json")[1])
    tilted = [view for view in result["next"] if view["tilt_deg"]]
    assert tilted
    for view in tilted:
        rotation, translation = (np.array(view["cam_from_board"][key]) for key in ("rotation", "translation"))
        corners = BOARD.points * 0.03 @ rotation.T + translation
        pixels, _ = TRUTH.project(corners)
        # The nearest corners lie between the board's centre and the named edge.
        near = pixels[np.argsort(np.linalg.norm(corners, axis=1))[:6]].mean(0) - view["pixel"]
        u, v = near
        name = ("right" if u > 0 else "left") if abs(u) > abs(v) else ("lower" if v > 0 else "upper")
        assert view["nearer_edge"] == name


def test_the_drawing_shows_the_boards_over_an_image(run, shots, calibrated, tmp_path):
    drawn = tmp_path / "next.png"
    status, out, _ = run("next", shots, "--camera", calibrated, "-o", drawn, "--count", 1)
    assert status == 0
    assert f"drawn     {drawn}" in out
    image = read_image(drawn)
    assert image.shape[1] > image.shape[0] > SIZE[1]
    # The proposed board is black and white, at the printed pixel.
    u, v = map(int, re.search(r"\(pixel (\d+), (\d+)\)", out).groups())
    zoom = image.shape[0] / SIZE[1]
    patch = image[round(v * zoom) - 80 : round(v * zoom) + 80, round(u * zoom) - 80 : round(u * zoom) + 80]
    assert patch.min() < 60
    assert (patch.min(2) > 180).mean() > 0.1


def test_without_a_board_in_the_camera_file_it_is_detected(run, shots, camera_file):
    status, out, _ = run("next", shots, "--camera", camera_file, "--count", 1)
    assert status == 0
    assert "the 9x6 board" in out
    assert re.search(r"\d squares \(\d\.\d board widths\) away", out)


def test_another_camera_is_rejected(refuses, shots, tmp_path):
    other = save(replace(TRUTH, size=(1280, 960)), tmp_path / "other.json").path
    error = refuses("next", shots, "--camera", other)
    assert "other.json: the images are 640x480, the camera is 1280x960" in error
    narrow = save(
        replace(TRUTH, model=TRUTH.model.with_params([9.0, 900.0, 10.0, 10.0])), tmp_path / "narrow.json"
    ).path
    assert "does not fit these images" in refuses("next", shots, "--camera", narrow)


def test_a_missing_image_size_is_that_of_the_images(run, shots, tmp_path):
    unsized = save(replace(TRUTH, size=(0, 0)), tmp_path / "unsized.json").path
    assert run("next", shots, "--camera", unsized, "--count", 1)[0] == 0


@pytest.mark.parametrize("target", [{"target": "checkerboard"}, {"target": "../x", "columns": 9}, {"columns": "many"}])
def test_an_invalid_board_in_the_camera_file_is_rejected(refuses, shots, tmp_path, target):
    spoilt = save(replace(TRUTH, provenance={"target": target}), tmp_path / "spoilt.json").path
    error = refuses("next", shots, "--camera", spoilt)
    assert "spoilt.json: provenance, target" in error
    assert "specify --pattern or --target" in error


def test_invalid_options_are_rejected_before_detection(refuses, folder, calibrated, tmp_path):
    assert "count is 0" in refuses("next", folder, "--camera", calibrated, "--count", 0)
    assert "holds the images" in refuses("next", folder, "--camera", calibrated, "-o", folder / "next.png")
    assert "is one of the inputs" in refuses("next", folder, "--camera", calibrated, "-o", folder / "1.png")
    assert "no folder" in refuses("next", folder, "--camera", calibrated, "-o", tmp_path / "none" / "next.png")
    assert ".png or .jpg" in refuses("next", folder, "--camera", calibrated, "-o", tmp_path / "next.txt")


def test_images_without_a_board_are_rejected(refuses, calibrated, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    write_image(empty / "1.png", np.full(SIZE[::-1], 90, np.uint8))
    error = refuses("next", empty, "--camera", calibrated)
    assert "detected in none of 1 images" in error
    assert "1.png" in error


@pytest.fixture
def corners(tmp_path):
    np.savez(tmp_path / "shots.npz", corners=project_boards(6), pattern=(9, 6), image_size=SIZE)
    return tmp_path / "shots.npz"


def test_corner_files_are_read_instead_of_images(run, corners, camera_file, tmp_path):
    drawn = tmp_path / "next.png"  # in the folder of the corners, which holds no images
    status, out, err = run("next", corners, "--camera", camera_file, "-o", drawn)
    assert (status, err) == (0, "")
    assert "6 of 6 show the 9x6 board, 324 corners" in out
    views = PLACEMENT.findall(out)
    assert len(views) == 3
    assert all(float(view[7]) < float(view[6]) for view in views)
    # The drawing is over a blank frame with the shape of an image.
    image = read_image(drawn)
    assert image.shape[0] == 1500 * SIZE[1] // SIZE[0]
    assert image.shape[1] > 1500
    u, v = map(int, re.search(r"\(pixel (\d+), (\d+)\)", out).groups())
    zoom = 1500 / SIZE[0]
    patch = image[round(v * zoom) - 80 : round(v * zoom) + 80, round(u * zoom) - 80 : round(u * zoom) + 80]
    assert patch.min() < 60


def test_corners_and_their_images_get_the_same_proposal(run, shots, calibrated, tmp_path):
    (tmp_path / "corners.json").write_text(run("detect", shots, "--pattern", "9x6", "--square", "30mm", "--json")[1])
    results = [
        json.loads(run("next", given, "--camera", calibrated, "--json")[1])
        for given in (shots, tmp_path / "corners.json")
    ]
    assert results[0]["board"] == results[1]["board"]
    for ours, theirs in [(results[0]["next"][0], results[1]["next"][0])]:
        assert theirs["after"]["px"] == pytest.approx(ours["after"]["px"], rel=0.2)
        assert theirs["unit"] == ours["unit"] == "m"
        assert theirs["distance_widths"] == pytest.approx(ours["distance_widths"], rel=0.2)


def test_the_drawing_uses_the_image_next_to_the_corner_file(run, camera_file, tmp_path):
    for k in range(4):
        write_image(tmp_path / f"{k}.png", np.full(SIZE[::-1], 20, np.uint8))
    np.savez(tmp_path / "v.npz", corners=project_boards(4), pattern=(9, 6), files=[f"{k}.png" for k in range(4)])
    out = tmp_path / "out"
    out.mkdir()
    assert run("next", tmp_path / "v.npz", "--camera", camera_file, "-o", out / "beside.png")[0] == 0
    np.savez(tmp_path / "w.npz", corners=project_boards(4), pattern=(9, 6), image_size=SIZE)
    assert run("next", tmp_path / "w.npz", "--camera", camera_file, "-o", out / "bare.png")[0] == 0
    dark, empty = (read_image(out / name)[: 1500 * SIZE[1] // SIZE[0], :1500] for name in ("beside.png", "bare.png"))
    assert np.median(dark) + 20 < np.median(empty)


def test_a_camera_calibrated_from_corners_continues_from_them(run, corners, tmp_path):
    quick = ("--model", "equidistant", "--square", "30mm", "--quiet")
    assert run("calibrate", corners, *quick, "-o", tmp_path / "camera.json")[0] == 0
    status, out, _ = run("next", corners, "--camera", tmp_path / "camera.json", "--square", "30mm", "--json")
    assert status == 0
    result = json.loads(out)
    assert result["board"] == {"target": "checkerboard", "columns": 9, "rows": 6, "square": "30mm"}
    assert result["next"][0]["unit"] == "m"


def test_the_warp_of_a_given_board_does_not_depend_on_its_frame(run, tmp_path):
    """Points in another order and with another origin are the same board."""
    found, moved = project_boards(6), np.add(BOARD.points[:, :2][::-1], (4, -7))
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
def cube_corners(tmp_path):
    """Write corners of two perpendicular boards to a .mat file of BabelCalib."""
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


def test_points_of_a_rigid_body_need_a_board_to_hold(run, refuses, cube_corners, camera_file, calibrated):
    error = refuses("next", cube_corners, "--camera", camera_file)
    assert "the board to hold is unknown, because the corners are of 102 points of a rigid body" in error
    assert "with --pattern, such as 9x6, or --target" in error
    status, out, _ = run("next", cube_corners, "--camera", calibrated, "--count", 1)
    assert status == 0
    assert "5 of 5 show 102 points of a rigid body" in out


def test_for_points_without_a_grid_a_board_of_the_same_size_is_proposed(run, camera_file, tmp_path):
    kept = np.random.default_rng(0).permutation(54)[:40]
    np.savez(tmp_path / "some.npz", imgpoints=project_boards(6)[:, kept], objpoints=BOARD.points[kept], image_size=SIZE)
    status, out, _ = run("next", tmp_path / "some.npz", "--camera", camera_file, "--json")
    assert status == 0
    board = json.loads(out)["board"]
    assert (board["columns"], board["rows"]) == (9, 6)
    assert "show 40 points, 240 corners" in run("next", tmp_path / "some.npz", "--camera", camera_file)[1]


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("no size", "specify --image-size, such as 1280x800 (corners reach"),
        ("a size with images", "--image-size is for corner files; images contain their size: leave it out"),
        ("a camera with images", "--which is for corner files of several cameras"),
        ("a drawing over an image beside", "is one of the inputs and would be overwritten"),
        ("too few", "none of 2 images has enough corners"),
        ("a board of another unit", " in squares is not known: specify --pattern, such as 9x6, instead"),
    ],
)
def test_errors_of_corner_files_are_reported(case, message, refuses, corners, shots, camera_file, tmp_path):
    command = [corners]
    match case:
        case "no size":
            np.savez(corners, corners=project_boards(4), pattern=(9, 6))
        case "a size with images":
            command = [shots, "--image-size", "640x480"]
        case "a camera with images":
            command = [shots, "--which", "left"]
        case "a board of another unit":
            np.savez(corners, imgpoints=project_boards(6), objpoints=BOARD.points, image_size=SIZE)
            grid = {"target": "aprilgrid", "columns": 6, "rows": 6, "tag": "30mm", "spacing": 0.3}
            (tmp_path / "grid.json").write_text(json.dumps(grid))
            command += ["--target", tmp_path / "grid.json"]
        case "too few":
            found = project_boards(2)
            found[:, 4:] = np.nan
            np.savez(corners, corners=found, pattern=(9, 6), image_size=SIZE)
        case _:
            write_image(tmp_path / "0.png", np.zeros(SIZE[::-1], np.uint8))
            np.savez(corners, corners=project_boards(1), pattern=(9, 6), files=["0.png"])
            command += ["-o", tmp_path / "0.png"]
    assert message in refuses("next", *command, "--camera", camera_file)
