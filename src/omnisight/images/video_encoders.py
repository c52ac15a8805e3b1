"""Video encoders of FFmpeg, in software and hardware, and their settings."""

import os
from fractions import Fraction
from pathlib import Path
from typing import Any

from omnisight.images.planes import FORMATS
from omnisight.images.video import Clip
from omnisight.video_options import CODECS_10_BIT, Codec, Preset, VideoOptions

SOFTWARE: dict[Codec, str] = {
    "h264": "libx264",
    "hevc": "libx265",
    "av1": "libsvtav1",
    "vp9": "libvpx-vp9",
    "prores": "prores_ks",
}
# Suffixes of the hardware encoders of FFmpeg: NVIDIA, Intel, Apple, AMD, and the Video Acceleration API of Linux.
HARDWARE = ("nvenc", "qsv", "videotoolbox", "amf", "vaapi")
DEFAULT_CRF = {"h264": 21, "hevc": 23, "av1": 30, "vp9": 31}
DEFAULT_PRESET: dict[Codec, Preset] = {
    "h264": "superfast",
    "hevc": "veryfast",
    "av1": "veryfast",
    "vp9": "veryfast",
    "prores": "veryfast",
}
# x264's macroblock tree with its default lookahead, which its preset `superfast` omits: files of 0.76 times the size
# at a higher SSIM, in the same time (`python -m benchmarks video`).
MACROBLOCK_TREE = {"mbtree": "1", "rc-lookahead": "40"}
# Presets of SVT-AV1 and speeds of libvpx for the names of x264.
SVT_PRESETS = {
    "ultrafast": 12,
    "superfast": 11,
    "veryfast": 10,
    "faster": 9,
    "fast": 8,
    "medium": 7,
    "slow": 5,
    "slower": 4,
    "veryslow": 2,
}
VPX_SPEEDS = {
    "ultrafast": 8,
    "superfast": 8,
    "veryfast": 7,
    "faster": 6,
    "fast": 5,
    "medium": 4,
    "slow": 2,
    "slower": 1,
    "veryslow": 0,
}
# A frame size that every hardware encoder accepts.
TRIAL_SIZE = 640, 480


def encoder_name(output: Path, options: VideoOptions) -> str:
    """Return the encoder of FFmpeg for an output file.

    Raises
    ------
    ValueError
        If the file cannot hold the codec, or no hardware encoder works.
    """
    codec = options.codec_of(output)
    if not options.hardware:
        return SOFTWARE[codec]
    failures: list[str] = []
    for suffix in HARDWARE:
        reason = _failure(f"{codec}_{suffix}", options, codec)
        if reason is None:
            return f"{codec}_{suffix}"
        failures.append(f"{codec}_{suffix}: {reason}")
    raise ValueError(
        f"no hardware encoder for {codec} works on this machine ({'; '.join(failures)}). Leave out --hardware to encode"
        " on the processor"
    )


def encoder_options(name: str, options: VideoOptions, codec: Codec) -> dict[str, str]:
    """Return the private options of an encoder for a quality and preset."""
    crf = str(DEFAULT_CRF.get(codec, 0) if options.crf is None else options.crf)
    preset = options.preset or DEFAULT_PRESET[codec]
    match name:
        case "libx264":
            return {"preset": preset, "crf": crf, **(MACROBLOCK_TREE if preset == "superfast" else {})}
        case "libx265":
            return {"preset": preset, "crf": crf, "x265-params": "log-level=none"}
        case "libsvtav1":
            return {"preset": str(SVT_PRESETS[preset]), "crf": crf}
        case "libvpx-vp9":
            return {"cpu-used": str(VPX_SPEEDS[preset]), "deadline": "realtime", "crf": crf, "row-mt": "1"}
        case "prores_ks":
            return {"profile": "3"}
        case _ if name.endswith("nvenc"):
            return {"rc": "vbr", "cq": crf, "b": "0"}
        case _ if name.endswith("videotoolbox"):
            return {"q": str(max(1, 100 - 2 * int(crf)))}
        case _ if name.endswith("amf"):
            return {"rc": "cqp", "qp_i": crf, "qp_p": crf}
        case _:
            return {"global_quality": crf}


def pixel_format(codec: Codec, depth: int) -> str:
    """Return the pixel format that is encoded."""
    return "yuv422p10le" if codec == "prores" else FORMATS[depth]


def encoded_depth(codec: Codec, clip: Clip | None) -> int:
    """Return the bits of a channel, 8 or 10, in which a clip, or images of 8 bits, are written."""
    return 10 if codec == "prores" or (codec in CODECS_10_BIT and clip is not None and clip.bits > 8) else 8


def silence_encoders() -> None:
    """Suppress the messages of SVT-AV1, which it prints to the terminal."""
    os.environ.setdefault("SVT_LOG", "1")


def _failure(name: str, options: VideoOptions, codec: Codec) -> str | None:
    """Return why an encoder does not work, or None."""
    import av
    from av.codec.codec import UnknownCodecError
    from av.error import FFmpegError

    try:
        context: Any = av.CodecContext.create(name, "w")
        context.width, context.height = TRIAL_SIZE
        context.pix_fmt = "yuv420p"
        context.time_base = Fraction(1, 30)
        context.options = encoder_options(name, options, codec)
        context.open()
    except UnknownCodecError:
        return "not part of this FFmpeg"
    except (FFmpegError, OSError, ValueError) as error:
        return getattr(error, "strerror", None) or str(error)
    return None
