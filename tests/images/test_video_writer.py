"""Written videos: time stamps, sound, codecs, colours, rotation, and files of programs that were killed."""

import os
import re
import signal
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from omnisight.images import Clip
from omnisight.images.planes import Yuv, rotated
from omnisight.images.video_writer import VideoWriter
from omnisight.video_options import CONTAINERS, VideoOptions

SIZE, RATE, SOUND_RATE = (96, 64), 25, 48_000
FLASH, BEEP_HZ = 30, 3000.0


def gray_frame(level, size=SIZE):
    return np.full((size[1], size[0], 3), level, np.uint8)


@pytest.fixture(scope="module")
def flash(tmp_path_factory):
    """Return a clip that is dark and silent but for frame 30, which flashes and beeps; some frames come late."""
    path = tmp_path_factory.mktemp("clip") / "flash.mp4"
    steps = np.where(np.arange(60) % 7 == 3, 2, 1)
    pts = np.concatenate([[0], np.cumsum(steps)[:-1]])
    with av.open(str(path), "w") as container:
        video = container.add_stream("libx264", rate=RATE, options={"crf": "10", "preset": "ultrafast"})
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        sound = container.add_stream("aac", rate=SOUND_RATE, layout="mono")
        for k in range(60):
            frame = av.VideoFrame.from_ndarray(gray_frame(220 if k == FLASH else 30))
            frame.pts, frame.time_base = int(pts[k]), Fraction(1, RATE)
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        start, end = (int(pts[FLASH + i] / RATE * SOUND_RATE) for i in range(2))
        samples = np.zeros(int(pts[-1] / RATE * SOUND_RATE), np.float32)
        samples[start:end] = 0.5 * np.sin(2 * np.pi * BEEP_HZ * np.arange(end - start) / SOUND_RATE)
        for at in range(0, len(samples), 1024):
            block = av.AudioFrame.from_ndarray(samples[None, at : at + 1024], "fltp", "mono")
            block.sample_rate, block.pts = SOUND_RATE, at
            container.mux(sound.encode(block))
        container.mux(sound.encode(None))
    return path


def copy(source, output, options=VideoOptions(), **more):
    clip = Clip.open(source)
    with VideoWriter(output, clip.size, clip, options, **more) as writer:
        for frame in clip.frames():
            writer.write(frame.yuv(writer.depth), frame.seconds)
    return output


@pytest.mark.parametrize("sound", [True, False])
@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_tags_of_the_clip_are_kept(flash, tmp_path, suffix, sound):
    tags = {"creation_time": "2026-05-04T03:02:01.000000Z", "location": "+47.3000+008.5000/", "title": "A walk"}
    source = tmp_path / "tagged.mov"
    with av.open(str(flash)) as clip, av.open(str(source), "w") as tagged:
        tagged.metadata.update(tags)
        stream = tagged.add_stream_from_template(clip.streams.video[0])
        for packet in clip.demux(clip.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                tagged.mux(packet)
    with av.open(str(copy(source, tmp_path / f"view{suffix}", VideoOptions(sound=sound)))) as written:
        found = {name.lower(): value for name, value in written.metadata.items()}
    assert {name: found[name].removesuffix(".000000Z").removesuffix("Z") for name in tags} == {
        name: value.removesuffix(".000000Z") for name, value in tags.items()
    }


def beep_start(path):
    """Return the time at which the sound begins, seconds from the start of the file."""
    with av.open(str(path)) as container:
        start = (container.start_time or 0) / 1e6
        for frame in container.decode(audio=0):
            samples = frame.to_ndarray().astype(float)
            samples = samples.reshape(-1) / (1.0 if frame.format.name.startswith("flt") else 32768.0)
            loud = np.flatnonzero(np.abs(samples) > 0.1)
            if loud.size:
                return frame.time + loud[0] / frame.sample_rate - start
    raise AssertionError("no sound")


@pytest.mark.parametrize("suffix", CONTAINERS)
def test_time_stamps_and_sound_are_kept_in_every_container(flash, tmp_path, suffix):
    output = copy(flash, tmp_path / f"copy{suffix}")
    before, after = (list(Clip.open(path).frames()) for path in (flash, output))
    assert len(before) == len(after) == 60
    times = [[frame.seconds - frames[0].seconds for frame in frames] for frames in (before, after)]
    assert times[1] == pytest.approx(times[0], abs=1.1e-3)
    bright = [k for k, frame in enumerate(after) if frame.gray.mean() > 120]
    assert bright == [FLASH]
    # Encoders of sound spread a beginning over some milliseconds.
    assert beep_start(output) == pytest.approx(after[FLASH].seconds, abs=0.015)
    assert not list(tmp_path.glob("*.partial*"))


def clip_with_sound(path, layout, codec="pcm_s16le", rate=SOUND_RATE):
    """Write a clip of 10 frames with a tone in all channels of a layout."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("libx264", rate=RATE, options={"preset": "ultrafast"})
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        sound = container.add_stream(codec, rate=rate, layout=layout)
        for k in range(10):
            frame = av.VideoFrame.from_ndarray(gray_frame(30))
            frame.pts, frame.time_base = k, Fraction(1, RATE)
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        tone = 8000 * np.sin(2 * np.pi * BEEP_HZ * np.arange(int(0.4 * rate)) / rate)
        samples = np.repeat(tone.astype(np.int16), sound.layout.nb_channels)[None]
        block = av.AudioFrame.from_ndarray(samples, "s16", layout)
        block.sample_rate, block.pts = rate, 0
        container.mux([*sound.encode(block), *sound.encode(None)])
    return path


@pytest.mark.parametrize(
    ("layout", "codec", "rate", "suffix", "written"),
    [
        ("4 channels", "pcm_s16le", 48_000, ".mp4", "stereo"),
        ("1 channels", "pcm_s16le", 48_000, ".mp4", "mono"),
        ("5.1(side)", "flac", 48_000, ".webm", "stereo"),
        ("5.1", "flac", 48_000, ".webm", "5.1"),
        ("stereo", "flac", 44_100, ".webm", "stereo"),
        ("mono", "pcm_s16le", 192_000, ".mp4", "mono"),
    ],
)
def test_sound_of_any_layout_and_rate_is_kept(tmp_path, layout, codec, rate, suffix, written):
    clip = clip_with_sound(tmp_path / "clip.mkv", layout, codec, rate)
    with av.open(str(copy(clip, tmp_path / f"copy{suffix}"))) as container:
        (stream,) = container.streams.audio
        assert stream.layout.name == written
        to_mono = av.AudioResampler("flt", "mono", SOUND_RATE)
        blocks = [block.to_ndarray() for frame in container.decode(stream) for block in to_mono.resample(frame)]
    samples = np.concatenate(blocks, axis=1)[0]
    assert np.abs(samples[4800:14_400]).max() > 0.1
    spectrum = np.abs(np.fft.rfft(samples[4800:14_400]))
    assert np.argmax(spectrum) * 5 == pytest.approx(BEEP_HZ, abs=5)


def test_sound_whose_layout_and_rate_change_is_kept(tmp_path):
    seconds = 0.192  # 6 blocks of AC3 at 48 kHz, and 4 at 32 kHz
    with av.open(str(tmp_path / "clip.mkv"), "w") as container:
        video = container.add_stream("libx264", rate=RATE, options={"preset": "ultrafast"})
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        sound = container.add_stream("ac3", rate=48_000, layout="mono")
        for k in range(20):
            frame = av.VideoFrame.from_ndarray(gray_frame(30))
            frame.pts, frame.time_base = k, Fraction(1, RATE)
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        for k, (layout, rate) in enumerate([("mono", 48_000), ("stereo", 48_000), ("mono", 32_000), ("5.1", 48_000)]):
            encoder = av.CodecContext.create("ac3", "w")
            encoder.sample_rate, encoder.layout, encoder.format = rate, layout, "fltp"
            tone = 0.5 * np.sin(2 * np.pi * BEEP_HZ * np.arange(round(seconds * rate)) / rate)
            samples = np.tile(tone.astype(np.float32), (encoder.layout.nb_channels, 1))
            block = av.AudioFrame.from_ndarray(samples, "fltp", layout)
            block.sample_rate, block.pts, block.time_base = rate, 0, Fraction(1, rate)
            for packet in [*encoder.encode(block), *encoder.encode(None)]:
                packet.stream = sound
                at = round((packet.pts * packet.time_base + Fraction(seconds) * k) * 48_000)
                packet.pts = packet.dts = max(at, 0)
                packet.time_base = Fraction(1, 48_000)
                container.mux(packet)
    with av.open(str(copy(tmp_path / "clip.mkv", tmp_path / "copy.webm"))) as container:
        (stream,) = container.streams.audio
        blocks = [frame.to_ndarray()[0] for frame in container.decode(stream)]
    samples = np.concatenate(blocks)
    assert len(samples) / 48_000 == pytest.approx(4 * seconds, abs=0.1)
    for k in range(4):
        start = round((k + 0.4) * seconds * 48_000)
        spectrum = np.abs(np.fft.rfft(samples[start : start + 4800]))
        assert np.argmax(spectrum) * 10 == pytest.approx(BEEP_HZ, abs=20)


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="lists open files")
@pytest.mark.parametrize(
    ("encoder", "message"), [("aac", "cannot be converted to stereo"), ("libopus", "cannot encode")]
)
def test_sound_that_cannot_be_written_is_reported_and_no_file_remains_open(tmp_path, monkeypatch, encoder, message):
    clip = clip_with_sound(tmp_path / "clip.mkv", "9 channels", rate=44_100)
    monkeypatch.setattr("omnisight.images.sound.DEFAULT_ENCODER", encoder)
    if encoder == "libopus":
        monkeypatch.setattr("omnisight.images.sound.COMMON_RATE", 1)
    # The traceback of the error keeps objects that were not closed.
    with pytest.raises(ValueError, match=r"^clip\.mkv: .*of 9 channels, 44100 Hz.*--no-sound") as raised:
        copy(clip, tmp_path / "copy.mp4")
    opened = [os.readlink(link) for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
    assert opened
    assert not [path for path in opened if path.startswith(str(tmp_path))]
    assert message in str(raised.value)
    assert not (tmp_path / "copy.mp4").exists()


def test_sound_can_be_left_out(flash, tmp_path):
    with av.open(str(copy(flash, tmp_path / "silent.mp4", VideoOptions(sound=False)))) as container:
        assert not container.streams.audio


@pytest.mark.parametrize(("suffix", "codec"), [(".mp4", "hevc"), (".mp4", "av1"), (".mov", "prores"), (".mkv", "vp9")])
def test_codecs_give_the_same_images(flash, tmp_path, suffix, codec):
    output = copy(flash, tmp_path / f"copy{suffix}", VideoOptions(codec=codec))
    with av.open(str(output)) as container:
        assert container.streams.video[0].codec_context.codec.canonical_name == codec
    frame = next(iter(Clip.open(output).frames([FLASH])))
    assert frame.image.mean() == pytest.approx(220, abs=4)


def test_a_lower_crf_gives_a_larger_file(tmp_path):
    rng = np.random.default_rng(0)
    sizes = []
    for crf in (10, 40):
        with VideoWriter(tmp_path / f"{crf}.mp4", SIZE, 30.0, VideoOptions(crf=crf)) as writer:
            for k in range(5):
                writer.write(rng.integers(0, 255, (64, 96, 3)).astype(np.uint8), k / 30)
        sizes.append((tmp_path / f"{crf}.mp4").stat().st_size)
    assert sizes[0] > 2 * sizes[1]


@pytest.mark.parametrize(
    ("options", "settings"),
    [
        (VideoOptions(), (b"crf=21.0", b"subme=1", b"mbtree=1", b"rc_lookahead=40")),
        (VideoOptions(preset="ultrafast", crf=30), (b"crf=30.0", b"subme=0", b"mbtree=0")),
        (VideoOptions(preset="veryfast"), (b"crf=21.0", b"subme=2", b"mbtree=1", b"rc_lookahead=10")),
    ],
)
def test_x264_records_the_settings_of_a_preset(tmp_path, options, settings):
    with VideoWriter(tmp_path / "a.mp4", SIZE, 30.0, options) as writer:
        writer.write(gray_frame(100, SIZE), 0.0)
    data = (tmp_path / "a.mp4").read_bytes()
    assert [setting for setting in settings if setting not in data] == []


def test_odd_sizes_lose_their_last_row_and_column(tmp_path):
    with VideoWriter(tmp_path / "odd.mp4", (97, 65), 30.0, VideoOptions()) as writer:
        writer.write(gray_frame(100, (97, 65)), 0.0)
    assert Clip.open(tmp_path / "odd.mp4").size == SIZE


def test_ten_bits_are_kept_by_hevc_and_reduced_by_h264(flash, tmp_path):
    deep = copy(flash, tmp_path / "deep.mov", VideoOptions(codec="prores"))
    assert Clip.open(deep).bits == 10
    for codec, bits in (("hevc", 10), ("h264", 8)):
        assert Clip.open(copy(deep, tmp_path / f"{codec}.mp4", VideoOptions(codec=codec))).bits == bits


def test_planes_are_rotated_clockwise():
    rgb = np.zeros((64, 96, 3), np.uint8)
    rgb[:32, :48] = 255
    yuv = Yuv.of(av.VideoFrame.from_ndarray(rgb), 8)
    for degrees in (90, 180, 270):
        turned = rotated(yuv, degrees).frame.to_ndarray(format="rgb24")
        assert np.abs(turned.astype(int) - np.rot90(rgb, -degrees // 90)).mean() < 2


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.avi", VideoOptions(), "a.avi: a video is written as .mp4"),
        ("a.webm", VideoOptions(codec="h264"), "h264 is not written in .webm files; use .mp4"),
        ("none/a.mp4", VideoOptions(), "there is no folder"),
        ("a.mp4", VideoOptions(codec="hevc", hardware=True), "no hardware encoder for hevc works on this machine"),
    ],
)
def test_an_unusable_output_is_refused_before_any_work(tmp_path, monkeypatch, name, options, message):
    monkeypatch.setattr("omnisight.images.video_encoders.HARDWARE", ("nosuch",))
    with pytest.raises(ValueError, match=re.escape(message)):
        VideoWriter(tmp_path / name, SIZE, 30.0, options)
    assert not list(tmp_path.iterdir())


def test_an_error_leaves_the_old_file_and_reports_itself(flash, tmp_path):
    output = tmp_path / "old.mp4"
    output.write_bytes(b"old")
    writer = VideoWriter(output, SIZE, 30.0, VideoOptions())
    writer.__enter__().write(gray_frame(0), 0.0)
    writer.__exit__(ZeroDivisionError, ZeroDivisionError(), None)
    assert output.read_bytes() == b"old"
    with pytest.raises(TypeError), VideoWriter(output, SIZE, 30.0, VideoOptions()) as writer:
        writer.write("no image", 0.0)
    assert output.read_bytes() == b"old"


KILLED = """
import sys, time
from pathlib import Path
import numpy as np
from omnisight.images.video_writer import VideoWriter
from omnisight.video_options import VideoOptions
with VideoWriter(Path(sys.argv[1]), (96, 64), 25.0, VideoOptions(preset="ultrafast")) as writer:
    for k in range(200):
        writer.write(np.full((64, 96, 3), k, np.uint8), k / 25)
    while writer.frames < 200:
        time.sleep(0.01)
    print("written", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("extension", ["mp4", "mov", "mkv", "webm"])
def test_the_file_of_a_killed_program_is_playable(tmp_path, extension):
    output, partial = tmp_path / f"long.{extension}", tmp_path / f"long.partial.{extension}"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", KILLED, str(output)], env=os.environ, **pipes) as process:
        assert process.stdout.readline() == "written\n"
        process.send_signal(signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    assert not output.exists()
    assert sum(1 for _ in Clip.open(partial).frames()) > 100  # the encoder has some frames, and the last second is lost
