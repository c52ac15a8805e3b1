"""The sound of a clip, copied to another file beside its new images."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

from omnisight.images.video import CONTAINER_UNITS, video_input

# Sound codecs that each container holds; MKV holds all. Others are encoded anew.
COPIED = {
    ".mp4": ("aac", "mp3", "ac3", "eac3", "opus", "alac", "flac"),
    ".m4v": ("aac", "ac3", "alac"),
    ".mov": ("aac", "mp3", "ac3", "alac", "pcm_s16le", "pcm_s16be", "pcm_s24le", "pcm_s24be", "pcm_s32le"),
    ".webm": ("opus", "vorbis"),
}
ENCODERS = {".webm": "libopus"}
DEFAULT_ENCODER = "aac"
# libopus accepts few sampling rates, and this one of all.
OPUS_RATE = 48_000


class Sound:
    """Sound tracks of a clip that are written to a container, as far as the images are.

    Attributes
    ----------
    tracks
        Number of tracks.
    """

    def __init__(self, path: Path, output: Any, suffix: str) -> None:
        """Add the tracks to an output container whose header is not yet written."""
        self._output, self._resamplers = output, dict[int, Any]()
        self._targets = dict[int, Any]()
        self._input = video_input(path)
        container, _ = self._input.__enter__()
        self._start = (container.start_time or 0) / CONTAINER_UNITS
        for stream in container.streams.audio:
            if stream.codec_context is None:  # of an unknown codec
                continue
            if suffix not in COPIED or stream.codec_context.codec.canonical_name in COPIED[suffix]:
                self._targets[stream.index] = output.add_stream_from_template(stream)
            else:
                self._targets[stream.index] = self._encoder(stream, suffix)
        self._packets = self._read(container)
        self._next: tuple[float, list[Any]] | None = None

    @property
    def tracks(self) -> int:
        return len(self._targets)

    def write_until(self, seconds: float) -> None:
        """Write the sound before a time."""
        while True:
            self._next = self._next or next(self._packets, None)
            if self._next is None or self._next[0] >= seconds:
                return
            for packet in self._next[1]:
                self._output.mux(packet)
            self._next = None

    def close(self) -> None:
        """Finish encoded tracks and close the clip."""
        for index, resampler in self._resamplers.items():
            target = self._targets[index]
            for frame in resampler.resample(None):
                self._output.mux(target.encode(frame))
            self._output.mux(target.encode(None))
        self._input.__exit__(None, None, None)

    def _read(self, container: Any) -> Generator[tuple[float, list[Any]]]:
        """Return the time and the packets to write of each packet of the clip."""
        from av.error import FFmpegError

        streams = [stream for stream in container.streams.audio if stream.index in self._targets]
        try:
            for packet in container.demux(streams) if streams else ():
                if packet.pts is None or packet.time_base is None:
                    continue
                offset = round(self._start / packet.time_base)
                packet.pts -= offset
                packet.dts = packet.pts if packet.dts is None else packet.dts - offset
                if packet.pts < 0:  # priming samples before the first image
                    continue
                seconds = float(packet.pts * packet.time_base)
                index = packet.stream.index
                if index in self._resamplers:
                    yield seconds, self._encoded(packet, index)
                else:
                    packet.stream = self._targets[index]
                    yield seconds, [packet]
        except (FFmpegError, OSError):  # the rest of the file is damaged
            return

    def _encoder(self, stream: Any, suffix: str) -> Any:
        import av

        name = ENCODERS.get(suffix, DEFAULT_ENCODER)
        rate = OPUS_RATE if name == "libopus" else stream.rate
        target = self._output.add_stream(name, rate=rate, layout=stream.layout.name)
        target.codec_context.open()
        self._resamplers[stream.index] = av.AudioResampler(
            target.format, target.layout, rate, frame_size=target.codec_context.frame_size or None
        )
        return target

    def _encoded(self, packet: Any, index: int) -> list[Any]:
        from av.error import FFmpegError

        try:
            frames = [out for frame in packet.decode() for out in self._resamplers[index].resample(frame)]
        except FFmpegError:
            return []
        return [encoded for frame in frames for encoded in self._targets[index].encode(frame)]
