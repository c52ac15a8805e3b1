"""Views keep the EXIF tags of their photo that hold for them; Pillow writes the photos and reads the views."""

import struct

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

import omnisight as om
from omnisight.images.exif import exif_orientation, exif_position
from omnisight.images.gpano import read_gpano
from omnisight.images.view_tags import view_tags, with_view_tags

MAKE, ORIENTATION, DETAILS, GPS = 0x010F, 0x0112, 0x8769, 0x8825
TAKEN, FOCAL_LENGTH, EXPOSURE, BIAS = 0x9003, 0x920A, 0x829A, 0x9204


@pytest.fixture
def photo(tmp_path):
    """A 360 photo with tags."""
    path = tmp_path / "photo.jpg"
    exif = Image.Exif()
    exif[MAKE], exif[ORIENTATION] = "Maker of cameras", 6
    exif.get_ifd(DETAILS).update({TAKEN: "2026:05:04 03:02:01", FOCAL_LENGTH: IFDRational(3, 2)})
    exif.get_ifd(DETAILS).update({EXPOSURE: IFDRational(1, 250), BIAS: IFDRational(-1, 2)})
    exif.get_ifd(GPS).update({1: "S", 2: (33.0, 51.0, 24.5), 3: "E", 4: (151.0, 12.0, 36.0), 5: b"\0", 6: 58.25})
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 255, (100, 200, 3), np.uint8)).save(path, exif=exif)
    return path


@pytest.mark.parametrize("name", ["view.jpg", "view.png"])
def test_view_keeps_the_time_the_make_and_the_position(photo, tmp_path, name):
    om.view(photo, None, tmp_path / name, om.ViewOptions(size=(60, 40)))
    with Image.open(tmp_path / name) as view:
        exif = view.getexif()
        assert view.size == (60, 40)
    details, gps = exif.get_ifd(DETAILS), exif.get_ifd(GPS)
    assert exif[MAKE] == "Maker of cameras"
    assert details[TAKEN] == "2026:05:04 03:02:01"
    assert details[EXPOSURE] == pytest.approx(0.004)
    assert details[BIAS] == -0.5
    assert (gps[1], gps[2], gps[6]) == ("S", (33.0, 51.0, 24.5), 58.25)
    assert exif_position((tmp_path / name).read_bytes()) == exif_position(photo.read_bytes())


@pytest.mark.parametrize("name", ["view.jpg", "view.png"])
def test_view_has_neither_the_orientation_nor_the_focal_length_of_the_photo(photo, tmp_path, name):
    om.view(photo, None, tmp_path / name, om.ViewOptions(size=(60, 40)))
    with Image.open(tmp_path / name) as view:
        assert ORIENTATION not in view.getexif()
        assert FOCAL_LENGTH not in view.getexif().get_ifd(DETAILS)


def test_view_of_a_view_keeps_the_tags(photo, tmp_path):
    om.view(photo, None, tmp_path / "sphere.png", om.ViewOptions("sphere", size=(200, 100)))
    om.view(tmp_path / "sphere.png", None, tmp_path / "view.jpg", om.ViewOptions(size=(60, 40)))
    assert view_tags((tmp_path / "view.jpg").read_bytes()) == view_tags(photo.read_bytes())


@pytest.mark.parametrize(
    ("options", "whole", "offset", "size"),
    [
        (om.ViewOptions("sphere", size=(200, 100)), (200, 100), (0, 0), (200, 100)),
        (
            om.ViewOptions("sphere", size=(100, 50), azimuth=(-90, 90), elevation=(-45, 90)),
            (200, 100),
            (50, 0),
            (100, 75),
        ),
    ],
)
def test_sphere_has_the_tags_with_which_viewers_show_it(photo, tmp_path, options, whole, offset, size):
    om.view(photo, None, tmp_path / "sphere.jpg", options)
    tags = read_gpano((tmp_path / "sphere.jpg").read_bytes())
    assert tags["ProjectionType"] == "equirectangular"
    for name, expected in [("FullPano", whole), ("CroppedAreaImage", size)]:
        assert (int(tags[f"{name}WidthPixels"]), int(tags[f"{name}HeightPixels"])) == expected
    assert (int(tags["CroppedAreaLeftPixels"]), int(tags["CroppedAreaTopPixels"])) == offset
    with Image.open(tmp_path / "sphere.jpg") as sphere:
        assert sphere.size == size
        assert sphere.getexif()[MAKE] == "Maker of cameras"


def test_view_that_is_no_sphere_has_no_tags_of_one(photo, tmp_path):
    om.view(photo, None, tmp_path / "view.jpg", om.ViewOptions(size=(60, 40)))
    assert read_gpano((tmp_path / "view.jpg").read_bytes()) == {}


def test_image_without_tags_is_written_without(tmp_path):
    om.write_image(tmp_path / "plain.jpg", np.full((100, 200, 3), 90, np.uint8))
    om.view(tmp_path / "plain.jpg", None, tmp_path / "view.jpg", om.ViewOptions(size=(60, 40)))
    assert b"Exif" not in (tmp_path / "view.jpg").read_bytes()


def test_orientation_of_a_png_file(tmp_path):
    exif = Image.Exif()
    exif[ORIENTATION] = 8
    Image.fromarray(np.zeros((4, 6), np.uint8)).save(tmp_path / "a.png", exif=exif)
    assert exif_orientation((tmp_path / "a.png").read_bytes()) == 8
    assert om.read_image(tmp_path / "a.png").shape == (4, 6)
    assert om.read_image(tmp_path / "a.png", apply_exif=True).shape == (6, 4)


def test_damaged_tags_raise_nothing(photo):
    data = photo.read_bytes()
    for end in range(20, 400, 7):
        view_tags(data[:end])
    rng = np.random.default_rng(1)
    for _ in range(300):
        damaged = bytearray(data[:600])
        for at in rng.integers(20, 600, 6):
            damaged[at] = rng.integers(256)
        with_view_tags(data, view_tags(bytes(damaged)))


def test_tags_that_all_point_to_one_long_text_are_left_out():
    text, tags = b"x" * 60_000, (0x010E, 0x010F, 0x0110)
    first = struct.pack("<H", 3) + b"".join(struct.pack("<HHII", tag, 2, len(text), 60) for tag in tags) + bytes(4)
    tiff = (b"II*\0" + struct.pack("<I", 8) + first).ljust(60, b"\0") + text
    payload = b"Exif\0\0" + tiff
    jpeg = b"\xff\xd8\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload + b"\xff\xd9"
    assert view_tags(jpeg) == b""
