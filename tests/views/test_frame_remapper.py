"""Remapping of frames as planes, against the remap of RGB images."""

import av
import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.images.planes import Yuv
from omnisight.views.frame_remapper import FrameRemapper

FISHEYE = om.Camera(om.fisheye(400, 190.0).model, (400, 400))


def image(size=(400, 400), seed=0):
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 255, (size[1] // 16, size[0] // 16, 3), np.uint8)
    return np.clip(cv2.resize(small, size, interpolation=cv2.INTER_CUBIC), 16, 240)


def yuv_of(rgb, depth=8):
    return Yuv.of(av.VideoFrame.from_ndarray(rgb, "rgb24"), depth)


@pytest.mark.parametrize("interpolation", ["nearest", "bilinear", "bicubic", "lanczos"])
@pytest.mark.parametrize("depth", [8, 10])
@pytest.mark.parametrize("view", [om.perspective((480, 270), 90), om.perspective((96, 64), 120), om.sphere(256)])
def test_the_luma_of_a_view_is_that_of_a_gray_image(interpolation, depth, view):
    rotation = om.look(25, -10, 5)
    yuv = yuv_of(image(), depth)
    luma = np.ascontiguousarray(yuv.planes[0][:, :400]).astype(np.float32)
    remapper = FrameRemapper(FISHEYE, view, rotation, interpolation=interpolation)
    found = remapper(yuv).planes[0][: view.height, : view.width].astype(float)
    # Where the view is smaller, pixels are averaged bilinearly for every kernel but the nearest pixel.
    kernel = "bilinear" if view.width < 480 and interpolation != "nearest" else interpolation
    expected = om.remap(luma, FISHEYE, view, rotation, interpolation=kernel)
    inside = cv2.erode(remapper.mask.astype(np.uint8), np.ones((7, 7))) > 0
    assert inside.mean() > 0.2
    error = (found - expected)[inside] / 2 ** (depth - 8)
    assert np.abs(error).mean() < (1.0 if interpolation != "nearest" else 3.0)
    assert abs(error.mean()) < 0.3
    outside = cv2.dilate(remapper.mask.astype(np.uint8), np.ones((3, 3))) == 0
    assert (found[outside] == 16 * 2 ** (depth - 8)).all()


def test_chroma_is_where_the_luma_is():
    """Luma and chroma of one ramp, sampled where H.264 has them, give views of one ramp."""
    yuv = Yuv.empty((400, 400), yuv_of(image()))
    x, y = np.meshgrid(np.arange(400), np.arange(400))
    ramp = 20 + 0.3 * x + 0.2 * y
    at_chroma = 20 + 0.3 * x[::2, ::2] + 0.2 * (y[::2, ::2] + 0.5)
    for k, plane in enumerate(yuv.planes):
        values = np.rint(at_chroma if k else ramp)
        plane[: len(values), : len(values)] = values
    luma, first, second = FrameRemapper(FISHEYE, om.perspective((320, 240), 60), om.look(10, 5, 40))(yuv).planes
    expected = 0.5 * (luma[:240:2, :320:2].astype(float) + luma[1:240:2, :320:2])
    for plane in (first, second):
        error = plane[:120, :160] - expected
        assert abs(error.mean()) < 0.1
        assert np.abs(error).max() <= 1.5


def test_chroma_is_continuous_across_the_seam():
    """A ramp of longitude that is equal on both sides of the seam has no samples of the opposite side."""
    yuv = Yuv.empty((512, 256), yuv_of(image()))
    for plane in yuv.planes[1:]:
        plane[:128, :256] = np.abs(np.arange(256) - 128)  # 128 at the seam
    view, rotation = om.perspective((320, 240), 60), om.look(180, 0, 20)
    chroma = FrameRemapper(om.sphere(512), view, rotation)(yuv).planes[1][:120, :160].astype(float)
    bearings, _ = view.unproject(np.stack(np.meshgrid(np.arange(0, 320, 2), np.arange(0, 240, 2) + 0.5), -1))
    pixels, _ = om.sphere(512).project((bearings @ rotation).reshape(-1, 3))
    expected = np.abs(0.5 * pixels[:, 0].reshape(120, 160) - 128)
    assert np.abs(chroma - expected).max() < 2


def test_frames_of_full_range_have_a_black_of_zero():
    yuv = yuv_of(image())
    yuv.frame.color_range = 2
    full = Yuv.of(yuv.frame, 8)
    view = FrameRemapper(FISHEYE, om.perspective((64, 48), 20), om.look(180))(full)
    assert view.frame.color_range == 2
    assert not view.planes[0][:48, :64].any()
