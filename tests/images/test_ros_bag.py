"""Images of ROS bags, against the arrays that rosbags has written."""

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags")

from tests.bags import RECORDED_NS, compressed, raw, write_bag

from omnisight.images.read import UnreadableImage
from omnisight.images.ros_bag import ImageBag, is_bag

RGB = np.random.default_rng(0).integers(0, 256, (12, 10, 3), np.uint8)
DEEP = np.random.default_rng(1).integers(0, 2**16, (12, 10), np.uint16)
SMOOTH = np.indices((12, 10)).sum(0).astype(np.uint8)[..., None] * np.array([3, 2, 1], np.uint8) + np.uint8(20)
# The colours of the first two rows and columns of a Bayer pattern: indices of RGB.
PATTERNS = {"rggb": (0, 1, 1, 2), "bggr": (2, 1, 1, 0), "gbrg": (1, 2, 0, 1), "grbg": (1, 0, 2, 1)}
FORMS = ["drive.bag", "drive"]


def images(path, topic=None):
    return [(frame.seconds, frame.image, frame.reason) for frame in ImageBag.open(path, topic).frames()]


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize(
    ("data", "encoding", "expected"),
    [
        (RGB, "rgb8", RGB),
        (RGB[..., ::-1], "bgr8", RGB),
        (RGB[..., [2, 1, 0, 0]], "bgra8", RGB),
        (RGB[..., 0], "mono8", RGB[..., 0]),
        (DEEP, "mono16", DEEP),
    ],
)
def test_raw_images_have_the_written_pixels_and_times(tmp_path, name, data, encoding, expected):
    options = {"padding": 6, "big_endian": encoding == "mono16"}
    bag = write_bag(tmp_path / name, {"/cam": [raw(data, encoding, 1700000000.25, **options)] * 1})
    assert is_bag(bag)
    ((seconds, image, reason),) = images(bag)
    assert (seconds, reason) == (pytest.approx(1700000000.25, abs=1e-6), "")
    assert image.dtype == expected.dtype
    assert np.array_equal(image, expected)


@pytest.mark.parametrize("order", PATTERNS)
def test_bayer_patterns_have_their_colours(tmp_path, order):
    mosaic = np.empty(SMOOTH.shape[:2], np.uint8)
    for k, channel in enumerate(PATTERNS[order]):
        mosaic[k // 2 :: 2, k % 2 :: 2] = SMOOTH[k // 2 :: 2, k % 2 :: 2, channel]
    ((_, image, _),) = images(write_bag(tmp_path / "b.bag", {"/cam": [raw(mosaic, f"bayer_{order}8", 1.0)]}))
    assert np.abs(image[2:-2, 2:-2].astype(int) - SMOOTH[2:-2, 2:-2]).max() <= 2


@pytest.mark.parametrize("name", FORMS)
def test_compressed_images_are_those_of_the_file(tmp_path, name):
    png = cv2.imencode(".png", RGB[..., ::-1])[1].tobytes()
    ((_, image, _),) = images(write_bag(tmp_path / name, {"/cam/compressed": [compressed(png, 1.0, "png")]}))
    assert np.array_equal(image, RGB)


def test_a_topic_must_be_one_of_those_with_images(tmp_path):
    bag = write_bag(tmp_path / "two.bag", {"/left": [raw(RGB, "rgb8", 1.0)], "/right": [raw(RGB, "rgb8", 1.0)] * 2})
    with pytest.raises(ValueError, match=r"several image topics: /left \(1 images\), /right \(2 images\); specify one"):
        ImageBag.open(bag)
    with pytest.raises(ValueError, match=r"no image topic /top; it has /left \(1 images\), /right"):
        ImageBag.open(bag, "/top")
    assert ImageBag.open(bag, "/left").size == (10, 12)


def test_a_topic_without_messages_is_no_choice(tmp_path):
    bag = write_bag(tmp_path / "two", {"/left": [raw(RGB, "rgb8", 1.0)], "/right": []})
    assert ImageBag.open(bag).topic == "/left"
    with pytest.raises(UnreadableImage, match="/right has no messages"):
        ImageBag.open(bag, "/right")


def test_images_that_cannot_be_used_have_reasons(tmp_path):
    image = raw(RGB, "rgb8", 1.0)
    short = (image[0], 2.0, (*image[2][:-1], image[2][-1][:100]))
    messages = [image, short, raw(RGB, "rgb8", 1.0), raw(RGB, "jpeg2000", 3.0), raw(RGB, "rgb8", 0.0)]
    found = images(write_bag(tmp_path / "b.bag", {"/cam": messages}))
    assert [frame[1] is not None for frame in found] == [True, False, False, False, True]
    assert "10x12 pixels in rows of 30 bytes do not fit 100 bytes" in found[1][2]
    assert "its time is not after" in found[2][2]
    assert "'jpeg2000' is not supported" in found[3][2]
    # A header without a time has that of the recording.
    assert found[4][0] == pytest.approx(RECORDED_NS * 1e-9 + 0.4)


def test_damaged_bags_are_refused_with_a_reason(tmp_path):
    bag = write_bag(tmp_path / "b.bag", {"/cam": [raw(RGB, "rgb8", 1.0)]})
    for size in (0, 13, 200, bag.stat().st_size - 40):
        damaged = tmp_path / "damaged.bag"
        damaged.write_bytes(bag.read_bytes()[:size])
        with pytest.raises(UnreadableImage, match=r"damaged.bag: .*repair it \(rosbag reindex"):
            ImageBag.open(damaged)
    folder = write_bag(tmp_path / "b", {"/cam": [raw(RGB, "rgb8", 1.0)]})
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    with pytest.raises(UnreadableImage, match="cannot be read as a ROS bag"):
        ImageBag.open(folder)
    with pytest.raises(UnreadableImage, match="no such file"):
        ImageBag.open(tmp_path / "none.bag")
