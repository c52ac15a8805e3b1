"""The sound of a clip, copied to another file beside its new images."""

from collections.abc import Generator, Sequence
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Any

from omnisight.images.video import CONTAINER_UNITS

# Sound codecs that each container holds; MKV holds all. Others are encoded anew.
COPIED = {
    ".mp4": ("aac", "mp3", "ac3", "eac3", "opus", "alac", "flac"),
    ".m4v": ("aac", "ac3", "alac"),
    ".mov": ("aac", "mp3", "ac3", "alac", "pcm_s16le", "pcm_s16be", "pcm_s24le", "pcm_s24be", "pcm_s32le"),
    ".webm": ("opus", "vorbis"),
}
ENCODERS = {".webm": "libopus"}
DEFAULT_ENCODER = "aac"
# A sampling rate that all of these encoders accept.
COMMON_RATE = 48_000
WITHOUT_SOUND = "write the video without it (--no-sound)"


class Sound:
    """Sound tracks of a clip that are written to a container, as far as the images are.

    Attributes
    ----------
    tracks
        Number of tracks.
    """

    def __init__(self, clip: Any, output: Any, suffix: str) -> None:
        """Add the tracks of an opened clip to an output container whose header is not yet written.

        Raises
        ------
        ValueError
            If a track can neither be copied nor encoded.
        """
        self._output, self._encoded_tracks = output, dict[int, _EncodedTrack]()
        self._targets = dict[int, Any]()
        self._name = Path(clip.name).name
        self._start = (clip.start_time or 0) / CONTAINER_UNITS
        for stream in clip.streams.audio:
            if stream.codec_context is None:  # of an unknown codec
                continue
            if suffix not in COPIED or stream.codec_context.codec.canonical_name in COPIED[suffix]:
                self._targets[stream.index] = output.add_stream_from_template(stream)
            else:
                self._targets[stream.index] = target = self._encoder(stream, suffix)
                self._encoded_tracks[stream.index] = _EncodedTrack(target, self._name)
        self._packets = self._read(clip)
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

    def finish(self) -> None:
        """Write what the encoders still hold."""
        for track in self._encoded_tracks.values():
            self._output.mux(track.finish())

    def _read(self, clip: Any) -> Generator[tuple[float, list[Any]]]:
        """Return the time and the packets to write of each packet of the clip."""
        streams = [stream for stream in clip.streams.audio if stream.index in self._targets]
        for packet in _packets(clip, streams) if streams else ():
            if packet.pts is None or packet.time_base is None:
                continue
            offset = round(self._start / packet.time_base)
            packet.pts -= offset
            packet.dts = packet.pts if packet.dts is None else packet.dts - offset
            if packet.pts < 0:  # priming samples before the first image
                continue
            seconds = float(packet.pts * packet.time_base)
            index = packet.stream.index
            if index in self._encoded_tracks:
                yield seconds, self._encoded_tracks[index].encode(packet)
            else:
                packet.stream = self._targets[index]
                yield seconds, [packet]

    def _encoder(self, stream: Any, suffix: str) -> Any:
        """Return an encoded track of the output."""
        name = ENCODERS.get(suffix, DEFAULT_ENCODER)
        layout, rate = _accepted_settings(name, stream)
        target = self._output.add_stream(name, rate=rate, layout=layout)
        target.codec_context.open()
        return target


class _EncodedTrack:
    """A track that is encoded anew; the layout and the sampling rate of its clip may change.

    A converter of each layout and rate is followed by one that divides the samples into blocks of the encoder.
    """

    def __init__(self, target: Any, name: str) -> None:
        import av

        self._target, self._name = target, name
        self._converter: Any = None
        self._converted: Any = None
        self._blocks = av.AudioResampler(
            target.format, target.layout, target.rate, frame_size=target.codec_context.frame_size or None
        )

    def encode(self, packet: Any) -> list[Any]:
        """Return the packets to write for a packet of the clip; none for a damaged one."""
        from av.error import FFmpegError

        try:
            decoded = packet.decode()
        except FFmpegError:  # a damaged packet
            return []
        return [encoded for frame in decoded for encoded in self._encoded(self._convert(frame))]

    def finish(self) -> list[Any]:
        """Return the packets that converters and encoder still hold."""
        remaining = [] if self._converter is None else self._converter.resample(None)
        return [*self._encoded([*remaining, None]), *self._target.encode(None)]

    def _encoded(self, converted: Sequence[Any]) -> list[Any]:
        """Return the packets of converted frames; None is the end."""
        blocks = [block for frame in converted for block in self._blocks.resample(self._timed(frame))]
        return [packet for block in blocks for packet in self._target.encode(block)]

    def _timed(self, frame: Any) -> Any:
        """Return a frame whose time is in samples: the unit of a converter depends on the frames it takes."""
        if frame is not None and frame.pts is not None and frame.time_base is not None:
            frame.pts = round(frame.pts * frame.time_base * self._target.rate)
            frame.time_base = Fraction(1, self._target.rate)
        return frame

    def _convert(self, frame: Any) -> list[Any]:
        """Return the frames in the layout and at the rate of the encoder, after a decoded one."""
        import av
        from av.error import FFmpegError

        target, given = self._target, (frame.format.name, frame.layout.name, frame.sample_rate)
        before = list[Any]()
        try:
            if given != self._converted:
                before = [] if self._converter is None else self._converter.resample(None)
                self._converter = av.AudioResampler(target.format, target.layout, target.rate)
                self._converted = given
            return [*before, *self._converter.resample(frame)]
        except FFmpegError as error:
            raise ValueError(
                f"{self._name}: the sound of {frame.layout.name}, {frame.sample_rate} Hz cannot be converted to"
                f" {target.layout.name}, {target.rate} Hz ({error}): {WITHOUT_SOUND}"
            ) from None


def _accepted_settings(name: str, stream: Any) -> tuple[str, int]:
    """Return the layout and the sampling rate of a track, replaced by common ones where an encoder refuses them."""
    import av
    from av.error import FFmpegError

    common = "mono" if stream.layout.nb_channels == 1 else "stereo"
    for layout, rate in product((stream.layout.name, common), (stream.rate, COMMON_RATE)):
        trial: Any = av.CodecContext.create(name, "w")
        trial.layout, trial.sample_rate, trial.format = layout, rate, trial.codec.audio_formats[0]
        try:
            trial.open()
        except FFmpegError:
            continue
        return layout, rate
    raise ValueError(
        f"{Path(stream.container.name).name}: {name} cannot encode the sound of {stream.layout.name}, {stream.rate} Hz:"
        f" {WITHOUT_SOUND}"
    )


def _packets(clip: Any, streams: Sequence[Any]) -> Generator[Any]:
    """Yield the packets of streams up to where the file is damaged."""
    from av.error import FFmpegError

    try:
        yield from clip.demux(streams)
    except (FFmpegError, OSError):
        return
