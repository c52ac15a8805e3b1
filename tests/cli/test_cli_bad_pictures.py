"""omnisight calibrate: images that are none, or odd ones."""

import json

import cv2
import numpy as np
import pytest
from cli_scene import QUICK, SIZE, damage_image, image_rows

from jpegs import jpeg
from omnisight.formats import load
from omnisight.images import read_image, write_image


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


@pytest.mark.parametrize(
    ("how", "note"),
    [
        ("text", "not an image (starts with b'I am ')"),
        ("empty", "empty file"),
        ("truncated", "truncated JPEG (no end-of-image marker)"),
        ("black", "no 9x6 board found"),
        ("damaged", "damaged PNG (checksum of chunk b'IDAT'"),
        ("HEIC", "3.jpg: a HEIC or AVIF image, which is not read: export it as JPEG or PNG"),
        ("LFS", "3.jpg: a Git LFS pointer, not the image itself: run git lfs pull"),
    ],
)
def test_a_bad_picture_among_good_ones_is_left_out_with_its_reason(run, folder, how, note):
    damage_image(folder / "3.png", how)
    status, out, err = run("detect", folder, "--pattern", "9x6", "-o", folder.parent / "drawn")
    assert (status, err) == (0, "")
    (line,) = [line for line in out.splitlines() if line.startswith("3.")]
    assert line.split()[1] == "-"
    assert note in line
    assert "5 of 6 images" in out


def test_a_camera_comes_of_the_good_pictures(run, folder):
    damage_image(folder / "2.png", "truncated")
    damage_image(folder / "3.png", "black")
    status, out, err = run("calibrate", folder, *QUICK)
    assert (status, err) == (0, "")
    assert "4 of 6 images" in out
    for name, note in (("2.jpg", "2.jpg: truncated JPEG"), ("3.png", "no 9x6 board found")):
        assert image_rows(out)[name].split()[1] == "no"
        assert note in image_rows(out)[name]


def test_too_few_good_pictures_are_told_with_the_bad_ones(refuses, folder):
    for i, how in enumerate(("text", "empty", "truncated", "black")):
        damage_image(folder / f"{i + 1}.png", how)
    said = refuses("calibrate", folder, *QUICK)
    assert "the 9x6 board was found in 2 of 6 images" in said
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
    """Write image number i again in another kind of file."""
    path = folder / f"{i}.png"
    good = read_image(path)
    path.unlink()
    match how:
        case "16 bit":
            write_image(path, (good.astype(np.uint16) * 40 + 500))
        case "RGBA":
            alpha = np.full_like(good, 255)
            alpha[:, :300] = 0
            write_image(path, np.dstack([good, good, good, alpha]))
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
    status, out, err = run("detect", folder, "--pattern", "9x6", "--json")
    assert (status, err) == (0, "")
    pictures = json.loads(out)["images"]
    assert [len(picture["boards"]) for picture in pictures] == [1] * 6
    if how == "RGBA":
        assert "of 54 corners" in pictures[1]["note"]  # what is transparent is not looked at
    else:
        assert min(len(picture["boards"][0]["ids"]) for picture in pictures) > 50


def test_a_turned_picture_is_taken_as_the_sensor_read_it_with_one_warning(run, folder):
    for i in (2, 5):
        path = folder / f"{i}.png"
        path.with_suffix(".jpg").write_bytes(jpeg(read_image(path), orientation=6))
        path.unlink()
    status, out, _ = run("calibrate", folder, *QUICK)
    assert status == 0
    assert "6 of 6 images" in out
    assert "EXIF orientation 6 ignored" in image_rows(out)["2.jpg"]
    assert out.count("EXIF") == 1


def test_turned_pictures_are_turned_on_request(run, folder):
    first = folder / "1.png"
    first.with_suffix(".jpg").write_bytes(jpeg(read_image(first), orientation=6))
    first.unlink()
    (picture, *others) = json.loads(run("detect", folder, "--json", "--apply-exif")[1])["images"]
    assert picture["note"].startswith("480x640 where others have 640x480: left out; rotated 90 degrees?")
    assert "as the sensor read it, not turned on saving or by --apply-exif" in picture["note"]
    assert len(others) == 5
    assert all(other["boards"] for other in others)
    for i in range(2, 7):
        path = folder / f"{i}.png"
        path.with_suffix(".jpg").write_bytes(jpeg(read_image(path), orientation=6))
        path.unlink()
    status, out, _ = run("calibrate", folder, *QUICK, "--apply-exif", "--json")
    assert status == 0
    assert json.loads(out)["camera"]["size"] == [480, 640]
    assert not any(picture["note"].count("EXIF") for picture in json.loads(out)["images"])
