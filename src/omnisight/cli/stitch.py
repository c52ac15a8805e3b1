"""omnisight stitch."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.stitching.stitch_options import StitchOptions
from omnisight.video_options import VideoOptions

GROUP = "Views"


def stitch(
    images: list[str],
    /,
    *,
    rig: Path | None = None,
    camera: list[Path] | None = None,
    output: Annotated[str, Parameter(alias="-o")],
    options: Annotated[StitchOptions, Parameter(name="*")] = StitchOptions(),
    video: Annotated[VideoOptions, Parameter(name="*")] = VideoOptions(),
    batch: Annotated[BatchOptions, Parameter(name="*")] = BatchOptions(),
    save_rig: Path | None = None,
) -> None:
    """Stitch simultaneous images of several cameras to a sphere (equirectangular).

    Without a rig, the image circles, lenses and relative rotation of two fisheyes are estimated from their overlap.
    Photos get GPano tags and clips spherical metadata, so that viewers show them as spheres.

    Parameters
    ----------
    images
        An image, folder or clip for each camera, such as front.jpg back.jpg; or one with two circles side by side; or a
        folder with front_1.jpg, back_1.jpg, ... With --workers, --cluster or a URL folders.
    rig
        File of the rig; images in the order of its cameras.
    camera
        Calibration of a lens, one for each image; their rotation is estimated.
    output
        Sphere to write: .jpg, .png or .tif; a folder for several frames; .mp4 for clips.
    save_rig
        File for the estimated rig.
    """
    from omnisight.cli._batch_report import check_batch, print_batch
    from omnisight.cli._files import must_be_writable
    from omnisight.cli._progress import progress
    from omnisight.cli._stitch_report import print_json, print_report
    from omnisight.formats import format_of_suffix, save
    from omnisight.images.output_paths import refuse_overwrite
    from omnisight.pipeline.stitching.stitch import stitch as run

    if save_rig is not None:
        must_be_writable(save_rig)
        format_of_suffix(save_rig)
        refuse_overwrite([save_rig], [*([rig] if rig else []), *(camera or []), *options.mask])
    done = None
    with progress() as report:
        if batch.apply_to(*map(str, images), output):
            from omnisight.pipeline.batch.batch import Batch
            from omnisight.pipeline.stitching.stitch_batch import stitch_batch

            result, done = stitch_batch(images, Batch(output, batch, report), rig, camera or (), options)
        else:
            result = run(images, rig, options, cameras=camera or (), output=output, video=video, progress=report)
    if save_rig is not None:
        save(result.rig, save_rig)
    if is_json():
        print_json(result)
    else:
        print_report(result, output, save_rig)
    if done is not None:
        print_batch(done, output)
        check_batch(done)
