"""omnisight view."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.cli._view_options import CommonViewOptions, RepeatedViewOptions, ViewMotionOptions
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.views.view_options import ViewOptions
from omnisight.video_options import VideoOptions

GROUP = "Views"


def view(
    images: list[str],
    /,
    *,
    camera: Path | None = None,
    output: Annotated[list[str], Parameter(alias="-o")],
    each: Annotated[RepeatedViewOptions, Parameter(name="*")] = RepeatedViewOptions(),
    common: Annotated[CommonViewOptions, Parameter(name="*")] = CommonViewOptions(),
    mask: Path | None = None,
    view_camera: Path | None = None,
    motion: Annotated[ViewMotionOptions, Parameter(name="*")] = ViewMotionOptions(),
    video: Annotated[VideoOptions, Parameter(name="*")] = VideoOptions(),
    batch: Annotated[BatchOptions, Parameter(name="*")] = BatchOptions(),
) -> None:
    """Turn images or a clip into views: perspective, cylinder, sphere, cube, planet, fisheye ...

    A clip (room.mp4) becomes a video with the same sound. Several views are made in one pass: repeat --output, and
    --to, --fov, --yaw, --pitch, --roll or --size for each output that has it, in their order.

    Angles are in degrees. +yaw looks right, +pitch up, +roll rotates the view clockwise:

                 y up is -v         x right, y down, z forward is the camera;
                  |  / forward      yaw 0, pitch 0 is its axis.
                  | /
        left -----+----- right (+yaw)

    Parameters
    ----------
    images
        Images, folders or patterns, or one video clip. Several images go to the folder --output. With --workers,
        --cluster or a URL (s3://, gs://, az://, zip://*::images.zip) one folder with its sub-folders, or a pattern.
    camera
        Calibration file of any format. It may be omitted for equirectangular images and clips of 360° x 180°, which are
        twice as wide as high.
    output
        File of the view, or a folder (required for several images); a video file for a clip.
    mask
        Write the mask of covered pixels: a PNG, 255 where the image covers the view.
    view_camera
        Write the camera of the view; its provenance has the rotation.
    """
    from omnisight.cli._view_report import print_json, print_report
    from omnisight.pipeline.views.view import skipped_message
    from omnisight.pipeline.views.view_files import view_files

    views = each.of_outputs(output, common)
    if batch.apply_to(*images, *output):
        if len(images) > 1 or len(views) > 1 or mask or view_camera or motion.moves:
            raise ValueError(
                "--workers, --cluster and URLs apply to one view of one folder or pattern of images: run the"
                " command once for each, without --mask, --view-camera, --path, --pan and --stabilize"
            )
        _view_batch(images[0], camera, *views[0], batch)
        return
    with progress() as report:
        results, clip = view_files(
            images, camera, views, mask=mask, view_camera=view_camera, motion=motion, video=video, progress=report
        )
    if is_json():
        print_json(results, clip)
    else:
        print_report(results, output, clip, is_up_given=common.up is not None)
    errors = results[0].errors
    if errors:
        raise ValueError(skipped_message(errors, len(results[0].files) + len(errors)))


def _view_batch(images: str, camera: Path | None, output: str, options: ViewOptions, batch: BatchOptions) -> None:
    """Render the views by workers, and print the result."""
    from omnisight.cli._batch_report import check_batch, print_batch, print_batch_json
    from omnisight.pipeline.batch.batch import Batch
    from omnisight.pipeline.views.view_batch import view_batch

    if camera is None:
        raise ValueError("--workers, --cluster and URLs need a calibration file (--camera)")
    with progress() as report:
        result = view_batch(images, camera, Batch(output, batch, report), options)
    (print_batch_json if is_json() else print_batch)(result, output)
    check_batch(result)
