"""omnisight compass."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.localization.compass_options import CompassOptions

GROUP = "Geometry"


def compass(
    images: list[Path],
    /,
    *,
    reference: Annotated[tuple[Path, ...], Parameter(consume_multiple=True)] = (),
    camera: Path | None = None,
    options: Annotated[CompassOptions, Parameter(name="*")] = CompassOptions(),
) -> None:
    """Estimate the heading of images from their appearance, relative to the most similar reference.

    Images are panoramas of 360°, of any size, whose columns run clockwise from left to right, or those of a camera.
    Positive headings are clockwise.

    Parameters
    ----------
    images
        Folder, or image files.
    reference
        Folder or image files of the references, such as a route; by default the first image.
    camera
        Calibration file, for images that are no panoramas.
    """
    from omnisight.cli._compass_report import print_json, print_report
    from omnisight.cli._progress import progress
    from omnisight.pipeline.localization.compass import compass as run

    with progress() as report:
        result = run(images, reference or None, options, camera=camera, progress=report)
    if is_json():
        print_json(result)
    if not result:
        raise ValueError(result.reason)
    if not is_json():
        print_report(result)
