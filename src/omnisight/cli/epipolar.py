"""omnisight epipolar."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.two_views.two_view_options import EpipolarOptions

GROUP = "Geometry"


def epipolar(
    image_a: Path,
    image_b: Path,
    /,
    *,
    camera: Path | None = None,
    camera_b: Path | None = None,
    options: Annotated[EpipolarOptions, Parameter(name="*")] = EpipolarOptions(),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
) -> None:
    """Estimate the relative pose of two images of any cameras, and draw their epipolar geometry.

    The drawing shows both images with inliers (green) and other matches (red), the epipolar curves of some inliers,
    each with one colour and number in both images, and the epipoles.

    Parameters
    ----------
    image_a
        The first image.
    image_b
        The second image.
    camera
        Calibration file of any format; none is needed for 2:1 equirectangular images.
    camera_b
        Calibration file of the second image; by default that of the first.
    output
        Drawing to write.
    """
    from omnisight.cli._epipolar_report import print_json, print_report
    from omnisight.cli._files import must_be_writable_image
    from omnisight.compilation import compile_in_parallel
    from omnisight.images import write_image
    from omnisight.images.output_paths import refuse_overwrite
    from omnisight.pipeline.two_views.epipolar import epipolar as run
    from omnisight.twoview.first_run import parts

    if output is not None:
        must_be_writable_image(output)
        inputs = (image_a, image_b, camera, camera_b, options.mask, options.mask_b)
        refuse_overwrite([output], [path for path in inputs if path is not None])
    with compile_in_parallel(parts):
        result = run(image_a, image_b, camera, camera_b, options)
    if result and output is not None:
        from omnisight.report.drawings.epipolar import draw_epipolar

        write_image(output, draw_epipolar(result))
    if is_json():
        print_json(result)
    if not result:
        raise ValueError(f"{image_a}, {image_b}: {result.reason}")
    if not is_json():
        print_report(result, output)
