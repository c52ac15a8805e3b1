"""Tags of spheres in photos and clips."""

import shutil
import subprocess

import cv2
import numpy as np
import pytest

from omnisight.images import Clip, decode_image, encode_image
from omnisight.images.gpano import read_gpano, with_gpano
from omnisight.images.spherical_video import with_spherical_boxes

IMAGE = np.arange(64 * 128 * 3, dtype=np.uint32).reshape(64, 128, 3).astype(np.uint8)


def test_gpano_tags_are_read_back_and_keep_the_image():
    plain = encode_image(IMAGE, "a.jpg")
    tagged = with_gpano(plain, (128, 64), heading=-90.0, is_level=True)
    tags = read_gpano(tagged)
    assert tags["ProjectionType"] == "equirectangular"
    assert tags["FullPanoWidthPixels"] == tags["CroppedAreaImageWidthPixels"] == "128"
    assert float(tags["PoseHeadingDegrees"]) == 270.0
    assert tags["PosePitchDegrees"] == "0"
    assert np.array_equal(decode_image(tagged, "a"), decode_image(plain, "a"))
    assert read_gpano(plain) == {}


def test_gpano_tags_need_a_jpeg_file():
    with pytest.raises(ValueError, match="JPEG"):
        with_gpano(encode_image(IMAGE, "a.png"), (128, 64))


def test_a_clip_with_spherical_boxes_decodes_to_the_same_frames(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "a.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25, (128, 64))
    for k in range(5):
        writer.write(np.roll(IMAGE, 9 * k, 1))
    writer.release()
    data = (tmp_path / "a.mp4").read_bytes()
    # The index behind the data, and in front of it: there all offsets move.
    for name, source in (("behind", data), ("front", index_in_front(data))):
        path = tmp_path / f"{name}.mp4"
        path.write_bytes(with_spherical_boxes(source))
        frames = [frame.image for frame in Clip.open(path).frames()]
        expected = [frame.image for frame in Clip.open(tmp_path / "a.mp4").frames()]
        assert len(frames) == len(expected) == 5
        assert all(np.array_equal(a, b) for a, b in zip(frames, expected, strict=True))
        if shutil.which("ffprobe"):
            command = ["ffprobe", "-v", "error", "-show_streams", str(path)]
            assert "equirectangular" in subprocess.run(command, capture_output=True, text=True).stdout


def index_in_front(data):
    """Return an MP4 file with the box moov before mdat."""
    from omnisight.images.spherical_video import _split, _with_offsets

    boxes = dict(_split(data))
    moov = _with_offsets(boxes[b"moov"], len(boxes[b"moov"]), 0)
    rest = b"".join(box for kind, box in boxes.items() if kind not in (b"moov", b"ftyp"))
    return boxes[b"ftyp"] + moov + rest
