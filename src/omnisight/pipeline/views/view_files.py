"""Several views of images or of a clip: the counterpart of `omnisight view` with its options."""

from collections.abc import Sequence
from os import PathLike

from omnisight.images import has_clip_suffix
from omnisight.pipeline.inputs.central_camera import AnyCameraSource
from omnisight.pipeline.views.view import ViewResult, view_images
from omnisight.pipeline.views.view_clip import ClipViews, view_clip
from omnisight.pipeline.views.view_options import ViewMotion, ViewOptions
from omnisight.progress import Progress, no_progress
from omnisight.video_options import VideoOptions


def view_files(
    images: Sequence[str],
    camera: AnyCameraSource | None,
    views: Sequence[tuple[str, ViewOptions]],
    *,
    mask: str | PathLike[str] | None = None,
    view_camera: str | PathLike[str] | None = None,
    motion: ViewMotion = ViewMotion(),
    video: VideoOptions = VideoOptions(),
    progress: Progress = no_progress,
) -> tuple[tuple[ViewResult, ...], ClipViews | None]:
    """Turn images, or a clip, into one or several views; the parameters are those of `view` and `view_clip`.

    Returns
    -------
    views
        For each output.
    clip
        What was written of a clip; None for images.

    Raises
    ------
    ValueError
        If a clip is not the only input, an option does not apply to the inputs, or as of `view` and `view_clip`.
    """
    clips = [image for image in images if has_clip_suffix(image)]
    if clips and len(images) > 1:
        raise ValueError(f"{clips[0]}: a clip is viewed alone; there are {len(images)} inputs")
    if (mask or view_camera) and (clips or len(views) > 1):
        raise ValueError(
            "--mask and --view-camera apply to one view of images: leave them out, or render the view alone"
        )
    if clips:
        written = view_clip(clips[0], camera, views, motion=motion, video=video, progress=progress)
        return written.views, written
    if motion.moves:
        raise ValueError(f"{images[0]}: --path, --pan and --stabilize apply to a clip: leave them out")
    results = view_images(images, camera, views, mask=mask, view_camera=view_camera, progress=progress)
    return results, None
