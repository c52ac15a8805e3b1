"""Images that are missing, damaged or of another kind."""

import json

import cv2
import numpy as np
import pytest
from cli_scene import QUICK, SIZE, damage_image, image_rows

from jpegs import jpeg
from omnisight.formats import load
from omnisight.images import read_image, write_image


@pytest.mark.parametrize("name", ["empty", "of text"])
def test_a_folder_without_images_is_rejected_with_its_content(refuses, tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    if name == "of text":
        for i in range(3):
            (folder / f"{i}.txt").write_text("no")
    error = refuses("calibrate", folder)
    content = "3 .txt" if name == "of text" else "no files"
    assert f"no images in {folder} (found {content}). Supported: jpg jpeg png tif" in error


@pytest.mark.parametrize("path", ["nowhere", "nowhere/*.png", "nowhere/a.png"])
def test_a_missing_input_is_named(refuses, tmp_path, path):
    error = refuses("calibrate", tmp_path / path)
    assert str(tmp_path / path) in error
    assert ("the pattern matches no file" if "*" in path else "no such file or folder") in error


@pytest.mark.parametrize(
    ("damage", "note"),
    [
        ("text", "not an image (starts with the text 'no image data')"),
        ("empty", "empty file"),
        ("truncated", "truncated JPEG (no end-of-image marker)"),
        ("black", "no 9x6 board detected"),
        ("damaged", "damaged PNG (checksum of chunk b'IDAT'"),
        ("HEIC", "a HEIC or AVIF image, which is not supported: export it as JPEG or PNG"),
        ("LFS", "a Git LFS pointer, not the image itself: run git lfs pull"),
    ],
)
def test_an_unusable_image_is_left_out_with_the_reason(run, folder, damage, note):
    damage_image(folder / "3.png", damage)
    status, out, err = run("detect", folder, "--pattern", "9x6", "-o", folder.parent / "drawn")
    assert (status, err) == (0, "")
    (line,) = [line for line in out.splitlines() if line.startswith("3.")]
    assert line.split()[1] == "-"
    assert note in line
    assert line.count(line.split()[0]) == 1  # the name is not repeated in the note
    assert "5 of 6 images" in out


def test_a_camera_is_calibrated_from_the_usable_images(run, folder):
    damage_image(folder / "2.png", "truncated")
    damage_image(folder / "3.png", "black")
    status, out, err = run("calibrate", folder, *QUICK)
    assert (status, err) == (0, "")
    assert "4 of 6 images" in out
    for name, note in (("2.jpg", "truncated JPEG"), ("3.png", "no 9x6 board detected")):
        assert image_rows(out)[name].split()[1] == "-"
        assert note in image_rows(out)[name]


def test_too_few_usable_images_are_rejected_with_the_notes_of_the_others(refuses, folder):
    for i, damage in enumerate(("text", "empty", "truncated", "black")):
        damage_image(folder / f"{i + 1}.png", damage)
    error = refuses("calibrate", folder, *QUICK)
    assert "9x6 board detected in 2 of 6 images" in error
    assert "at least 3 are needed" in error
    for note in ("1.jpg: not an image", "2.jpg: empty file", "3.jpg: truncated JPEG", "4.png: no 9x6 board"):
        assert note in error


@pytest.mark.parametrize("number", [1, 2])
def test_force_calibrates_from_fewer(run, shots, tmp_path, number):
    images = [shots / f"{i + 1}.png" for i in range(number)]
    status, out, _ = run("calibrate", *images, *QUICK, "--force", "-o", tmp_path / "c.json", "--json")
    assert status == 0
    assert json.loads(out)["held_out_rms"] is None
    assert load(tmp_path / "c.json").size == SIZE


def convert_image(folder, i, kind):
    """Replace image number i by another kind of file."""
    path = folder / f"{i}.png"
    good = read_image(path)
    path.unlink()
    match kind:
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


@pytest.mark.parametrize("kind", ["16 bit", "RGBA", "RGB", "gif", "JPG", "Tif", "bmp", "wrong name"])
def test_every_kind_of_image_is_read(run, folder, kind):
    if kind == "gif" and not cv2.haveImageWriter("a.gif"):
        pytest.skip("this OpenCV writes no GIF")
    for i in (2, 5):
        convert_image(folder, i, kind)
    status, out, err = run("detect", folder, "--pattern", "9x6", "--json")
    assert (status, err) == (0, "")
    images = json.loads(out)["images"]
    assert [len(image["boards"]) for image in images] == [1] * 6
    if kind == "RGBA":
        assert "of 54 corners" in images[1]["note"]  # transparent pixels are ignored
    else:
        assert min(len(image["boards"][0]["ids"]) for image in images) > 50


def test_the_exif_orientation_is_ignored_with_one_note(run, folder):
    for i in (2, 5):
        path = folder / f"{i}.png"
        path.with_suffix(".jpg").write_bytes(jpeg(read_image(path), orientation=6))
        path.unlink()
    status, out, _ = run("calibrate", folder, *QUICK)
    assert status == 0
    assert "6 of 6 images" in out
    assert "EXIF orientation 6 ignored" in image_rows(out)["2.jpg"]
    assert out.count("EXIF") == 1


def test_apply_exif_rotates_images(run, folder):
    first = folder / "1.png"
    first.with_suffix(".jpg").write_bytes(jpeg(read_image(first), orientation=6))
    first.unlink()
    (rotated, *others) = json.loads(run("detect", folder, "--json", "--apply-exif")[1])["images"]
    assert rotated["note"].startswith("480x640 where others have 640x480: left out; rotated by 90°?")
    assert "as the sensor wrote it, not rotated on saving or by --apply-exif" in rotated["note"]
    assert len(others) == 5
    assert all(other["boards"] for other in others)
    for i in range(2, 7):
        path = folder / f"{i}.png"
        path.with_suffix(".jpg").write_bytes(jpeg(read_image(path), orientation=6))
        path.unlink()
    status, out, _ = run("calibrate", folder, *QUICK, "--apply-exif", "--json")
    assert status == 0
    assert json.loads(out)["camera"]["size"] == [480, 640]
    assert [image["note"].count("EXIF") for image in json.loads(out)["images"]] == [0] * 6
