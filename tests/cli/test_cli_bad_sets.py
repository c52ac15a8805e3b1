"""Images that are good one by one, and bad as a set: sizes, copies, motion, too few, parallel."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from cli_scene import BOARD, QUICK, image_rows
from scipy.spatial.transform import Rotation

from drawn import POSES, scene, shot
from omnisight.cli._standouts import standouts
from omnisight.images import ImageField, read_image, write_image
from omnisight.images.ellipse import Ellipse
from omnisight.targets import detect_boards


def detected(run, *arguments):
    status, out, err = run("detect", *arguments, "--pattern", "9x6", "--json")
    assert (status, err) == (0, "")
    return json.loads(out)


def smaller(folder, times=2):
    for i in (5, 6):
        write_image(folder / f"{i}.png", read_image(folder / f"{i}.png")[::times, ::times])


def test_mixed_resolutions_use_the_largest_group_and_name_the_rest_with_sizes_and_remedy(run, folder):
    smaller(folder)
    write_image(folder / "4.png", read_image(folder / "4.png")[:, :600])
    status, out, err = run("calibrate", folder, *QUICK)
    assert (status, err) == (0, "")
    assert "3 of 6 images" in out
    assert "note: images have 3 sizes: 3 of 640x480, which are used; 2 of 320x240 (5.png, 6.png); 1 of 600x480" in out
    table = image_rows(out)
    for name in ("5.png", "6.png"):
        assert table[name].split()[1] == "no"
        assert "320x240 where others have 640x480: left out; half of 640x480" in table[name]
        assert "resize it to 640x480" in table[name]
    assert "600x480 where others have 640x480: left out; cropped, or another camera?" in table["4.png"]


def test_mixed_resolutions_of_a_whole_ratio_are_offered_as_resized(run, folder):
    smaller(folder)
    write_image(folder / "4.png", np.repeat(np.repeat(read_image(folder / "4.png"), 2, 0), 2, 1))
    said = detected(run, folder)
    (note,) = said["notes"]
    assert note.startswith("images have 3 sizes: 3 of 640x480, which are used; 2 of 320x240 (5.png, 6.png); 1 of 1280x")
    assert "320x240 is half of 640x480: resize them" in note
    assert "1280x960 is twice 640x480: resize them" in note
    assert [len(p["boards"]) for p in said["images"]] == [1, 1, 1, 0, 0, 0]
    status, out, _ = run("detect", folder, "-o", folder.parent / "drawn")
    assert status == 0
    assert f"note: {note}" in out


def test_mixed_resolutions_that_leave_too_few_are_refused_with_the_sizes(refuses, folder):
    for i in (1, 2, 3, 4):
        (folder / f"{i}.png").unlink()
    write_image(folder / "5.png", read_image(folder / "5.png")[::2, ::2])
    said = refuses("calibrate", folder, *QUICK)
    assert "the 9x6 board was found in 1 of 2 images" in said
    assert "5.png: 320x240 where others have 640x480: left out; half of 640x480" in said


def test_portrait_and_landscape_set_is_told_as_rotated(run, folder):
    for i in (2, 4):
        write_image(folder / f"{i}.png", np.ascontiguousarray(np.rot90(read_image(folder / f"{i}.png"))))
    said = detected(run, folder)
    (note,) = said["notes"]
    assert "4 of 640x480, which are used; 2 of 480x640 (2.png, 4.png), rotated 90 degrees?" in note
    for i in (1, 3):
        assert "480x640 where others have 640x480: left out; rotated 90 degrees?" in said["images"][i]["note"]


def test_duplicates_are_named_and_counted(run, folder):
    shutil.copy(folder / "1.png", folder / "7.png")
    (folder / "8.jpg").write_bytes(cv2.imencode(".jpg", read_image(folder / "2.png"))[1].tobytes())
    status, out, _ = run("calibrate", folder, *QUICK)
    assert status == 0
    table = image_rows(out)
    assert "the same as 1.png" in table["7.png"]
    assert "the same as 2.png" in table["8.jpg"]
    assert "Images that repeat another one: 2 (1.png = 7.png, 2.png = 8.jpg)" in out
    assert "move the board between images" in out
    assert "note: 2 of 8 images with a board repeat another one" in out


def test_video_near_duplicates_are_counted_with_how_far_they_moved(run, tmp_path):
    shown, _ = shot(POSES[0])
    for i in range(4):  # a film from which every frame was saved
        write_image(tmp_path / f"frame{i}.png", np.roll(shown, (i, 2 * i), (0, 1)))
    write_image(tmp_path / "other.png", shot(POSES[3])[0])
    said = detected(run, tmp_path)
    (note,) = said["notes"]
    assert note.startswith("2 of 5 images with a board repeat another one (no corner moved by more than ")
    assert 2 < float(note.split("more than ")[1].split(" px")[0]) < 4
    assert "move and tilt the board between images, or give the film itself" in note
    assert "hardly differs from frame0.png (by 2.2 px)" in said["images"][1]["note"]
    assert said["images"][2]["note"] == ""
    assert "hardly differs from frame2.png" in said["images"][3]["note"]


def test_blurred_or_moving_pictures_are_told_with_their_blur_and_how_to_leave_them_out(run, folder):
    write_image(folder / "3.png", cv2.GaussianBlur(read_image(folder / "3.png"), (0, 0), 3.0))
    found = detected(run, folder)["images"]
    assert found[2]["blur"] > 2.5 > 1.0 > found[0]["blur"]
    status, out, _ = run("detect", folder, "--pattern", "9x6", "-o", folder.parent / "drawn")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines() if line.split()[-1:] == ["blurred"]] == ["3.png"]
    search = detect_boards([folder / f"{i}.png" for i in range(1, 7)], BOARD)
    said = standouts(search, [f"{i}.png" for i in range(1, 7)], [0.05, 0.06, 0.9, 0.05, None, 0.05])
    assert said is not None
    assert said.startswith(
        "images that stand out from the others' median rms of 0.05 px: 3.png (rms 0.90 px, blurred: "
    )
    assert f"blurred: {search.images[2].blur:.1f} px across its edges where others have 0.7 px" in said
    assert said.endswith("look at them with --draw; to leave them out: --drop 3.png")
    assert standouts(search, [f"{i}.png" for i in range(1, 7)], [0.05, 0.06, 0.05, 0.05, None, 0.05]) is None


def test_corners_outside_the_image_circle_are_flagged_with_their_count(run, folder, monkeypatch):
    circle = ImageField((640, 480), Ellipse((320.0, 240.0), (150.0, 150.0), 0.0))
    monkeypatch.setattr("omnisight.targets.detection.estimate_set_field", lambda *_, **__: circle)
    for picture in detected(run, folder)["images"]:
        outside = len(picture["boards"][0]["outside"])
        assert (f"{outside} corners outside of what the lens shows" in picture["note"]) is (outside > 0)
    assert outside > 20


@pytest.mark.parametrize("number", [1, 2])
def test_too_few_views_are_refused_with_the_number_and_the_least(refuses, shots, number):
    said = refuses("calibrate", *(shots / f"{i + 1}.png" for i in range(number)), *QUICK)
    assert f"the 9x6 board was found in {number} of {number} images; 3 is the least and 10 to 20 are good" in said


def test_too_few_views_that_differ_are_refused_with_the_copies(refuses, shots, tmp_path):
    for name in "abc":
        shutil.copy(shots / "2.png", tmp_path / f"{name}.png")
    said = refuses("calibrate", tmp_path, *QUICK)
    assert "3 images with a board, but only 1 that differ (a.png = b.png, a.png = c.png): 3 is the least" in said
    assert "move and tilt the board between images (--force calibrates all the same)" in said


def test_too_few_views_name_the_parameters_they_leave_open(run, shots):
    told = ("--pattern", "9x6", "--model", "kannala_brandt", "--force", "--json")
    said = json.loads(run("calibrate", shots / "2.png", *told)[1])
    (reason,) = [reason for reason in said["reasons"] if "parameters open" in reason]
    assert "k4 (+-" in reason
    assert "a model with fewer parameters, such as --model equidistant --square-pixels" in reason


def test_blurred_pictures_that_stand_out_are_named_with_the_option_that_leaves_them_out(run, folder):
    path = folder / "3.png"
    blurred = cv2.GaussianBlur(read_image(path), (0, 0), 3.0)
    write_image(path, np.random.default_rng(0).normal(blurred, 25).clip(0, 255).astype(np.uint8))
    _, out, _ = run("calibrate", folder, *QUICK)
    (note,) = [line for line in out.splitlines() if line.startswith("note: images that stand out")]
    assert "3.png (rms " in note
    assert "blurred: " in note
    assert note.endswith("--drop 3.png")


def test_all_parallel_boards_are_not_used_and_the_tilt_is_told(run, tmp_path):
    middle = np.array([4, 2.5, 0])
    for i, (x, y, distance) in enumerate(((0, 0, 9), (2, 1, 8), (-3, 2, 10), (1, -2, 8))):
        turn = Rotation.from_euler("Z", 40 * i, degrees=True).as_matrix()
        placed = turn, np.array([x, y, distance]) - turn @ middle
        write_image(tmp_path / f"{i}.png", scene((BOARD, placed, True)))
    said = json.loads(run("calibrate", tmp_path, *QUICK, "--json")[1])
    assert said["verdict"] == "do not use"
    (tilt,) = [reason for reason in said["reasons"] if "tilt" in reason and "boards" in reason]
    assert "The boards tilt only 0 degrees against each other, which leaves the focal length open" in tilt
    assert "tilted by 30 to 45 degrees" in tilt


def test_calibration_applied_at_another_size_is_refused_with_both_sizes_and_the_scale(refuses, shots, camera_file):
    small = Path(camera_file).with_name("small.png")
    write_image(small, read_image(shots / "1.png")[::2, ::2])
    said = refuses("view", small, "--camera", camera_file, "-o", small.with_name("view.png"))
    assert "small.png: the image is 320x240, the camera 640x480: the same shape, 0.5 times as large" in said
    assert "scale the camera (--scale-camera)" in said
