"""Reading, writing and collecting image files."""

import contextlib
import errno
import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from jpegs import jpeg, jpeg_at
from omnisight.images import (
    UnreadableImage,
    collect_images,
    decode_image,
    exif_orientation,
    exif_position,
    read_image,
    to_gray8,
    write_bytes,
    write_image,
)
from omnisight.images.collect import folders_with_images
from omnisight.images.output_paths import image_labels
from omnisight.images.read import apply_orientation

GRADIENT = np.arange(60, dtype=np.uint8).reshape(6, 10) * 4
COLOURS = np.stack([GRADIENT, 255 - GRADIENT, GRADIENT // 2], axis=2)


@pytest.mark.parametrize("extension", ["png", "PNG", "tif", "TIFF", "bmp", "ppm", "webp"])
@pytest.mark.parametrize("name", ["plain", "with space", "bild_äöü_写真"])
def test_written_images_are_read_back(tmp_path, extension, name):
    path = tmp_path / f"{name}.{extension}"
    write_image(path, COLOURS)
    assert np.abs(read_image(path).astype(int) - COLOURS).max() <= (12 if extension == "webp" else 0)
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("shape", [(6, 10), (6, 10, 3), (6, 10, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("extension", ["png", "tif"])
def test_depth_and_channels_are_preserved(tmp_path, shape, dtype, extension):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape).astype(dtype)
    write_image(tmp_path / f"x.{extension}", image)
    back = read_image(tmp_path / f"x.{extension}")
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, image)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "empty file"),
        (b"hello, this is text", r"not an image \(starts with the text 'hello, this is t'\)"),
        (b"%PDF-1.7\n%\xe2\xe3", r"not an image \(starts with the text '%PDF-1.7'\)"),
        (b"\x1f\x8b\x08\0\0\0", r"not an image \(starts with the bytes 1f 8b 08 00 00\)"),
        (b"\n\n", r"not an image \(starts with the bytes 0a 0a\)"),
        (jpeg(COLOURS)[:-40], r"truncated JPEG \(no end-of-image marker\)"),
        (b"\xff\xd8\xff", "truncated JPEG"),
        (cv2.imencode(".png", COLOURS)[1].tobytes()[:-20], "truncated PNG"),
        (cv2.imencode(".bmp", COLOURS)[1].tobytes()[:-60], "damaged or unsupported BMP"),
        (cv2.imencode(".tif", COLOURS)[1].tobytes()[:-60], "damaged or unsupported TIFF"),
        (b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 2**31, 2**31), "pixels declared"),
    ],
)
def test_unreadable_file_error_has_name_and_reason_and_nothing_is_printed(tmp_path, capfd, data, reason):
    path = tmp_path / "img07.jpg"
    path.write_bytes(data)
    with pytest.raises(UnreadableImage, match=r"^img07\.jpg: .*" + reason):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_a_flipped_bit_in_a_png_is_detected():
    data = bytearray(cv2.imencode(".png", COLOURS)[1].tobytes())
    data[len(data) // 2] ^= 1
    with pytest.raises(UnreadableImage, match="damaged PNG"):
        decode_image(bytes(data), "x.png")


def test_missing_file_and_folder_are_unreadable(tmp_path):
    with pytest.raises(UnreadableImage, match="no such file"):
        read_image(tmp_path / "none.png")
    with pytest.raises(UnreadableImage):
        read_image(tmp_path)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("good", [jpeg(COLOURS, orientation=6), cv2.imencode(".png", COLOURS)[1].tobytes()])
def test_corrupt_bytes_decode_or_raise_unreadable(seed, good):
    rng = np.random.default_rng(seed)
    for _ in range(50):
        data = bytearray(good)
        for at in rng.integers(0, min(len(data), 120), 3):
            data[at] = rng.integers(256)
        exif_orientation(bytes(data))
        exif_orientation(bytes(data[: rng.integers(len(data))]))
        with contextlib.suppress(UnreadableImage):
            decode_image(bytes(data), "x")


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_ignored_by_default(orientation, order):
    block = np.kron(np.array([[255, 0, 0], [128, 0, 64]], np.uint8), np.ones((16, 16), np.uint8))
    data = jpeg(block, orientation, order)
    assert exif_orientation(data) == orientation
    plain = decode_image(data, "x")
    assert plain.shape == (32, 48)
    turned = decode_image(data, "x", apply_exif=True)
    np.testing.assert_array_equal(turned, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE))
    np.testing.assert_array_equal(turned, apply_orientation(plain, orientation))


def test_missing_or_invalid_exif_orientation_is_upright():
    assert exif_orientation(jpeg(COLOURS)) == 1
    assert exif_orientation(b"") == 1
    assert exif_orientation(jpeg(COLOURS, orientation=77)) == 1


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("x.xyz", GRADIENT, r"cannot write extension '\.xyz'"),
        ("x", GRADIENT, "x: has no extension: name an image file, such as x.png"),
        ("x.jpg", GRADIENT.astype(np.uint16), "8 bits per channel"),
        ("x.jpg", np.zeros((4, 4, 4), np.uint8), "no transparency"),
        ("x.pgm", COLOURS, "gray images only"),
        ("x.png", GRADIENT.astype(float), "uint8 or uint16, got float64"),
        ("x.png", np.zeros((4, 4, 2), np.uint8), r"got shape \(4, 4, 2\)"),
    ],
)
def test_unsupported_writes_raise_value_error(tmp_path, name, image, message):
    with pytest.raises(ValueError, match=message):
        write_image(tmp_path / name, image)
    assert not os.listdir(tmp_path)


def test_writing_to_a_missing_folder_names_the_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"the folder .*nowhere does not exist"):
        write_image(tmp_path / "nowhere" / "x.png", GRADIENT)


def test_an_error_of_a_read_only_file_system_names_the_file(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError(errno.EROFS, "Read-only file system", "a temporary file")

    for name in ("open", "unlink"):
        monkeypatch.setattr(Path, name, fail)
    with pytest.raises(OSError, match=r"cannot write .*view\.png: Read-only file system"):
        write_image(tmp_path / "view.png", np.zeros((4, 4), np.uint8))


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "x.txt"
    path.write_bytes(b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match=r"cannot write .*x\.txt: No space left"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["x.txt"]


def test_collected_images_are_unique_in_natural_order_with_any_case(tmp_path):
    for name in ["img10.JPG", "img2.jpg", "Img1.PNG", "notes.txt", "a[1].tif"]:
        (tmp_path / name).touch()
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "img3.jpg").touch()
    names = ["a[1].tif", "Img1.PNG", "img2.jpg", "img10.JPG"]
    assert [p.name for p in collect_images([tmp_path])] == names
    assert [p.name for p in collect_images(tmp_path)] == names
    twice = [
        tmp_path,
        tmp_path / "img2.jpg",
        str(tmp_path / "*.JPG"),
        tmp_path / "sub" / ".." / "img2.jpg",
    ]
    assert [p.name for p in collect_images(twice)] == names
    assert [p.name for p in collect_images([tmp_path / "a[1].tif"])] == ["a[1].tif"]
    assert [p.name for p in collect_images([str(tmp_path / "*")])] == names


def test_the_only_sub_folder_with_images_is_used(tmp_path):
    for folder in ("cam0/data", "cam1/data", "cam1/omnisight-detect"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "1403715278262142976.png").touch()
    for camera in ("cam0", "cam1"):
        (tmp_path / camera / "data.csv").touch()
        assert collect_images([tmp_path / camera]) == [tmp_path / camera / "data" / "1403715278262142976.png"]
    with pytest.raises(
        ValueError, match=r"no images in .* \(found no files\)\. Specify .*, such as .*cam0.data\. Supp"
    ):
        collect_images([tmp_path])


def test_the_search_of_sub_folders_ends_in_loops_of_links(tmp_path):
    image = tmp_path / "one" / "a.png"
    image.parent.mkdir()
    image.touch()
    (tmp_path / "two").mkdir()
    for name, target in {"up": tmp_path, "up2": tmp_path, "self": "self", "again": image.parent}.items():
        (tmp_path / "two" / name).symlink_to(target)
    assert folders_with_images(tmp_path) == [image.parent]
    assert collect_images(tmp_path) == [image]


def test_a_folder_of_too_many_sub_folders_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.images.collect.MAX_FOLDERS", 3)
    for k in range(3):
        (tmp_path / f"{k}").mkdir()
    with pytest.raises(ValueError, match="no images in"):
        collect_images(tmp_path)
    (tmp_path / "3").mkdir()
    with pytest.raises(ValueError, match="no images, and more than 3 sub-folders: specify the folder of the images"):
        collect_images(tmp_path)
    (tmp_path / "a.png").touch()
    assert collect_images(tmp_path) == [tmp_path / "a.png"]


def test_sub_folders_that_cannot_be_read_are_left_out(tmp_path, monkeypatch):
    for name in ("lost+found", "images"):
        (tmp_path / name).mkdir()
    (tmp_path / "images" / "a.png").touch()
    listdir = os.listdir

    def refuse(path):
        if Path(path).name == "lost+found":
            raise PermissionError(path)
        return listdir(path)

    monkeypatch.setattr(os, "listdir", refuse)
    assert collect_images(tmp_path) == [tmp_path / "images" / "a.png"]


def test_collecting_no_image_lists_the_other_files(tmp_path):
    for i in range(3):
        (tmp_path / f"{i}.txt").touch()
    with pytest.raises(ValueError, match=r"no images in .* \(found 3 \.txt\)\. Supported: jpg .*, any case"):
        collect_images([tmp_path])
    with pytest.raises(FileNotFoundError, match="gone: no such file or folder"):
        collect_images([tmp_path / "gone"])
    with pytest.raises(FileNotFoundError, match="matches no file"):
        collect_images([str(tmp_path / "*.jpg")])
    with pytest.raises(ValueError, match="no images in an empty list"):
        collect_images([])


def test_8_bit_gray_is_unchanged_and_deeper_images_are_stretched():
    np.testing.assert_array_equal(to_gray8(GRADIENT), GRADIENT)
    for deep in (GRADIENT.astype(np.uint16) * 3 + 1000, GRADIENT / 1e6, GRADIENT.astype(np.int32) - 500):
        gray = to_gray8(deep)
        assert gray.dtype == np.uint8
        assert (gray.min(), gray.max()) == (0, 255)
        assert (np.diff(gray.astype(int), axis=1) >= 0).all()


def test_gray_of_colour_alpha_and_nan():
    assert to_gray8(np.full((4, 4, 3), [255, 0, 0], np.uint8))[0, 0] == 76
    masked = np.dstack([COLOURS, np.where(GRADIENT > 100, 255, 0).astype(np.uint8)])
    assert (to_gray8(masked)[GRADIENT <= 100] == 0).all()
    holes = np.where(GRADIENT > 100, GRADIENT, np.nan)
    assert (to_gray8(holes)[GRADIENT <= 100] == 0).all()
    assert not to_gray8(np.full((4, 4), np.nan)).any()
    assert not to_gray8(np.full((4, 4), 7000, np.uint16)).any()
    with pytest.raises(ValueError, match=r"got shape \(4,\)"):
        to_gray8(np.zeros(4))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("position", [(47.36667, 8.55, 432.5), (-33.9, -18.4, -3.25)])
def test_the_position_of_an_image_is_read(position, order):
    found = exif_position(jpeg_at(COLOURS, *position, order))
    assert found == pytest.approx(position, abs=1e-7)


def test_a_missing_position_or_altitude_is_unknown():
    assert exif_position(jpeg(COLOURS, orientation=1)) is None
    assert exif_position(b"") is None
    assert exif_position(jpeg_at(COLOURS, 95.0, 8.0)) is None
    assert np.isnan(exif_position(jpeg_at(COLOURS, 47.0, 8.0)).altitude)


def test_damaged_exif_tags_are_no_position_or_a_valid_one():
    good, rng = jpeg_at(COLOURS, 47.0, 8.0, 400.0), np.random.default_rng(0)
    for _ in range(300):
        data = bytearray(good)
        for at in rng.integers(2, 180, 3):
            data[at] = rng.integers(256)
        found = exif_position(bytes(data[: rng.integers(len(data))]))
        assert found is None or (abs(found.latitude) <= 90 and abs(found.longitude) <= 180)


def test_labels_of_files_with_equal_names_have_their_folders():
    assert image_labels([Path("a.png"), Path("left/b.png")]) == ["a.png", "b.png"]
    assert image_labels([Path("left/a.png"), Path("right/a.png")]) == ["left/a.png", "right/a.png"]
    assert image_labels([Path("a.png"), Path("left/a.png")]) == ["./a.png", "left/a.png"]
