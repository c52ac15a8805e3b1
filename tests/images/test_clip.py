"""A clip is read without the search of FFmpeg for its pixel format: nothing of it differs from a full search."""

from fractions import Fraction

import av
import numpy as np
import pytest

from omnisight.images import Clip

# With reordered frames, whose times some containers do not store; of 8 and 10 bits.
ENCODERS = {
    "mp4": ("libx264", "yuv420p"),
    "mkv": ("libx264", "yuv420p10le"),
    "avi": ("libx264", "yuv420p"),
    "mov": ("mpeg4", "yuv420p"),
    "webm": ("libvpx-vp9", "yuv420p"),
}


@pytest.fixture(params=ENCODERS)
def path(request, tmp_path):
    encoder, pixel_format = ENCODERS[request.param]
    path = tmp_path / f"clip.{request.param}"
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(encoder, rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, pixel_format
        stream.codec_context.max_b_frames = 2 if encoder != "libvpx-vp9" else 0
        texture = rng.integers(0, 255, (8, 40, 3), np.uint8).repeat(8, 0).repeat(8, 1)
        for k in range(24):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(texture[:, 4 * k : 4 * k + 96]), "rgb24")
            frame.pts, frame.time_base = k, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def test_header_and_frames_equal_those_of_a_full_search(path):
    clip = Clip.open(path)
    with av.open(str(path)) as container:
        (stream,) = container.streams.video
        context = stream.codec_context
        assert clip.size == (context.width, context.height)
        assert clip.frame_rate == float(stream.average_rate)
        assert clip.bits == max(component.bits for component in context.format.components)
        start = (container.start_time or 0) / av.time_base
        expected = list(container.decode(stream))
    frames = list(clip.frames())
    assert len(frames) == len(expected) == 24
    for frame, other in zip(frames, expected, strict=True):
        assert frame.seconds == other.time - start
        assert (frame.image == other.to_ndarray(format="rgb24")).all()
