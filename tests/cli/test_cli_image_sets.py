"""Sets of usable images with a problem: mixed sizes, copies, blur, too few or parallel boards."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from cli_scene import BOARD, QUICK, image_rows, remarks
from scipy.spatial.transform import Rotation

from drawn import POSES, scene, shot
from omnisight.images import ImageField, read_image, write_image
from omnisight.images.ellipse import Ellipse
from omnisight.pipeline.detection.detection_advice import describe_image_outliers
from omnisight.targets import detect_boards
from omnisight.targets.observations import Observations


def detect(run, *arguments):
    status, out, err = run("detect", *arguments, "--pattern", "9x6", "--json")
    assert (status, err) == (0, "")
    return json.loads(out)


def shrink_images(folder, times=2):
    for i in (5, 6):
        write_image(folder / f"{i}.png", read_image(folder / f"{i}.png")[::times, ::times])


def test_of_mixed_sizes_the_most_frequent_is_used_and_the_others_are_noted(run, folder):
    shrink_images(folder)
    write_image(folder / "4.png", read_image(folder / "4.png")[:, :600])
    status, out, _ = run("calibrate", folder, *QUICK, "--verbose")
    assert status == 0
    assert "3 of 6 images" in out
    sizes = "images have 3 sizes: 3 of 640x480, which are used; 2 of 320x240 (5.png, 6.png); 1 of 600x480"
    assert len([text for text in remarks(out) if text.startswith(sizes)]) == 1
    table = image_rows(out)
    for name in ("5.png", "6.png"):
        assert table[name].split()[1] == "-"
        assert "320x240 where others have 640x480: left out; half of 640x480" in table[name]
        assert "resize it to 640x480" in table[name]
    assert "600x480 where others have 640x480: left out; cropped, or another camera?" in table["4.png"]


def test_sizes_with_an_integer_ratio_get_the_advice_to_resize(run, folder):
    shrink_images(folder)
    write_image(folder / "4.png", np.repeat(np.repeat(read_image(folder / "4.png"), 2, 0), 2, 1))
    result = detect(run, folder)
    (note,) = result["notes"]
    assert note.startswith("images have 3 sizes: 3 of 640x480, which are used; 2 of 320x240 (5.png, 6.png); 1 of 1280x")
    assert "320x240 is half of 640x480: resize them" in note
    assert "1280x960 is twice 640x480: resize them" in note
    assert [len(image["boards"]) for image in result["images"]] == [1, 1, 1, 0, 0, 0]
    status, out, _ = run("detect", folder, "-o", folder.parent / "drawn")
    assert status == 0
    assert f"note      {note}" in out


def test_too_few_images_of_one_size_are_rejected_with_the_sizes(refuses, folder):
    for i in (1, 2, 3, 4):
        (folder / f"{i}.png").unlink()
    write_image(folder / "5.png", read_image(folder / "5.png")[::2, ::2])
    error = refuses("calibrate", folder, *QUICK)
    assert "9x6 board detected in 1 of 2 images" in error
    assert "5.png: 320x240 where others have 640x480: left out; half of 640x480" in error


def test_portrait_among_landscape_images_is_noted_as_rotated(run, folder):
    for i in (2, 4):
        write_image(folder / f"{i}.png", np.ascontiguousarray(np.rot90(read_image(folder / f"{i}.png"))))
    result = detect(run, folder)
    (note,) = result["notes"]
    assert "4 of 640x480, which are used; 2 of 480x640 (2.png, 4.png), rotated by 90°?" in note
    for i in (1, 3):
        assert "480x640 where others have 640x480: left out; rotated by 90°?" in result["images"][i]["note"]


def test_copies_of_images_are_named_and_counted(run, folder):
    shutil.copy(folder / "1.png", folder / "7.png")
    (folder / "8.jpg").write_bytes(cv2.imencode(".jpg", read_image(folder / "2.png"))[1].tobytes())
    status, out, _ = run("calibrate", folder, *QUICK, "--verbose")
    assert status == 0
    table = image_rows(out)
    assert "the same as 1.png" in table["7.png"]
    assert "the same as 2.png" in table["8.jpg"]
    assert "2 images repeat another one (1.png = 7.png, 2.png = 8.jpg) and add no information: move the board" in out
    assert [remark.startswith("2 of 8 images with a board repeat another one") for remark in remarks(out)].count(
        True
    ) == 1


def test_nearly_equal_images_are_noted_with_the_largest_movement(run, tmp_path):
    shown, _ = shot(POSES[0])
    for i in range(4):  # all frames of a video
        write_image(tmp_path / f"frame{i}.png", np.roll(shown, (i, 2 * i), (0, 1)))
    write_image(tmp_path / "other.png", shot(POSES[3])[0])
    result = detect(run, tmp_path)
    (note,) = result["notes"]
    assert note.startswith("2 of 5 images with a board repeat another one (no corner moved by more than ")
    assert 2 < float(note.split("more than ")[1].split(" px")[0]) < 4
    assert "move and tilt the board between images, or use the video itself" in note
    assert "nearly the same as frame0.png (moved by 2.2 px)" in result["images"][1]["note"]
    assert result["images"][2]["note"] == ""
    assert "nearly the same as frame2.png" in result["images"][3]["note"]


def test_blurred_images_are_noted_with_their_blur(run, folder):
    write_image(folder / "3.png", cv2.GaussianBlur(read_image(folder / "3.png"), (0, 0), 3.0))
    images = detect(run, folder)["images"]
    assert images[2]["blur"] > 2.5 > 1.0 > images[0]["blur"]
    status, out, _ = run("detect", folder, "--pattern", "9x6", "-o", folder.parent / "drawn")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines() if line.split()[-1:] == ["blurred"]] == ["3.png"]
    detections = detect_boards([folder / f"{i}.png" for i in range(1, 7)], BOARD)
    observations = Observations.from_detections(detections, [f"{i}.png" for i in range(1, 7)])
    message = describe_image_outliers(observations, [0.05, 0.06, 0.9, 0.05, None, 0.05])
    assert message is not None
    assert message.startswith("images with an rms far above the median of 0.05 px: 3.png (0.90 px, blurred: ")
    assert f"blurred: {detections.images[2].blur:.1f} px across edges, 0.7 px in other images" in message
    assert message.endswith("look at them with --draw, or leave them out: --drop 3.png")
    assert describe_image_outliers(observations, [0.05, 0.06, 0.05, 0.05, None, 0.05]) is None


def test_corners_outside_the_image_circle_are_counted(run, folder, monkeypatch):
    circle = ImageField((640, 480), Ellipse((320.0, 240.0), (150.0, 150.0), 0.0))
    monkeypatch.setattr("omnisight.targets.detection.estimate_set_field", lambda *_, **__: circle)
    counts = []
    for image in detect(run, folder)["images"]:
        outside = len(image["boards"][0]["outside"])
        assert (f"{outside} corners outside of the image circle" in image["note"]) is (outside > 0)
        counts.append(outside)
    assert max(counts) > 20


@pytest.mark.parametrize("number", [1, 2])
def test_too_few_images_are_rejected_with_the_required_number(refuses, shots, number):
    error = refuses("calibrate", *(shots / f"{i + 1}.png" for i in range(number)), *QUICK)
    assert f"9x6 board detected in {number} of {number} images; at least 3 are needed, 10 to 20 are good" in error
    assert "--force" in error


def test_too_few_distinct_images_are_rejected_with_the_copies(refuses, shots, tmp_path):
    for name in "abc":
        shutil.copy(shots / "2.png", tmp_path / f"{name}.png")
    error = refuses("calibrate", tmp_path, *QUICK)
    assert "3 images with a board, of which only 1 is distinct (a.png = b.png, a.png = c.png): at least 3 are" in error
    assert "move and tilt the board between images (--force calibrates anyway)" in error


def test_undetermined_parameters_are_named(run, shots):
    options = ("--pattern", "9x6", "--model", "kannala_brandt", "--force", "--json")
    result = json.loads(run("calibrate", shots / "2.png", *options)[1])
    (reason,) = [reason for reason in result["reasons"] if "parameters" in reason]
    assert "k4 (±" in reason
    assert "take 10 to 20 images" in reason


def test_images_with_a_large_rms_are_named_with_the_option_to_drop_them(run, folder):
    path = folder / "3.png"
    blurred = cv2.GaussianBlur(read_image(path), (0, 0), 3.0)
    write_image(path, np.random.default_rng(0).normal(blurred, 25).clip(0, 255).astype(np.uint8))
    _, out, _ = run("calibrate", folder, *QUICK, "--verbose")
    (remark,) = [remark for remark in remarks(out) if remark.startswith("images with an rms far above the median")]
    assert "3.png (" in remark
    assert "blurred: " in remark
    assert remark.endswith("--drop 3.png")


def test_parallel_boards_give_a_verdict_that_names_the_tilt(run, tmp_path):
    middle = np.array([4, 2.5, 0])
    for i, (x, y, distance) in enumerate(((0, 0, 9), (2, 1, 8), (-3, 2, 10), (1, -2, 8))):
        turn = Rotation.from_euler("Z", 40 * i, degrees=True).as_matrix()
        placed = turn, np.array([x, y, distance]) - turn @ middle
        write_image(tmp_path / f"{i}.png", scene((BOARD, placed, True)))
    result = json.loads(run("calibrate", tmp_path, *QUICK, "--json")[1])
    assert result["verdict"] == "do not use"
    (tilt,) = [reason for reason in result["reasons"] if "tilted by only" in reason]
    assert "The boards are tilted by only 0° against each other" in tilt
    assert "does not determine the focal length" in tilt
    assert "tilted by 30° to 45°" in tilt


def test_a_view_of_another_image_size_is_rejected_with_both_sizes(refuses, shots, camera_file):
    small = Path(camera_file).with_name("small.png")
    write_image(small, read_image(shots / "1.png")[::2, ::2])
    error = refuses("view", small, "--camera", camera_file, "-o", small.with_name("view.png"))
    assert "small.png: the image is 320x240, the camera 640x480: 0.5 times as large; if the image was resized" in error
    assert "scale the camera (--scale-camera)" in error
