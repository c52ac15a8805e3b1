"""omnisight view."""

import shutil

import cv2
import numpy as np
import pytest
from cli_scene import BOARD, QUICK, TRUTH, damage_image, file_names

import omnisight
from drawn import POSES, pose
from omnisight.camera import Camera
from omnisight.formats import load, save
from omnisight.images import read_image, write_image


@pytest.fixture
def photo(shots):
    return shots / "1.png"


@pytest.mark.parametrize(
    ("to", "size", "options"),
    [
        ("perspective", (1280, 720), ()),
        ("perspective", (320, 200), ("--size", "320x200", "--fov", "100", "--yaw", "20", "--roll", "-5")),
        ("cylinder", (512, 139), ("--size", "512", "--elevation", "-35:45")),
        ("mercator", (512, 283), ("--size", "512")),
        ("sphere", (512, 256), ("--size", "512")),
        ("sphere", (360, 120), ("--size", "360", "--azimuth", "-90,90", "--elevation", "-30:30")),
        ("cube", (400, 300), ("--size", "100")),
        ("planet", (200, 200), ("--size", "200")),
        ("fisheye", (200, 200), ("--size", "200", "--projection", "stereographic", "--fov", "150")),
        ("panini", (300, 200), ("--size", "300x200")),
    ],
)
def test_every_view_type_is_written_and_reported(run, photo, camera_file, tmp_path, to, size, options):
    out = tmp_path / "view.png"
    status, said, err = run("view", photo, "--camera", camera_file, "--to", to, *options, "-o", out)
    assert (status, err) == (0, "")
    assert read_image(out).shape == size[::-1]
    assert f"written   {out}" in said
    words = said.replace("%", "").split()
    kept, filled = float(words[words.index("of") - 1]), float(words[words.index("visible,") + 1])
    assert 0 < kept <= 101
    assert 0 < filled <= 100
    assert "px wide in the centre of the view" in said
    assert "at its edge" in said
    assert "nan" not in said


def test_perspective_view_straightens_the_board(run, shots, camera_file, tmp_path):
    out = tmp_path / "straight.png"
    run("view", shots / "1.png", "--camera", camera_file, "--fov", "100", "--size", "800x800", "-o", out)
    pinhole = omnisight.perspective((800, 800), 100)
    turn, position = pose(BOARD, *POSES[0])
    corners, _ = pinhole.project(BOARD.points @ turn.T + position)
    found = omnisight.targets.detect_checkerboard(read_image(out), BOARD)
    assert np.abs(found.pixels - corners[found.ids]).max() < 0.7


def test_several_images_go_to_a_folder(run, shots, camera_file, tmp_path):
    out = tmp_path / "new" / "views"
    status, said, _ = run("view", shots, "--camera", camera_file, "--size", "160x120", "-o", out)
    assert status == 0
    assert file_names(out) == file_names(shots)
    assert {read_image(path).shape for path in out.iterdir()} == {(120, 160)}
    assert str(out) in said


def test_images_with_the_same_name_do_not_overwrite_each_other(run, shots, camera_file, tmp_path):
    for name, number in (("left", 1), ("right", 2)):
        (tmp_path / name).mkdir()
        shutil.copy(shots / f"{number}.png", tmp_path / name / "a.png")
    out = tmp_path / "out"
    assert run("view", tmp_path / "left", tmp_path / "right", "--camera", camera_file, "-o", out)[0] == 0
    assert len(file_names(out)) == 2


def test_unusable_image_does_not_stop_the_others(run, folder, camera_file, tmp_path):
    damage_image(folder / "1.png", "truncated")
    write_image(folder / "3.png", np.zeros((100, 100), np.uint8))
    out = tmp_path / "out"
    status, _, err = run("view", folder, "--camera", camera_file, "--size", "160x120", "-o", out)
    assert status == 2
    assert file_names(out) == ["2.png", "4.png", "5.png", "6.png"]
    assert err.startswith("omnisight: 2 of 6 images were skipped")
    assert "1.jpg: truncated JPEG" in err
    assert "3.png: the image is 100x100, the camera 640x480" in err


def test_mask_and_camera_of_a_view(run, photo, camera_file, tmp_path):
    mask, camera = tmp_path / "mask.png", tmp_path / "view.json"
    run(
        *("view", photo, "--camera", camera_file, "--to", "cylinder", "--size", "400", "--yaw", "30"),
        *("-o", tmp_path / "v.png", "--mask", mask, "--view-camera", camera),
    )
    shown = read_image(mask)
    assert set(np.unique(shown)) == {0, 255}
    written = load(camera)
    assert written.model.name == "cylindrical"
    assert written.size == shown.shape[::-1]
    turn = np.array(written.provenance["target_from_source"])
    np.testing.assert_allclose(turn, omnisight.look(yaw=30))
    assert np.array_equal(shown > 0, omnisight.Remapper(TRUTH, written, turn).mask)
    # The view is an image of a camera: it can be looked into again.
    status, _, _ = run("view", tmp_path / "v.png", "--camera", camera, "--fov", "60", "-o", tmp_path / "again.png")
    assert status == 0


def test_sixteen_bit_images_stay_sixteen_bit(run, photo, camera_file, tmp_path):
    write_image(tmp_path / "deep.png", read_image(photo).astype(np.uint16) * 257)
    run("view", tmp_path / "deep.png", "--camera", camera_file, "-o", tmp_path / "v.png")
    assert read_image(tmp_path / "v.png").dtype == np.uint16


def test_resized_image_needs_a_scaled_camera(run, refuses, photo, camera_file, tmp_path):
    half = tmp_path / "half.png"
    write_image(half, cv2.resize(read_image(photo), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    small, large = tmp_path / "small.png", tmp_path / "large.png"
    said = refuses("view", half, "--camera", camera_file, "-o", small)
    assert "half.png: the image is 320x240, the camera 640x480: 0.5 times as large" in said
    assert "--scale-camera" in said
    assert not small.exists()
    options = ("--camera", camera_file, "--size", "200x150", "--fov", "70")
    assert run("view", half, *options, "--scale-camera", "-o", small)[0] == 0
    run("view", photo, *options, "-o", large)
    apart = np.abs(read_image(small).astype(float) - read_image(large))
    assert apart.mean() < 4


def test_rotated_image_is_rejected_with_the_reason(refuses, photo, camera_file, tmp_path):
    for options in ((), ("--scale-camera",)):
        turned = tmp_path / "turned.png"
        write_image(turned, np.ascontiguousarray(np.rot90(read_image(photo))))
        said = refuses("view", turned, "--camera", camera_file, *options, "-o", tmp_path / "v.png")
        assert "turned.png: the image is 480x640, the camera 640x480: rotated by 90 degrees" in said
        assert "EXIF" in said


def test_camera_without_a_size_uses_that_of_the_images(run, photo, camera_file, tmp_path):
    unsized = save(Camera(TRUTH.model, (0, 0)), tmp_path / "unsized.json").path
    views = [tmp_path / "one.png", tmp_path / "other.png"]
    for camera, view in zip((camera_file, unsized), views, strict=True):
        assert run("view", photo, "--camera", camera, "-o", view)[0] == 0
    assert np.array_equal(*(read_image(view) for view in views))
    status, out, _ = run("inspect", unsized)
    assert status == 0
    assert "size        not in the file" in out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--fov", "160"), "a perspective view cannot show 160 degrees, only up to 150: use cylinder, panini"),
        (("--fov", "0"), "a perspective view cannot show 0 degrees"),
        (("--to", "panini", "--fov", "359"), "a Panini view of distance 1 cannot show 359 degrees, only up to 353"),
        (("--to", "fisheye", "--fov", "0"), "cannot show 0 degrees"),
        (("--to", "fisheye", "--fov", "200", "--projection", "orthographic"), "only up to 180"),
        (("--to", "cylinder", "--elevation", "-95:10"), "elevation must be (low, high) within -89 to 89 degrees"),
        (("--to", "cylinder", "--elevation", "10"), "--elevation must be two numbers in degrees, such as"),
        (("--to", "sphere", "--azimuth", "a:b"), "--azimuth must be two numbers in degrees"),
        (
            ("--elevation", "-10:10"),
            "--elevation applies to cylinder, mercator and sphere; use --fov for a perspective",
        ),
        (("--to", "sphere", "--fov", "90"), "--fov does not apply to a sphere; use --azimuth"),
        (("--to", "cube", "--fov", "90"), "--fov does not apply to a cube; its faces are 90 degrees"),
        (("--size", "0x10"), "--size must be WIDTHxHEIGHT in px, such as 1280x720, got '0x10'"),
        (("--size", "tall"), "--size must be WIDTHxHEIGHT"),
        (("--size", "50000x10"), "--size must be from 1x1 to 32767x32767 px, got 50000x10"),
        (("--yaw", "nan"), "--yaw must be a number of degrees, got nan"),
        (("--roll", "inf"), "--roll must be a number of degrees, got inf"),
    ],
)
def test_impossible_views_are_rejected_and_write_nothing(refuses, photo, camera_file, tmp_path, options, said):
    before = file_names(tmp_path)
    assert said in refuses("view", photo, "--camera", camera_file, "-o", tmp_path / "v.png", *options)
    assert file_names(tmp_path) == before


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("v", "v: has no extension: name an image file, such as v.png"),
        ("v.xyz", "v.xyz: cannot write extension '.xyz'"),
        ("missing/v.png", "the folder"),
    ],
)
def test_unwritable_output_is_rejected_with_the_reason(refuses, photo, camera_file, tmp_path, name, said):
    assert said in refuses("view", photo, "--camera", camera_file, "-o", tmp_path / name)
    assert not (tmp_path / name).exists()


def test_single_image_can_go_to_a_folder(run, photo, camera_file, tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    status, out, _ = run("view", photo, "--camera", camera_file, "-o", place)
    assert status == 0
    assert f"written   {place / '1.png'}" in out
    assert file_names(place) == ["1.png"]


@pytest.mark.parametrize("command", ["one view", "views", "mask", "drawings"])
def test_input_images_are_never_overwritten(refuses, folder, camera_file, tmp_path, command):
    before = {path: path.read_bytes() for path in folder.iterdir()}
    arguments = {
        "one view": ("view", folder / "1.png", "--camera", camera_file, "-o", folder / "1.png"),
        "views": ("view", folder, "--camera", camera_file, "-o", folder),
        "mask": (
            "view",
            folder / "1.png",
            "--camera",
            camera_file,
            "-o",
            tmp_path / "v.png",
            "--mask",
            folder / "1.png",
        ),
        "drawings": ("calibrate", folder, *QUICK, "--draw", folder),
    }[command]
    said = refuses(*arguments)
    assert f"{folder / '1.png'}: is one of the inputs and would be overwritten" in said
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_drawings_need_a_folder_not_an_image_name(refuses, shots, tmp_path):
    said = refuses("detect", shots, "-o", tmp_path / "found.png")
    assert f"{tmp_path / 'found.png'}: has the name of an image; choose a folder" in said
    assert not (tmp_path / "found.png").exists()


def test_several_images_cannot_go_to_one_file(refuses, shots, camera_file, tmp_path):
    (tmp_path / "v.png").write_text("mine")
    said = refuses("view", shots, "--camera", camera_file, "-o", tmp_path / "v.png")
    assert f"{tmp_path / 'v.png'}: is a file; choose a folder for 6 images" in said
    assert (tmp_path / "v.png").read_text() == "mine"


DAMAGED = {
    "empty": ("", "empty file"),
    "prose": ("hello there", "not a calibration file of a known format (begins with 'hello there')"),
    "board": ('{"target": "checkerboard", "columns": 9}', "describes a board (--target), not a camera"),
    "half": ('{"format": "omnisight-camera", "version": 1, "mod', "omnisight JSON"),
    "other": ('{"format": "omnisight-scene", "version": 1}', "\"format\" is 'omnisight-scene'"),
    "newer": ('{"format": "omnisight-camera", "version": 99}', "version 99; this version of omnisight reads up to 1"),
    "bare": ('{"format": "omnisight-camera", "version": 1}', "missing model, params, size"),
    "model": (
        '{"format": "omnisight-camera", "version": 1, "model": "pinhol", "params": {}, "size": [1, 1]}',
        "unknown camera model 'pinhol' (did you mean pinhole?); there are: cassini",
    ),
    "number": (
        '{"format": "omnisight-camera", "version": 1, "model": "pinhole",'
        ' "params": {"fx": "x", "fy": 1, "cx": 1, "cy": 1}, "size": [1, 1]}',
        "fx must be a number, got 'x'",
    ),
}


@pytest.mark.parametrize("command", ["view", "inspect", "convert"])
@pytest.mark.parametrize("how", DAMAGED)
def test_damaged_camera_files_are_rejected_by_name(refuses, photo, tmp_path, how, command):
    text, expected = DAMAGED[how]
    path = tmp_path / "camera.json"
    path.write_text(text)
    arguments = {
        "view": ("view", photo, "--camera", path, "-o", tmp_path / "v.png"),
        "inspect": ("inspect", path),
        "convert": ("convert", path, "--to", "native", "-o", tmp_path / "v.json"),
    }[command]
    said = refuses(*arguments)
    assert str(path) in said
    assert expected in said
    assert file_names(tmp_path) == ["camera.json"]


@pytest.mark.parametrize("what", ["missing", "folder", "image"])
def test_files_that_are_no_camera_are_rejected_by_name(refuses, photo, tmp_path, what):
    path = {"missing": tmp_path / "no.json", "folder": tmp_path, "image": photo}[what]
    said = refuses("view", photo, "--camera", path, "-o", tmp_path / "v.png")
    assert str(path) in said
    expected = {"missing": "no such file", "folder": "is a folder", "image": "is an image, not a calibration file"}
    assert expected[what] in said


def test_extrapolated_pixels_are_reported_and_hatched_on_request(run, photo, tmp_path):
    camera = Camera(TRUTH.model, (640, 480), theta_max=np.radians(40.0))
    save(camera, tmp_path / "camera.json")
    view = ("view", photo, "--camera", tmp_path / "camera.json", "--to", "fisheye", "--fov", "140", "--size", "400")
    status, said, _ = run(*view, "-o", tmp_path / "plain.png")
    assert status == 0
    assert "beyond 40 degrees, outside the calibrated field of view; --mark hatches it" in said
    status, said, _ = run(*view, "--mark", "-o", tmp_path / "marked.png", "--mask", tmp_path / "mask.png")
    assert status == 0
    assert "--mark" not in said
    plain, marked = (read_image(tmp_path / name).astype(int) for name in ("plain.png", "marked.png"))
    changed = (plain != marked).reshape(*plain.shape[:2], -1).any(-1)
    v, u = np.indices(changed.shape)
    angle = np.hypot(u - 199.5, v - 199.5) / 200 * 70
    assert not changed[angle < 39.7].any()
    assert not changed[read_image(tmp_path / "mask.png") == 0].any()
    share = changed[(angle > 41) & (read_image(tmp_path / "mask.png") > 0)].mean()
    assert 0.1 < share < 0.4


def test_neither_the_camera_nor_the_view_is_replaced(refuses, photo, tmp_path):
    save(Camera(TRUTH.model, (640, 480)), tmp_path / "camera.json")
    before = (tmp_path / "camera.json").read_bytes()
    view = ("view", photo, "--camera", tmp_path / "camera.json", "-o", tmp_path / "view.png")
    assert "camera.json: is one of the inputs" in refuses(*view, "--view-camera", tmp_path / "camera.json")
    assert (tmp_path / "camera.json").read_bytes() == before
    assert "have the same file" in refuses(*view, "--mask", tmp_path / "view.png")


def test_verdict_do_not_use_is_reported_with_every_view(run, photo, tmp_path):
    figures = {"verdict": "do not use", "reasons": ["The boards tilt only 3 degrees."]}
    save(Camera(TRUTH.model, (640, 480), calibration=figures), tmp_path / "camera.json")
    _, said, _ = run("view", photo, "--camera", tmp_path / "camera.json", "-o", tmp_path / "view.png")
    assert "the verdict of this calibration is: do not use. The boards tilt only 3 degrees." in said


def test_an_image_twice_as_wide_as_high_needs_no_camera(run, photo, tmp_path):
    wide = np.zeros((200, 400, 3), np.uint8)
    wide[:, 300:] = 200, 100, 50  # from 90° to 180° to the right
    write_image(tmp_path / "360.png", wide)
    status, _, err = run("view", tmp_path / "360.png", "--yaw", "135", "--fov", "60", "-o", tmp_path / "right.png")
    assert (status, err) == (0, "")
    assert (read_image(tmp_path / "right.png") == (200, 100, 50)).all()
    said = run("view", tmp_path / "360.png", "--to", "cube", "--size", "64", "-o", tmp_path / "cube.png")[1]
    assert "100% of the image is visible, 100% of the view is covered" in said
    status, _, err = run("view", photo, "-o", tmp_path / "view.png")
    assert status == 2
    assert "only 2:1 equirectangular images need no camera" in err


def test_a_view_of_which_the_camera_sees_nothing_is_not_written(run, shots, photo, camera_file, tmp_path):
    narrow = ("--camera", camera_file, "--yaw", "180", "--fov", "10")
    status, _, err = run("view", photo, *narrow, "-o", tmp_path / "black.png")
    assert status == 2
    assert "the camera sees no part of the view" in err
    status, _, err = run("view", shots, *narrow, "-o", tmp_path / "black")
    assert status == 2
    assert "the camera sees no part of the view" in err
    assert not list(tmp_path.rglob("*.png"))
