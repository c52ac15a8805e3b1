"""The frames of a stitch and their files: photos with GPano tags, folders of them, and clips with sphere metadata."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.images import IMAGE_SUFFIXES, write_bytes
from omnisight.images.output_paths import check_folder_of, check_output_folder, refuse_overwrite
from omnisight.images.planes import Yuv
from omnisight.images.spherical_video import MP4_SUFFIXES
from omnisight.images.video_encoders import encoded_depth
from omnisight.images.video_writer import VideoWriter
from omnisight.images.view_tags import read_view_tags
from omnisight.images.write import WRITABLE_EXTENSIONS
from omnisight.pipeline.stitching.stitch_inputs import Bytes, HeadFrames
from omnisight.pipeline.stitching.stitch_options import StitchOptions
from omnisight.pipeline.views.view_encoding import encode_view
from omnisight.progress import Progress
from omnisight.video_options import CONTAINERS, VideoOptions
from omnisight.views.image_size import check_size
from omnisight.views.stitching.frame_stitcher import FrameStitcher
from omnisight.views.stitching.image_stitcher import ImageStitcher
from omnisight.views.stitching.seam_plan import SeamPlan, plan_stitch


@dataclass(frozen=True, eq=False)
class StitchJob:
    """Frames to stitch.

    Attributes
    ----------
    frames
        The frames.
    plan
        The plan of the first frame.
    camera
        Equirectangular camera of the spheres.
    bearings
        (H, W, 3) directions of the sphere in the rig frame.
    is_level
        Whether the horizon is level.
    options, video
        Options of the command.
    target
        File or folder to write; None to write nothing.
    """

    frames: HeadFrames
    plan: SeamPlan
    camera: Camera
    bearings: NDArray[np.float32]
    is_level: bool
    options: StitchOptions
    target: Path | None
    video: VideoOptions

    def needs_plan(self, count: int) -> bool:
        """Return whether the seam is estimated again for a frame."""
        return bool(self.options.every and count and count % self.options.every == 0)

    def new_plan(self, images: Sequence[Bytes]) -> SeamPlan:
        """Return a plan from the images of a frame."""
        return plan_stitch(self.plan.samplers_before_warp, images, self.bearings.shape[1], warp=self.options.warp)


@dataclass(frozen=True, eq=False)
class StitchedFrames:
    """Stitched frames: the first one, pixels that a camera shows (H, W), the number of frames and their files."""

    first: Bytes
    covered: NDArray[np.bool_]
    count: int
    files: tuple[Path, ...]


def stitch_images(job: StitchJob, progress: Progress) -> StitchedFrames:
    """Stitch and write frames of images."""
    stitcher, first, files = ImageStitcher(job.plan, job.bearings), np.zeros((0, 0, 3), np.uint8), list[Path]()
    for count, images in enumerate(job.frames):
        check_sizes(images, job.plan, job.frames.sources[count])
        if job.needs_plan(count):
            stitcher = ImageStitcher(job.new_plan(images), job.bearings)
        sphere = stitcher(images)
        first = sphere if count == 0 else first
        files += _write_image(job, sphere, count)
        progress("stitch", count + 1, job.frames.count)
    return StitchedFrames(first, stitcher.covered, job.frames.count, tuple(files))


def stitch_clip(job: StitchJob, progress: Progress) -> StitchedFrames:
    """Stitch and write the frames of clips; they are decoded, stitched and encoded at the same time.

    Raises
    ------
    ValueError
        If the clips have no common frame.
    """
    stitcher, first, count = FrameStitcher(job.plan, job.bearings), None, 0
    clip, cameras = job.frames.clips[0], len(job.plan.samplers)
    depth = 8 if job.target is None else encoded_depth(job.video.codec_of(job.target), clip)
    with ExitStack() as stack:
        writer = None
        if job.target is not None:
            size = job.bearings.shape[1], job.bearings.shape[0]
            writer = stack.enter_context(VideoWriter(job.target, size, clip, job.video, is_sphere=True))
        for together in stack.enter_context(closing(job.frames.clip_frames())):
            if job.needs_plan(count):
                stitcher = FrameStitcher(job.new_plan(job.frames.images(together)), job.bearings)
            sphere = stitcher(_of_cameras([frame.yuv(depth) for frame in together], cameras))
            first = sphere if first is None else first
            if writer is not None:
                writer.write(sphere, together[0].seconds)
            count += 1
            progress("stitch", count, max(job.frames.count, count))
    if first is None:
        raise ValueError("the clips have no common frame: specify clips that were recorded at the same time")
    files = () if job.target is None else (job.target,)
    return StitchedFrames(first.frame.to_ndarray(format="rgb24"), stitcher.covered, count, files)


def _of_cameras(frames: list[Yuv], cameras: int) -> list[Yuv]:
    """Return the frame of each camera; one with the circles of all cameras is that of each."""
    return frames * cameras if len(frames) < cameras else frames


def _write_image(job: StitchJob, sphere: Bytes, index: int) -> list[Path]:
    """Write the sphere (H, W, 3) of a frame with the tags of its first image, and return its file."""
    if job.target is None:
        return []
    path = _image_files(job.target, job.frames)[index]
    path.parent.mkdir(parents=True, exist_ok=True)
    source = job.frames.sources[index][0]
    tags = b"" if isinstance(source, np.ndarray) else read_view_tags(Path(source))
    heading = job.options.heading
    write_bytes(path, encode_view(sphere, path.name, job.camera, tags, heading=heading, is_level=job.is_level))
    return [path]


def _image_files(target: Path, frames: HeadFrames) -> list[Path]:
    """Return the file of the sphere of each frame."""
    return [target / f"{label}.jpg" for label in frames.labels] if len(frames.sources) > 1 else [target]


def check_sizes(images: Sequence[Bytes], plan: SeamPlan, names: Sequence[object]) -> None:
    """Raise `ValueError` if the image of a camera has not its size; one file can have the images of all cameras."""
    for k, (image, sampler) in enumerate(zip(images, plan.samplers, strict=True)):
        name = names[min(k, len(names) - 1)]
        check_size((image.shape[1], image.shape[0]), sampler.camera.size, name)


def check_suffix(target: Path) -> None:
    """Raise before any input is read if nothing is written with the extension of an output."""
    suffix = target.suffix.lower()
    if suffix and suffix not in (*WRITABLE_EXTENSIONS, *CONTAINERS) and not target.is_dir():
        raise ValueError(f"{target}: cannot write {suffix} files; specify an image, a video (.mp4) or a folder")


def check_output(target: Path, frames: HeadFrames, video: VideoOptions) -> Path:
    """Return the output if it fits the frames.

    Raises
    ------
    ValueError
        If its extension does not fit, it is one of the inputs or contains them, or it cannot be written.
    """
    inputs = [Path(s) for frame in frames.sources for s in frame if isinstance(s, str | Path)]
    refuse_overwrite([target] if frames.is_clip else _image_files(target, frames), inputs)
    suffix = target.suffix.lower()
    if frames.is_clip:
        if suffix not in MP4_SUFFIXES:
            raise ValueError(f"{target}: a stitched clip is written as {', '.join(MP4_SUFFIXES)}")
        video.codec_of(target)
    elif len(frames.sources) > 1:
        if suffix and not target.is_dir():
            raise ValueError(f"{target}: there are {len(frames.sources)} frames; specify a folder")
        check_output_folder(target, [path.parent for path in inputs])
    elif len(frames.sources) == 1 and (suffix not in IMAGE_SUFFIXES or suffix not in WRITABLE_EXTENSIONS):
        raise ValueError(f"{target}: specify an image file, such as sphere.jpg")
    check_folder_of(target)
    return target
