"""omnisight compare."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.conversion.compare_options import CompareOptions

GROUP = "Cameras"


def compare(
    a: Path,
    b: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    options: Annotated[CompareOptions, Parameter(name="*")] = CompareOptions(),
) -> None:
    """Compare two calibrated cameras: their difference in px and degrees, and whether their uncertainties explain it.

    Any two models, formats and image sizes of one aspect ratio. The difference is that after the best rotation between
    the camera frames, which poses absorb, over the common calibrated field of view.

    Parameters
    ----------
    a
        Calibration file of any format.
    b
        Calibration file of any format.
    output
        Draw the difference and the uncertainties into this image.
    """
    from omnisight.cli._compare_report import print_json, print_report
    from omnisight.cli._files import must_be_writable_image
    from omnisight.pipeline.conversion.compare import compare as run

    if output is not None:
        must_be_writable_image(output)
    comparison = run(a, b, options)
    if output is not None:
        from omnisight.images import write_image
        from omnisight.report.drawings.camera_comparison import draw_comparison

        write_image(output, draw_comparison(comparison))
    (print_json if is_json() else print_report)(comparison, output)
