"""omnisight capture."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.calibration.capture_options import CaptureOptions

GROUP = "Calibration"


def capture(
    source: str,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")],
    options: Annotated[CaptureOptions, Parameter(name="*")] = CaptureOptions(),
    page: bool = False,
) -> None:
    """Capture calibration images from a connected camera, and show where to hold the board next.

    An image is stored when the board is still and sharp, and adds information to the images so far. The capture ends
    when enough images cover the field of view, or at Ctrl-C. The images of an earlier run in the folder are continued.

    Parameters
    ----------
    source
        Number of the camera: 0 is the first. A clip or a folder of images instead selects from these.
    output
        Folder of the images: capture-001.png, ...
    page
        Show the image, the covered field of view and the next pose in a page for the browser, on this computer only.
    """
    from omnisight.cli._capture_report import as_json, live_view, nothing_stored, print_report
    from omnisight.pipeline.calibration.capture import capture as run

    if output.exists() and not output.is_dir():
        raise ValueError(f"{output}: is a file; name a folder for the images")
    with live_view(source, options, has_page=page) as show:
        result = run(source, output, options, show)
    if is_json():
        as_json(result)
    if not result:
        raise ValueError(f"{source}: {nothing_stored(result)}")
    if not is_json():
        print_report(result, output, options)
