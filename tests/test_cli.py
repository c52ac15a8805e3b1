"""The command line: what it says, what it writes, and how it refuses."""

import json
import shutil
import struct
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

import omnisight
from omnisight import cli
from omnisight.camera import Camera
from omnisight.formats import load, save
from omnisight.images import read_image, write_image
from omnisight.models import model_class, model_names
from omnisight.targets import Board
from test_checkerboard import CENTRE, FOCAL, POSES, SIZE, pose, render

BOARD = Board(9, 6)
TRUTH = Camera(model_class("equidistant")(FOCAL, FOCAL, *CENTRE), SIZE, theta_max=1.4)
QUICK = ("--pattern", "9x6", "--model", "equidistant")


@pytest.fixture(scope="session")
def shots(tmp_path_factory):
    """Six pictures of a board through a fisheye, and the cache that every test of this file shares."""
    folder = tmp_path_factory.mktemp("shots")
    for i, view in enumerate(POSES):
        write_image(folder / f"{i + 1}.png", render(BOARD, *pose(BOARD, *view))[0])
    return folder


@pytest.fixture(scope="session")
def shared_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def environment(shared_cache, monkeypatch):
    # Detections alone: what is compiled stays where it is.
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: shared_cache)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")


@pytest.fixture
def folder(shots, tmp_path):
    """Give a folder of the pictures that a test may spoil."""
    return shutil.copytree(shots, tmp_path / "shots")


@pytest.fixture
def camera_file(tmp_path):
    return save(TRUTH, tmp_path / "camera.json").path


@pytest.fixture
def run(capsys):
    """Run the command line in this process; give exit status, stdout and stderr."""

    def command(*arguments):
        status = 0
        try:
            cli.main([str(a) for a in arguments])
        except SystemExit as left:
            status = left.code or 0
        said = capsys.readouterr()
        assert "Traceback" not in said.out + said.err
        return status, said.out, said.err

    return command


@pytest.fixture
def refuses(run):
    """Run what must be refused: status 2, nothing on stdout, one message; give the message."""

    def command(*arguments):
        status, out, err = run(*arguments)
        assert (status, out) == (2, "")
        assert err.startswith("omnisight: ")
        return err

    return command


def jpeg(image, orientation=1):
    """Encode a gray or RGB picture as JPEG with an EXIF orientation."""
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, orientation, 0)
    tiff = b"MM\0*" + struct.pack(">IH", 8, 1) + entry + struct.pack(">I", 0)
    exif = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]


def lines_of(out):
    """Give the table's lines by picture."""
    lines = [line for line in out.splitlines() if line.split()[1:2] in (["yes"], ["no"])]
    return {line.split()[0]: line for line in lines}


def visible(folder):
    return sorted(path.name for path in folder.iterdir())


# -- the program -------------------------------------------------------------------------------------------------

COMMANDS = ["calibrate", "convert", "inspect", "view"]


def test_help_lists_the_commands_at_once_and_imports_nothing_slow():
    code = (
        "import sys; from omnisight.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit as left: assert not left.code\n"
        "print(sorted({'numpy', 'numba', 'scipy', 'cv2'} & set(sys.modules)))"
    )
    begun = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert time.perf_counter() - begun < 5
    *shown, imported = done.stdout.strip().splitlines()
    assert imported == "[]"
    assert all(any(command in line.split() for line in shown) for command in COMMANDS)
    assert "Exit status: 0 done, 1 a fault in omnisight, 2 something to mend" in " ".join(done.stdout.split())


def test_the_package_runs_as_a_module_and_leaves_with_its_status(tmp_path):
    command = [sys.executable, "-m", "omnisight", "inspect", str(tmp_path / "none.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"omnisight: {tmp_path / 'none.json'}: No such file or directory\n"


def test_version(run):
    assert run("--version")[:2] == (0, f"{omnisight.__version__}\n")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_help(run, command):
    status, out, _ = run(command, "--help")
    assert status == 0
    assert f"omnisight {command}" in out


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("arguments", [(), ("--nonsense",), ("a", "b", "--nonsense", "3")])
def test_wrong_usage_is_told_with_status_2(run, command, arguments):
    status, out, err = run(command, *arguments)
    assert status == 2
    assert (out + err).strip()


def test_an_unknown_command_is_told(run):
    status, out, err = run("calibrat")
    assert status == 2
    assert "calibrate" in out + err


def raising(error):
    def function(*_, **__):
        raise error

    return function


def test_a_fault_is_called_one_and_shown_whole_only_to_who_asks(run, camera_file, monkeypatch):
    monkeypatch.setattr("omnisight.formats.load_all", raising(RuntimeError("lost the thread")))
    status, out, err = run("inspect", camera_file)
    assert (status, out) == (1, "")
    assert err == "omnisight: a fault in omnisight: RuntimeError: lost the thread (--debug shows where)\n"
    with pytest.raises(RuntimeError, match="lost the thread"):
        run("inspect", camera_file, "--debug")


def test_bad_input_is_shown_whole_to_who_asks(run, tmp_path):
    with pytest.raises(ValueError, match="No such file"):
        run("--debug", "inspect", tmp_path / "none.json")


def test_an_interruption_is_no_fault(run, camera_file, monkeypatch):
    monkeypatch.setattr("omnisight.formats.load_all", raising(KeyboardInterrupt()))
    assert run("inspect", camera_file) == (130, "", "omnisight: interrupted\n")


# -- calibrate ---------------------------------------------------------------------------------------------------


def test_a_calibration_needs_no_options_and_prints_a_line_per_picture(run, shots, tmp_path):
    status, out, err = run("calibrate", shots, "--square", "30mm", "-o", tmp_path / "camera.json")
    assert (status, err) == (0, "")
    assert out.split()[:7] == ["picture", "found", "corners", "rms", "px", "worst", "px"]
    table = lines_of(out)
    assert sorted(table) == sorted(path.name for path in shots.iterdir())
    for line in table.values():
        _, found, corners, rms, worst = line.split()[:5]
        assert found == "yes"
        assert 40 <= int(corners) <= 54
        assert 0 < float(rms) < float(worst) < 0.5
    assert f"written: {tmp_path / 'camera.json'}" in out
    assert "6 of 6 pictures" in out
    found = load(tmp_path / "camera.json")
    assert found.size == SIZE
    assert found.provenance["pattern"] == "9x6"
    assert found.provenance["square_m"] == 0.03
    pixels, _ = TRUTH.project([[0.6, 0.2, 1.0], [-0.8, 0.1, 1.0], [0.0, -0.7, 1.0]])
    true, shown = TRUTH.unproject(pixels)[0], found.unproject(pixels)[0]
    assert np.degrees(np.arccos(np.sum(true @ true.T * (shown @ shown.T), 1) / 3)).max() < 90  # three directions apart
    assert np.degrees(np.abs(np.arccos(true @ true.T - 1e-12) - np.arccos(shown @ shown.T - 1e-12))).max() < 0.2


def test_the_native_file_says_what_it_holds(run, shots, tmp_path):
    assert run("calibrate", shots, *QUICK, "-o", tmp_path / "camera.json")[0] == 0
    stored = json.loads((tmp_path / "camera.json").read_text())
    assert stored["format"] == "omnisight-camera"
    assert stored["version"] == 1
    assert stored["model"] == "equidistant"
    assert stored["size"] == [640, 480]
    assert set(stored["params"]) == {"fx", "fy", "cx", "cy"}
    assert "x right, y down, z forward" in stored["convention"]
    assert stored["provenance"]["square_m"] is None
    assert stored["calibration"]["pictures"] == 6


def test_json_is_one_object_and_nothing_else(run, folder):
    (folder / "7.jpg").write_text("not a picture")
    write_image(folder / "8.png", np.zeros(SIZE[::-1], np.uint8))
    status, out, err = run("calibrate", folder, "--pattern", "9x6", "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert set(result) >= {
        *("pictures", "pattern", "model", "rms", "mean", "held_out_rms"),
        *("candidates", "seconds", "camera", "warnings", "reason"),
    }
    assert [picture["name"] for picture in result["pictures"]] == visible(folder)
    for picture in result["pictures"]:
        assert set(picture) == {"name", "found", "corners", "rms", "worst", "note"}
        assert picture["found"] is (int(picture["name"][0]) <= 6)
        assert (picture["rms"] is None) is (picture["worst"] is None) is (not picture["found"])
    assert result["pictures"][6]["note"] == "7.jpg: not an image (starts with b'not a')"
    assert result["pictures"][7]["note"] == "no 9x6 board found"
    assert result["pattern"] == "9x6"
    assert 0 < result["mean"] < result["rms"] < 0.3
    assert {"model", "rms", "held_out_rms", "parameters", "mean"} == set(result["candidates"][0])
    assert len(result["candidates"]) > 3
    assert result["seconds"]["total"] == pytest.approx(
        result["seconds"]["detect"] + result["seconds"]["solve"], abs=0.5
    )
    assert result["camera"]["model"] == result["model"]
    assert result["camera"]["size"] == [640, 480]


def test_json_in_a_process_of_its_own_keeps_stdout_clean(shots, tmp_path):
    command = [sys.executable, "-m", "omnisight", "calibrate", str(shots), *QUICK, "--json", "--no-cache"]
    done = subprocess.run([*command, "-o", str(tmp_path / "c.json")], capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    assert done.stderr == ""
    assert result["camera"]["params"] == json.loads((tmp_path / "c.json").read_text())["params"]


def test_a_second_run_takes_what_the_first_one_found(run, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: tmp_path / "cache")
    first = run("calibrate", shots, *QUICK)[1]
    renamed = tmp_path / "elsewhere"
    shutil.copytree(shots, renamed)
    monkeypatch.setattr("omnisight.targets.find.search_checkerboard", raising(AssertionError("searched again")))
    assert lines_of(run("calibrate", renamed, *QUICK)[1]) == lines_of(first)
    assert run("calibrate", shots, *QUICK, "--no-cache")[0] == 1


def test_drawings_hold_every_picture(run, shots, tmp_path):
    status, out, _ = run("calibrate", shots, *QUICK, "--draw", tmp_path / "drawn")
    assert status == 0
    assert f"drawn: {tmp_path / 'drawn'}" in out
    assert visible(tmp_path / "drawn") == [f"{i}.png" for i in range(1, 7)]
    drawn = read_image(tmp_path / "drawn" / "1.png")
    assert drawn.shape[2] == 3
    green = (drawn[..., 1] > 180) & (drawn[..., 0] < 120)
    assert green.sum() > 500


def test_a_drawing_that_fails_loses_no_result(run, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.cli._draw.draw_residuals", raising(OSError("no room")))
    status, out, err = run("calibrate", shots, *QUICK, "--draw", tmp_path / "drawn", "-o", tmp_path / "c.json")
    assert (status, err) == (2, "omnisight: no room\n")
    assert "written:" in out
    assert load(tmp_path / "c.json").model.name == "equidistant"


def test_pictures_of_one_name_in_two_folders_are_told_apart(run, shots, tmp_path):
    for name, numbers in (("left", (1, 2, 3)), ("right", (4, 5, 6))):
        (tmp_path / name).mkdir()
        for i, number in enumerate(numbers):
            shutil.copy(shots / f"{number}.png", tmp_path / name / f"{i}.png")
    status, out, _ = run("calibrate", tmp_path / "left", tmp_path / "right", *QUICK, "--json")
    apart = json.loads(out)["pictures"]
    together = json.loads(run("calibrate", shots, *QUICK, "--json")[1])["pictures"]
    assert status == 0
    assert [p["corners"] for p in apart] == [p["corners"] for p in together]
    np.testing.assert_allclose([p["rms"] for p in apart], [p["rms"] for p in together], rtol=1e-6)
    run("calibrate", tmp_path / "left", tmp_path / "right", *QUICK, "--draw", tmp_path / "drawn")
    assert len(visible(tmp_path / "drawn")) == 6


# -- calibrate: patterns -----------------------------------------------------------------------------------------


def test_columns_and_rows_may_be_exchanged(run, shots):
    straight, swapped = (
        json.loads(run("calibrate", shots, "--pattern", p, "--model", "equidistant", "--json")[1])
        for p in ("9x6", "6x9")
    )
    assert swapped["rms"] == pytest.approx(straight["rms"], rel=1e-3)
    assert all(picture["found"] for picture in swapped["pictures"])


@pytest.mark.parametrize(
    ("pattern", "reason"),
    [("10x7", "10x7 squares have 9x6 inner corners"), ("7x5", "did you count squares?")],
)
def test_a_wrong_pattern_is_answered_with_the_right_one(refuses, shots, pattern, reason):
    said = refuses("calibrate", shots, "--pattern", pattern)
    assert f"a {pattern} board was found in 0 of 6 pictures" in said
    assert f"found a 9x6 grid of inner corners in 6/6 pictures but --pattern is {pattern} ({reason})" in said
    assert "Use --pattern 9x6." in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--pattern", "9"), "cannot read the pattern '9': give inner corners as COLUMNSxROWS, such as 8x6"),
        (("--pattern", "2x9"), "a board needs 3x3 inner corners or more, got 2x9"),
        (("--square", "30"), "the length '30' has no unit: write 30mm if millimetres are meant"),
        (("--square", "0mm"), "the length '0mm' must be positive"),
        (("--square", "30px"), "the length '30px' has an unknown unit 'px': use one of mm, cm, m, in"),
        (("--model", "fisheye9"), "unknown camera model 'fisheye9'; there are: cylindrical"),
    ],
)
def test_an_option_that_cannot_be_is_told_before_any_picture_is_read(refuses, shots, monkeypatch, options, said):
    monkeypatch.setattr("omnisight.images.read.read_bytes", raising(AssertionError("a picture was read")))
    monkeypatch.setattr("omnisight.targets.find.read_bytes", raising(AssertionError("a picture was read")))
    assert said in refuses("calibrate", shots, *options)


def test_an_unknown_loss_is_told_with_those_there_are(run, shots):
    status, out, err = run("calibrate", shots, "--loss", "cauchy")
    assert status == 2
    assert "huber" in out + err
    assert "squared" in out + err


def test_no_board_anywhere_asks_for_the_pattern(refuses, tmp_path):
    for i in range(3):
        write_image(tmp_path / f"{i}.png", np.full((480, 640), 90 * i, np.uint8))
    assert "no checkerboard found in the first 3 pictures, so its size is unknown: give --pattern" in refuses(
        "calibrate", tmp_path
    )
    said = refuses("calibrate", tmp_path, "--pattern", "9x6")
    assert "a 9x6 board was found in 0 of 3 pictures: does --pattern count inner corners" in said
    assert "0.png: no 9x6 board found" in said


def test_a_board_that_looks_the_same_upside_down_is_noted(run, tmp_path):
    board = Board(8, 6)
    for i, view in enumerate(POSES[:4]):
        write_image(tmp_path / f"{i}.png", render(board, *pose(board, *view))[0])
    status, out, _ = run("calibrate", tmp_path, "--model", "equidistant")
    assert status == 0
    assert "note: a 8x6 board looks the same upside-down: fine for one camera, unsafe for several; 8x5 would not" in out


# -- calibrate: bad pictures -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["empty", "of text"])
def test_a_folder_without_pictures_is_told_with_what_it_holds(refuses, tmp_path, name):
    place = tmp_path / name
    place.mkdir()
    if name == "of text":
        for i in range(3):
            (place / f"{i}.txt").write_text("no")
    said = refuses("calibrate", place)
    held = "3 .txt" if name == "of text" else "no files"
    assert f"no images in {place} (found {held}). Supported: jpg jpeg png tif" in said


@pytest.mark.parametrize("path", ["nowhere", "nowhere/*.png", "nowhere/a.png"])
def test_what_is_not_there_is_told_by_its_name(refuses, tmp_path, path):
    said = refuses("calibrate", tmp_path / path)
    assert str(tmp_path / path) in said
    assert ("the pattern matches nothing" if "*" in path else "no such file or folder") in said


def spoil(path, how):
    """Put something else in the place of a picture."""
    good = read_image(path)
    path.unlink()
    match how:
        case "text":
            path.with_suffix(".jpg").write_text("I am no picture")
        case "empty":
            path.with_suffix(".jpg").write_bytes(b"")
        case "truncated":
            path.with_suffix(".jpg").write_bytes(jpeg(good)[:-2000])
        case "black":
            write_image(path, np.zeros_like(good))
        case "damaged":
            data = bytearray(cv2.imencode(".png", good)[1].tobytes())
            data[len(data) // 2] ^= 255
            path.write_bytes(bytes(data))


@pytest.mark.parametrize(
    ("how", "note"),
    [
        ("text", "not an image (starts with b'I am ')"),
        ("empty", "empty file"),
        ("truncated", "truncated JPEG (no end-of-image marker)"),
        ("black", "no 9x6 board found"),
        ("damaged", "damaged PNG (checksum of chunk b'IDAT'"),
    ],
)
def test_a_bad_picture_among_good_ones_is_left_out_with_its_reason(run, folder, how, note):
    spoil(folder / "3.png", how)
    status, out, err = run("calibrate", folder, *QUICK)
    assert (status, err) == (0, "")
    (line,) = [line for name, line in lines_of(out).items() if name.startswith("3.")]
    assert line.split()[1] == "no"
    assert note in line
    assert "5 of 6 pictures" in out


def test_too_few_good_pictures_are_told_with_the_bad_ones(refuses, folder):
    for i, how in enumerate(("text", "empty", "truncated", "black")):
        spoil(folder / f"{i + 1}.png", how)
    said = refuses("calibrate", folder, *QUICK)
    assert "a 9x6 board was found in 2 of 6 pictures" in said
    assert "3 is the least" in said
    for note in ("1.jpg: not an image", "2.jpg: empty file", "3.jpg: truncated JPEG", "4.png: no 9x6 board"):
        assert note in said


@pytest.mark.parametrize("number", [1, 2])
def test_force_calibrates_from_fewer(run, shots, tmp_path, number):
    pictures = [shots / f"{i + 1}.png" for i in range(number)]
    status, out, _ = run("calibrate", *pictures, *QUICK, "--force", "-o", tmp_path / "c.json", "--json")
    assert status == 0
    assert json.loads(out)["held_out_rms"] is None
    assert load(tmp_path / "c.json").size == SIZE


def kind(folder, i, how):
    """Write picture number i again in another kind of file."""
    path = folder / f"{i}.png"
    good = read_image(path)
    path.unlink()
    match how:
        case "16 bit":
            write_image(path, (good.astype(np.uint16) * 40 + 500))
        case "RGBA":
            write_image(path, np.dstack([good, good, good, np.full_like(good, 255)]))
        case "RGB":
            write_image(path, np.dstack([good, good, good]))
        case "gif":
            path.with_suffix(".gif").write_bytes(cv2.imencode(".gif", cv2.cvtColor(good, cv2.COLOR_GRAY2BGR))[1])
        case "JPG":
            path.with_suffix(".JPG").write_bytes(jpeg(good))
        case "Tif":
            path.with_suffix(".Tif").write_bytes(cv2.imencode(".tif", good)[1])
        case "bmp":
            write_image(path.with_suffix(".bmp"), good)
        case "wrong name":
            path.with_suffix(".jpg").write_bytes(cv2.imencode(".png", good)[1])


@pytest.mark.parametrize("how", ["16 bit", "RGBA", "RGB", "gif", "JPG", "Tif", "bmp", "wrong name"])
def test_every_kind_of_picture_is_taken(run, folder, how):
    if how == "gif" and not cv2.haveImageWriter("a.gif"):
        pytest.skip("this OpenCV writes no GIF")
    for i in (2, 5):
        kind(folder, i, how)
    status, out, err = run("calibrate", folder, *QUICK)
    assert (status, err) == (0, "")
    assert "6 of 6 pictures" in out


def test_a_turned_picture_is_taken_as_the_sensor_read_it_with_one_warning(run, folder):
    for i in (2, 5):
        path = folder / f"{i}.png"
        path.with_suffix(".jpg").write_bytes(jpeg(read_image(path), orientation=6))
        path.unlink()
    status, out, _ = run("calibrate", folder, *QUICK)
    assert status == 0
    assert "6 of 6 pictures" in out
    assert "EXIF orientation 6 ignored" in lines_of(out)["2.jpg"]
    assert out.count("EXIF") == 1


def test_turned_pictures_are_turned_on_request(run, refuses, folder):
    first = folder / "1.png"
    first.with_suffix(".jpg").write_bytes(jpeg(read_image(first), orientation=6))
    first.unlink()
    said = refuses("calibrate", folder, *QUICK, "--apply-exif")
    assert "pictures have 2 sizes: 5 of 640x480; 1 of 480x640 (1.jpg), rotated 90 degrees?" in said
    for i in range(2, 7):
        path = folder / f"{i}.png"
        path.with_suffix(".jpg").write_bytes(jpeg(read_image(path), orientation=6))
        path.unlink()
    status, out, _ = run("calibrate", folder, *QUICK, "--apply-exif", "--json")
    assert status == 0
    assert json.loads(out)["camera"]["size"] == [480, 640]
    assert not any(picture["note"].count("EXIF") for picture in json.loads(out)["pictures"])


def test_mixed_sizes_are_told_with_their_counts(refuses, folder):
    for i in (5, 6):
        write_image(folder / f"{i}.png", read_image(folder / f"{i}.png")[::2, ::2])
    write_image(folder / "4.png", np.ascontiguousarray(np.rot90(read_image(folder / "4.png"))))
    said = refuses("calibrate", folder, *QUICK)
    assert "pictures have 3 sizes: 3 of 640x480; 2 of 320x240 (5.png, 6.png)" in said
    assert "1 of 480x640 (4.png), rotated 90 degrees?" in said
    assert "Calibrate one size at a time" in said


def test_copies_of_a_picture_are_noted(run, folder):
    shutil.copy(folder / "1.png", folder / "7.png")
    status, out, _ = run("calibrate", folder, *QUICK)
    assert status == 0
    assert "note: Pictures that repeat another one: 1 (1.png = 7.png)" in out


# -- calibrate: places -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["with a space", "Prüfbilder 校正", "weird [1] {a}'s"])
def test_paths_may_be_named_as_people_name_them(run, shots, tmp_path, name):
    place = shutil.copytree(shots, tmp_path / name)
    (place / "1.png").rename(place / f"1 {name}.png")
    out = place / f"{name}.json"
    status, said, _ = run("calibrate", place, *QUICK, "-o", out, "--draw", place / "drawn")
    assert status == 0
    assert "6 of 6 pictures" in said
    assert load(out).size == SIZE
    assert f"1 {name}.png" in visible(place / "drawn")
    assert run("calibrate", place / "[2-5].png", *QUICK)[0] == 0 if "[" not in name else True


@pytest.mark.parametrize("where", ["no folder", "under a file", "a folder itself"])
def test_an_output_that_cannot_be_written_is_told_before_any_work(refuses, shots, tmp_path, monkeypatch, where):
    monkeypatch.setattr("omnisight.targets.find_boards", raising(AssertionError("work was begun")))
    (tmp_path / "file").write_text("")
    output = {
        "no folder": tmp_path / "missing" / "c.json",
        "under a file": tmp_path / "file" / "c.json",
        "a folder itself": tmp_path,
    }[where]
    said = refuses("calibrate", shots, *QUICK, "-o", output)
    assert str(output) in said
    assert ("is a folder" if where == "a folder itself" else "there is no folder") in said


def test_a_folder_that_takes_no_file_is_told_before_any_work(refuses, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.targets.find_boards", raising(AssertionError("work was begun")))
    monkeypatch.setattr("tempfile.TemporaryFile", raising(PermissionError(13, "Permission denied")))
    said = refuses("calibrate", shots, *QUICK, "-o", tmp_path / "c.json")
    assert f"{tmp_path / 'c.json'}: cannot be written: Permission denied ({tmp_path})" in said


def test_a_failed_run_leaves_the_old_camera_alone(refuses, shots, tmp_path):
    kept = tmp_path / "camera.json"
    kept.write_text("what was there")
    refuses("calibrate", shots, "--pattern", "7x5", "-o", kept)
    assert kept.read_text() == "what was there"
    assert visible(tmp_path) == ["camera.json"]


# -- view --------------------------------------------------------------------------------------------------------


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
def test_every_view_is_written_in_its_size_with_its_figures(run, photo, camera_file, tmp_path, to, size, options):
    out = tmp_path / "view.png"
    status, said, err = run("view", photo, "--camera", camera_file, "--to", to, *options, "-o", out)
    assert (status, err) == (0, "")
    assert read_image(out).shape == size[::-1]
    assert f"written: {out} (" in said
    words = said.replace("%", "").split()
    kept, filled = float(words[words.index("of") - 1]), float(words[words.index("fills") + 1])
    assert 0 < kept <= 101
    assert 0 < filled <= 100
    assert "px wide in the middle of the view" in said
    assert "at its rim" in said
    assert "nan" not in said


def test_a_view_of_the_calibrated_camera_straightens_the_board(run, shots, camera_file, tmp_path):
    out = tmp_path / "straight.png"
    run("view", shots / "1.png", "--camera", camera_file, "--fov", "100", "--size", "800x800", "-o", out)
    pinhole = omnisight.perspective(100, (800, 800))
    turn, position = pose(BOARD, *POSES[0])
    corners, _ = pinhole.project(BOARD.points @ turn.T + position)
    found = omnisight.targets.detect_checkerboard(read_image(out), BOARD)
    assert np.abs(found.pixels - corners[found.ids]).max() < 0.7


def test_several_pictures_go_to_a_folder(run, shots, camera_file, tmp_path):
    out = tmp_path / "new" / "views"
    status, said, _ = run("view", shots, "--camera", camera_file, "--size", "160x120", "-o", out)
    assert status == 0
    assert visible(out) == visible(shots)
    assert {read_image(path).shape for path in out.iterdir()} == {(120, 160)}
    assert str(out) in said


def test_pictures_of_one_name_do_not_overwrite_each_other(run, shots, camera_file, tmp_path):
    for name, number in (("left", 1), ("right", 2)):
        (tmp_path / name).mkdir()
        shutil.copy(shots / f"{number}.png", tmp_path / name / "a.png")
    out = tmp_path / "out"
    assert run("view", tmp_path / "left", tmp_path / "right", "--camera", camera_file, "-o", out)[0] == 0
    assert len(visible(out)) == 2


def test_a_bad_picture_does_not_stop_the_others(run, folder, camera_file, tmp_path):
    spoil(folder / "1.png", "truncated")
    write_image(folder / "3.png", np.zeros((100, 100), np.uint8))
    out = tmp_path / "out"
    status, _, err = run("view", folder, "--camera", camera_file, "--size", "160x120", "-o", out)
    assert status == 2
    assert visible(out) == ["2.png", "4.png", "5.png", "6.png"]
    assert err.startswith("omnisight: 2 of 6 pictures were left out")
    assert "1.jpg: truncated JPEG" in err
    assert "3.png: the picture is 100x100, the camera 640x480" in err


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
    # The view is a picture of a camera: it can be looked into again.
    status, _, _ = run("view", tmp_path / "v.png", "--camera", camera, "--fov", "60", "-o", tmp_path / "again.png")
    assert status == 0


def test_a_picture_keeps_its_depth(run, photo, camera_file, tmp_path):
    write_image(tmp_path / "deep.png", read_image(photo).astype(np.uint16) * 257)
    run("view", tmp_path / "deep.png", "--camera", camera_file, "-o", tmp_path / "v.png")
    assert read_image(tmp_path / "v.png").dtype == np.uint16


def test_a_resized_picture_needs_a_scaled_camera(run, refuses, photo, camera_file, tmp_path):
    half = tmp_path / "half.png"
    write_image(half, cv2.resize(read_image(photo), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    small, large = tmp_path / "small.png", tmp_path / "large.png"
    said = refuses("view", half, "--camera", camera_file, "-o", small)
    assert "half.png: the picture is 320x240, the camera 640x480: the same shape, 0.5 times as large" in said
    assert "--scale-camera" in said
    assert not small.exists()
    options = ("--camera", camera_file, "--size", "200x150", "--fov", "70")
    assert run("view", half, *options, "--scale-camera", "-o", small)[0] == 0
    run("view", photo, *options, "-o", large)
    apart = np.abs(read_image(small).astype(float) - read_image(large))
    assert apart.mean() < 4


def test_a_turned_picture_is_told_as_such(refuses, photo, camera_file, tmp_path):
    for options in ((), ("--scale-camera",)):
        turned = tmp_path / "turned.png"
        write_image(turned, np.ascontiguousarray(np.rot90(read_image(photo))))
        said = refuses("view", turned, "--camera", camera_file, *options, "-o", tmp_path / "v.png")
        assert "turned.png: the picture is 480x640, the camera 640x480: turned by 90 degrees" in said
        assert "EXIF" in said


def test_a_camera_without_a_size_takes_that_of_the_pictures(run, photo, camera_file, tmp_path):
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
        (("--fov", "160"), "a perspective view cannot show 160 degrees, 150 at most: use cylinder, panini"),
        (("--fov", "0"), "a perspective view cannot show 0 degrees"),
        (("--to", "panini", "--fov", "359"), "a Panini view of distance 1 cannot show 359 degrees, 353 at most"),
        (("--to", "fisheye", "--fov", "0"), "cannot show 0 degrees"),
        (("--to", "fisheye", "--fov", "200", "--projection", "orthographic"), "180 at most"),
        (("--to", "cylinder", "--elevation", "-95:10"), "elevation must be (low, high) within -89 to 89 degrees"),
        (("--to", "cylinder", "--elevation", "10"), "--elevation must be two numbers in degrees, such as"),
        (("--to", "sphere", "--azimuth", "a:b"), "--azimuth must be two numbers in degrees"),
        (("--elevation", "-10:10"), "--elevation is for cylinder, mercator and sphere; a perspective takes --fov"),
        (("--to", "sphere", "--fov", "90"), "--fov is not for a sphere; use --azimuth"),
        (("--to", "cube", "--fov", "90"), "--fov is not for a cube; its faces are 90 degrees"),
        (("--size", "0x10"), "--size must be WIDTHxHEIGHT in px, such as 1280x720, got '0x10'"),
        (("--size", "tall"), "--size must be WIDTHxHEIGHT"),
        (("--size", "50000x10"), "a view is 1 to 32767 px a side, got 50000 x 10"),
        (("--yaw", "nan"), "--yaw must be a number of degrees, got nan"),
        (("--roll", "inf"), "--roll must be a number of degrees, got inf"),
    ],
)
def test_a_view_that_cannot_be_is_refused_and_nothing_is_written(refuses, photo, camera_file, tmp_path, options, said):
    before = visible(tmp_path)
    assert said in refuses("view", photo, "--camera", camera_file, "-o", tmp_path / "v.png", *options)
    assert visible(tmp_path) == before


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("v", "cannot write extension ''. Supported: png jpg"),
        ("v.xyz", "v.xyz: cannot write extension '.xyz'"),
        ("missing/v.png", "the folder"),
    ],
)
def test_a_view_that_cannot_be_written_says_why(refuses, photo, camera_file, tmp_path, name, said):
    assert said in refuses("view", photo, "--camera", camera_file, "-o", tmp_path / name)
    assert not (tmp_path / name).exists()


def test_a_picture_may_go_to_a_folder_too(run, photo, camera_file, tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    status, out, _ = run("view", photo, "--camera", camera_file, "-o", place)
    assert status == 0
    assert f"written: {place / '1.png'}" in out
    assert visible(place) == ["1.png"]


@pytest.mark.parametrize("command", ["one view", "views", "mask", "drawings"])
def test_pictures_are_never_written_over(refuses, folder, camera_file, tmp_path, command):
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
    assert f"{folder / '1.png'}: is one of the pictures and would be lost" in said
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_several_pictures_cannot_go_to_one_file(refuses, shots, camera_file, tmp_path):
    (tmp_path / "v.png").write_text("mine")
    said = refuses("view", shots, "--camera", camera_file, "-o", tmp_path / "v.png")
    assert f"{tmp_path / 'v.png'}: is a file; 6 pictures go to a folder" in said
    assert (tmp_path / "v.png").read_text() == "mine"


DAMAGED = {
    "empty": ("", "empty file"),
    "prose": ("hello there", "no calibration file that is known (begins with 'hello there')"),
    "half": ('{"format": "omnisight-camera", "version": 1, "mod', "omnisight JSON"),
    "other": ('{"format": "omnisight-scene", "version": 1}', "\"format\" is 'omnisight-scene'"),
    "newer": ('{"format": "omnisight-camera", "version": 99}', "version 99; this omnisight reads up to 1"),
    "bare": ('{"format": "omnisight-camera", "version": 1}', "missing model, params, size"),
    "model": (
        '{"format": "omnisight-camera", "version": 1, "model": "pinhol", "params": {}, "size": [1, 1]}',
        "unknown camera model 'pinhol'; there are: cylindrical",
    ),
    "number": (
        '{"format": "omnisight-camera", "version": 1, "model": "pinhole",'
        ' "params": {"fx": "x", "fy": 1, "cx": 1, "cy": 1}, "size": [1, 1]}',
        "fx must be a number, got 'x'",
    ),
}


@pytest.mark.parametrize("command", ["view", "inspect", "convert"])
@pytest.mark.parametrize("how", DAMAGED)
def test_a_damaged_camera_file_is_told_by_name(refuses, photo, tmp_path, how, command):
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
    assert visible(tmp_path) == ["camera.json"]


@pytest.mark.parametrize("what", ["missing", "folder", "picture"])
def test_what_is_no_camera_file_is_told_by_name(refuses, photo, tmp_path, what):
    path = {"missing": tmp_path / "no.json", "folder": tmp_path, "picture": photo}[what]
    said = refuses("view", photo, "--camera", path, "-o", tmp_path / "v.png")
    assert str(path) in said
    expected = {"missing": "No such file", "folder": "is a folder", "picture": "no calibration file that is known"}
    assert expected[what] in said


# -- inspect -----------------------------------------------------------------------------------------------------


def test_inspect_says_model_size_field_focal_centre_and_conventions(run, camera_file):
    status, out, err = run("inspect", camera_file)
    assert (status, err) == (0, "")
    for said in (
        *("model       equidistant: ", "size        640 x 480 px", "focal       190.00 px per radian"),
        *("centre      (322.30, 236.80), +2.8, -2.7 px", "calibrated  to 80.2 degrees", "x right, y down, z forward"),
        *("193.0 deg across", "144.7 deg down", "radius, px  (* calibrated, . extrapolated, - equidistant)"),
    ):
        assert said in out
    assert "nan" not in out


@pytest.mark.parametrize("model", model_names())
def test_inspect_describes_every_model(run, tmp_path, model):
    camera = Camera(model_class(model).example(), (1024, 768), theta_max=0.7)
    path = save(camera, tmp_path / "c.json").path
    status, out, err = run("inspect", path, "--svg", tmp_path / "curve.svg")
    assert (status, err) == (0, "")
    assert f"model       {model}: " in out
    assert (tmp_path / "curve.svg").read_text().startswith("<svg")


def test_inspect_json_is_the_camera(run, camera_file):
    status, out, _ = run("inspect", camera_file, "--json")
    assert status == 0
    stored = json.loads(out)
    assert stored["camera"]["params"] == TRUTH.model.to_dict()
    assert stored["camera"]["size"] == [640, 480]


def test_inspect_tells_the_names_there_are(refuses, camera_file):
    said = refuses("inspect", camera_file, "--name", "left")
    assert f"{camera_file}: no camera 'left'; it holds camera" in said


def test_inspect_shows_how_sure_a_calibrated_camera_is(run, shots, tmp_path):
    run("calibrate", shots, *QUICK, "-o", tmp_path / "c.json")
    out = run("inspect", tmp_path / "c.json")[1]
    focal = next(line for line in out.splitlines() if line.strip().startswith("fx"))
    value, sigma = float(focal.split()[1]), float(focal.split()[3])
    assert abs(value - FOCAL) < 4 * sigma + 0.2
    assert "held_out_rms" in out
    assert "pattern: 9x6" in out


# -- convert -----------------------------------------------------------------------------------------------------


def test_convert_prints_how_near_it_comes(run, camera_file, tmp_path):
    out = tmp_path / "c.json"
    status, said, err = run("convert", camera_file, "--to", "native", "--model", "double_sphere", "-o", out)
    assert (status, err) == (0, "")
    assert "model       equidistant -> double_sphere" in said
    assert "fitted      to 80.2 degrees" in said
    error = float(said.split("error       at most ")[1].split()[0])
    assert error < 1
    assert f"written     {out}" in said
    converted = load(out)
    bearings, pixels = TRUTH.samples()
    assert np.linalg.norm(converted.project(bearings)[0] - pixels, axis=1).max() == pytest.approx(error, rel=0.01)
    assert converted.provenance["converted_from"] == "equidistant"


def test_convert_refuses_past_the_threshold_and_writes_nothing(run, refuses, camera_file, tmp_path):
    out = tmp_path / "c.json"
    arguments = ("convert", camera_file, "--to", "native", "--model", "division", "-o", out)
    status, said, err = run(*arguments, "--max-error", "1e-6")
    assert status == 2
    assert "holds       within 0.5 px up to" in said
    assert err.startswith("omnisight: division cannot represent this equidistant camera to 80 degrees: ")
    assert "1e-06 allowed. Nothing is written; try --max-theta" in err
    assert "--force" in err
    assert visible(tmp_path) == ["camera.json"]
    assert run(*arguments, "--max-error", "1e-6", "--force")[0] == 0
    assert load(out).model.name == "division"


def test_convert_over_a_smaller_cone_comes_nearer(run, camera_file, tmp_path):
    errors = []
    for options in ((), ("--max-theta", "40")):
        said = run(
            *("convert", camera_file, "--to", "native", "--model", "division", "--force"),
            *("-o", tmp_path / "c.json", *options),
        )[1]
        errors.append(float(said.split("at most ")[1].split()[0]))
    assert errors[1] < errors[0] / 3


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--to", "nonsense"), "unknown format 'nonsense'; there are:"),
        (("--to", "native", "--model", "nonsense"), "has no model nonsense; it has cylindrical"),
        (("--to", "native", "--name", "left"), "no camera 'left'; it holds camera"),
        (("--to", "native", "--model", "mei", "--max-theta", "0.1"), "sees almost nothing"),
    ],
)
def test_a_conversion_that_cannot_be_says_why(refuses, camera_file, tmp_path, options, said):
    assert said in refuses("convert", camera_file, "-o", tmp_path / "c.json", *options)
    assert visible(tmp_path) == ["camera.json"]


def test_a_camera_without_a_size_cannot_be_fitted(refuses, tmp_path):
    path = save(Camera(TRUTH.model, (0, 0)), tmp_path / "c.json").path
    said = refuses("convert", path, "--to", "native", "--model", "mei", "-o", tmp_path / "d.json")
    assert "does not say how large its pictures are" in said


def test_convert_names_its_file_beside_the_camera(run, camera_file):
    status, said, _ = run("convert", camera_file, "--to", "native")
    assert status == 0
    assert "model       equidistant, as it is" in said
    assert load(camera_file.with_name("camera-native.json")).model == TRUTH.model


# -- anything else -----------------------------------------------------------------------------------------------


def spoiled(data, rng):
    """Cut, swap, repeat or change bytes of a file."""
    data = bytearray(data)
    at, to = sorted(rng.integers(0, len(data), 2))
    match rng.integers(5):
        case 0:
            del data[at:]
        case 1:
            del data[at:to]
        case 2:
            data[at : at + 3] = rng.integers(0, 256, 3, np.uint8).tobytes()
        case 3:
            data[at:at] = data[at:to]
        case 4:
            digits = [i for i, b in enumerate(data) if chr(b).isdigit()]
            data[digits[rng.integers(len(digits))]] = b'-e.n9[{"'[rng.integers(8)]
    return bytes(data)


@pytest.mark.parametrize("model", ["ocam", "double_sphere"])
def test_no_camera_file_however_spoiled_is_a_fault(run, tmp_path, model):
    path = tmp_path / "camera.json"
    whole = save(Camera(model_class(model).example(), SIZE, theta_max=1.2), path).path.read_bytes()
    rng = np.random.default_rng(0)
    statuses = []
    for i in range(120):
        path.write_bytes(spoiled(whole, rng))
        status, _, err = run("inspect", path)
        assert status in (0, 2), f"{i}: {err} {path.read_bytes()}"
        assert err.startswith(f"omnisight: {path}: ") is (status == 2)
        statuses.append(status)
    assert {0, 2} == set(statuses)


def test_no_picture_however_spoiled_is_a_fault(run, shots, camera_file, tmp_path):
    good = read_image(shots / "1.png")[::4, ::4]
    files = [jpeg(good), *(cv2.imencode(e, good)[1].tobytes() for e in (".png", ".tif", ".bmp", ".webp", ".pgm"))]
    rng = np.random.default_rng(0)
    for i in range(90):
        path = tmp_path / f"{i}.png"
        path.write_bytes(spoiled(files[i % len(files)] + b"0", rng))
        status, _, err = run("view", path, "--camera", camera_file, "--scale-camera", "-o", tmp_path / "v.png")
        assert status in (0, 2), f"{i}: {err}"
        assert err.startswith("omnisight: ") is (status == 2)
