"""Writing of video files: encoded on a thread, with the sound of a clip, and playable if the program is killed."""

import os
import queue
import threading
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.images.output_paths import check_folder_of, refuse_overwrite
from omnisight.images.planes import Yuv
from omnisight.images.sound import Sound
from omnisight.images.spherical_video import MP4_SUFFIXES, tag_sphere
from omnisight.images.video import Clip, open_container
from omnisight.images.video_encoders import (
    encoded_depth,
    encoder_name,
    encoder_options,
    pixel_format,
    silence_encoders,
)
from omnisight.parallel import thread_count
from omnisight.video_options import Codec, VideoOptions

# Frames that wait for the encoder: more only take memory.
WAITING_FRAMES = 2
# Longest part of a file that is lost if the program is killed, besides the frames in the encoder, s.
FRAGMENT_S = 1
# Fragments until the file is complete (FFmpeg 7.1), and times from 0 on where frames are reordered; microseconds.
MP4_OPTIONS = {
    "movflags": "hybrid_fragmented+negative_cts_offsets",
    "frag_duration": str(FRAGMENT_S * 1_000_000),
}
MATROSKA_OPTIONS = {"cluster_time_limit": str(FRAGMENT_S * 1000)}  # milliseconds
# Without it FFmpeg writes a file in blocks of 256 KiB, up to which a short video is empty.
FLUSH = {"flush_packets": "1"}
# Heights from which frames without a colour space are shown as BT.709 by players, and its numbers in FFmpeg.
HD_HEIGHT, BT709, BT601 = 720, 1, 6
# Tags of a clip that hold for its views, too.
TAGS = "creation_time", "location", "date", "make", "model", "title", "artist", "comment", "copyright"


class VideoWriter:
    """Writes frames to a video file.

    While frames are written, the file is `NAME.partial.mp4`; it is playable at any time, and gets its name at the end.

    Attributes
    ----------
    output
        The file.
    partial
        Name of the file until it is complete.
    depth
        Bits of a channel, 8 or 10, of the frames to write.
    frames
        Number of frames written.
    """

    def __init__(
        self, output: Path, size: tuple[int, int], like: Clip | float, options: VideoOptions, *, is_sphere: bool = False
    ) -> None:
        """Check that the video can be written.

        Parameters
        ----------
        output
            File to write: .mp4, .mov, .mkv, .webm.
        size
            (width, height) of the frames, px; an odd last column or row is not written.
        like
            Clip with the sound, the tags and the time base of the video; or a number of frames per second.
        options
            Codec, quality and sound.
        is_sphere
            Add the metadata of an equirectangular sphere, if the file can hold them.

        Raises
        ------
        ValueError
            If the extension, the codec or its encoder is not available.
        """
        check_video_output(output)
        self.output, self.partial = output, output.with_name(f"{output.stem}.partial{output.suffix}")
        self.size = size[0] // 2 * 2, size[1] // 2 * 2
        self._options = options
        self._codec: Codec = options.codec_of(output)
        self._encoder = encoder_name(output, options)
        self._clip = like if isinstance(like, Clip) else None
        refuse_overwrite([self.partial], [] if self._clip is None else [self._clip.path])
        self._rate = Fraction(like.frame_rate if isinstance(like, Clip) else like).limit_denominator(1001)
        self._time_base = like.time_base if isinstance(like, Clip) else 1 / self._rate
        self._is_mp4 = output.suffix.lower() in MP4_SUFFIXES
        self._is_sphere = is_sphere and self._is_mp4
        self.depth = encoded_depth(self._codec, self._clip)
        self.frames = 0
        self._opened = ExitStack()
        self._container: Any = None
        self._sound: Sound | None = None
        self._last = -1
        self._queue: queue.Queue[tuple[Yuv | NDArray[np.uint8], float] | None] = queue.Queue(WAITING_FRAMES)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="omnisight encoder", daemon=True)

    def write(self, frame: Yuv | NDArray[np.uint8], seconds: float) -> None:
        """Write a frame, planes or RGB (H, W, 3), with its time from the start of the clip."""
        if self._error is not None:
            raise self._error
        self._queue.put((frame, seconds))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._queue.put(None)
        self._thread.join()
        error = error or self._error
        if self.frames == 0:
            self.partial.unlink(missing_ok=True)
        elif error is None:
            if self._is_sphere:
                tag_sphere(self.partial)
            os.replace(self.partial, self.output)
        if error is not None and self.frames:
            error.add_note(f"{self.partial} has the first {self.frames} frames")
        if self._error is not None and kind is None:
            raise self._error

    def _run(self) -> None:
        """Encode frames until None arrives, and close the files; after an error drop the frames."""
        item = self._queue.get()
        try:
            with self._opened:
                while item is not None:
                    self._encode(*item)
                    item = self._queue.get()
                self._finish()
        except BaseException as error:  # raised in the thread of the caller
            self._error = self._explained(error)
            while item is not None:
                item = self._queue.get()

    def _encode(self, image: Yuv | NDArray[np.uint8], seconds: float) -> None:
        frame = image.frame if isinstance(image, Yuv) else self._converted(image)
        if self._container is None:
            self._container = self._open(frame)
        if frame.format.name != self._stream.pix_fmt and not frame.format.name.startswith("yuvj"):
            frame = frame.reformat(format=self._stream.pix_fmt)
        # Time stamps of some files repeat; encoders refuse that.
        self._last = frame.pts = max(round(seconds / self._time_base), self._last + 1)
        frame.time_base, frame.pict_type = self._time_base, 0
        self._container.mux(self._stream.encode(frame))
        self.frames += 1
        if self._sound is not None:
            self._sound.write_until(seconds)

    def _finish(self) -> None:
        if self._container is None:
            return
        self._container.mux(self._stream.encode(None))
        if self._sound is not None:
            self._sound.write_until(float(self._last * self._time_base + 1 / self._rate))
            self._sound.finish()

    def _open(self, frame: Any) -> Any:
        import av

        silence_encoders()
        options = FLUSH | (MP4_OPTIONS if self._is_mp4 else MATROSKA_OPTIONS)
        container: Any = self._opened.enter_context(av.open(str(self.partial), "w", options=options))
        private = encoder_options(self._encoder, self._options, self._codec)
        stream: Any = container.add_stream(self._encoder, rate=self._rate, options=private)
        stream.width, stream.height = self.size
        stream.pix_fmt = pixel_format(self._codec, self.depth)
        stream.time_base = stream.codec_context.time_base = self._time_base
        stream.codec_context.thread_count = thread_count()
        for name in ("color_range", "colorspace", "color_primaries", "color_trc"):
            setattr(stream.codec_context, name, getattr(frame, name))
        if self._codec == "hevc" and self._is_mp4:
            stream.codec_context.codec_tag = "hvc1"  # QuickTime plays no other
        self._stream = stream
        if self._clip is not None:
            clip = self._opened.enter_context(open_container(self._clip.path))
            container.metadata.update({tag: clip.metadata[tag] for tag in TAGS if tag in clip.metadata})
            if self._options.sound:
                self._sound = Sound(clip, container, self.output.suffix.lower())
        return container

    def _converted(self, image: NDArray[np.uint8]) -> Any:
        """Return an RGB image as a frame of luma and chroma."""
        import av

        width, height = self.size
        matrix = BT709 if height >= HD_HEIGHT else BT601
        rgb = av.VideoFrame.from_ndarray(np.ascontiguousarray(image[:height, :width]), "rgb24")
        frame = rgb.reformat(format=pixel_format(self._codec, self.depth), dst_colorspace=matrix, dst_color_range=1)
        frame.colorspace, frame.color_range = matrix, 1
        return frame

    def _explained(self, error: BaseException) -> BaseException:
        """Return the error of FFmpeg as one with the file and the reason."""
        from av.error import FFmpegError

        if isinstance(error, FFmpegError | OSError):
            return OSError(f"{self.output}: cannot be written with {self._encoder}: {error.strerror or error}")
        return error


def check_video_output(output: Path) -> None:
    """Raise before any work if a video cannot be written to a file."""
    if output.is_dir():
        raise ValueError(f"{output}: is a folder; name a file in it, such as {output / 'view.mp4'}")
    check_folder_of(output)
