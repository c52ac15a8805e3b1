"""Options of written videos; they are those of the commands.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from omnisight.choices import Options

Codec = Literal["h264", "hevc", "av1", "vp9", "prores"]
Preset = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]

# Codecs that players expect in each container; the first is the default.
CONTAINERS: dict[str, tuple[Codec, ...]] = {
    ".mp4": ("h264", "hevc", "av1"),
    ".m4v": ("h264", "hevc"),
    ".mov": ("h264", "hevc", "prores"),
    ".mkv": ("h264", "hevc", "av1", "vp9", "prores"),
    ".webm": ("vp9", "av1"),
}
# Codecs that keep 10 bits; few players decode H.264 of 10 bits.
CODECS_10_BIT = ("hevc", "av1", "prores")


@dataclass(frozen=True, kw_only=True)
class VideoOptions(Options):
    """Options of a written video.

    Attributes
    ----------
    codec
        Video codec: h264 by default, vp9 in .webm files.
    crf
        Quality of a video in the scale of its codec, lower is better: 0 to 51 for h264 (21) and hevc (23), 0 to 63 for
        av1 (30) and vp9 (31). Not for prores.
    preset
        Effort of the encoder: slower presets give smaller files. superfast by default for h264, veryfast for others.
    hardware
        Encode by a hardware encoder of the graphics card.
    sound
        Keep the sound of the clip.
    """

    codec: Codec | None = None
    crf: int | None = None
    preset: Preset | None = None
    hardware: bool = False
    sound: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.codec is not None:
            self._check_quality(self.codec)
        if self.codec == "prores" and self.crf is not None:
            raise ValueError("--codec prores has no --crf: leave it out")

    def codec_of(self, output: Path) -> Codec:
        """Return the codec of an output file.

        Raises
        ------
        ValueError
            If no video can be written in a file of this extension, or not with this codec.
        """
        suffix = output.suffix.lower()
        if suffix not in CONTAINERS:
            raise ValueError(f"{output}: a video is written as {', '.join(CONTAINERS)}")
        codec = self.codec or CONTAINERS[suffix][0]
        if codec not in CONTAINERS[suffix]:
            others = ", ".join(s for s, codecs in CONTAINERS.items() if codec in codecs)
            raise ValueError(f"{output}: {codec} is not written in {suffix} files; use {others}, or another --codec")
        self._check_quality(codec)
        return codec

    def _check_quality(self, codec: Codec) -> None:
        limit = 63 if codec in ("av1", "vp9") else 51
        if self.crf is not None and not 0 <= self.crf <= limit:
            raise ValueError(f"--crf is {self.crf}; choose 0 (best) to {limit}")
