"""Tags of spheres in photos and clips."""

import shutil
import subprocess

import cv2
import numpy as np
import pytest

from omnisight.images import Clip, decode_image, encode_image
from omnisight.images.gpano import read_gpano, with_gpano
from omnisight.images.spherical_video import tag_sphere

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


def test_a_clip_tag_sphere_decodes_to_the_same_frames(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "a.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25, (128, 64))
    for k in range(5):
        writer.write(np.roll(IMAGE, 9 * k, 1))
    writer.release()
    path = shutil.copy(tmp_path / "a.mp4", tmp_path / "b.mp4")
    tag_sphere(path)
    frames = [frame.image for frame in Clip.open(path).frames()]
    expected = [frame.image for frame in Clip.open(tmp_path / "a.mp4").frames()]
    assert len(frames) == len(expected) == 5
    assert all(np.array_equal(a, b) for a, b in zip(frames, expected, strict=True))
    if shutil.which("ffprobe"):
        command = ["ffprobe", "-v", "error", "-show_streams", str(path)]
        assert "equirectangular" in subprocess.run(command, capture_output=True, text=True).stdout


def test_a_clip_whose_index_is_in_front_is_not_tagged(tmp_path):
    (tmp_path / "a.mp4").write_bytes(bytes([0, 0, 0, 8]) + b"moov" + bytes([0, 0, 0, 8]) + b"mdat")
    with pytest.raises(ValueError, match="no index at its end"):
        tag_sphere(tmp_path / "a.mp4")
