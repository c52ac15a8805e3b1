"""omnisight calibrate-lines."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress

GROUP = "Calibration"


def calibrate_lines(
    images: list[str],
    /,
    *,
    model: str = "unified",
    mask: Path | None = None,
    lines: Path | None = None,
    fix: list[str] | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    draw: Path | None = None,
    apply_exif: bool = False,
) -> None:
    """Calibrate a camera from images of straight lines, without a board.

    One image of a room or a street can be enough. Edges are detected, and the camera is estimated for which most of
    them are images of straight lines. Other edges are rejected.

    Parameters
    ----------
    images
        Folders, image files or glob patterns, all of one camera.
    model
        Camera model. Lines determine the unified model except for handedness; for models with a free radial profile
        (ocam, kannala_brandt ...) the focal scale is fixed to that of the unified model.
    mask
        Image that is white where lines are searched (in a PBM file: 1). By default the border of the lens or mirror is
        detected.
    lines
        File of lines drawn by you, used instead of detected edges: JSON, a list of lines, each a list of [u, v], or an
        object with such a list for each image name; or CSV with the columns line,u,v or image,line,u,v.
    fix
        Known parameter of the camera, such as xi=1 for a parabolic mirror.
    output
        Camera file to write (JSON).
    draw
        Folder for copies of the images with the lines drawn: inliers green, outliers red, great circles blue.
    apply_exif
        Rotate images by their EXIF orientation; a calibration needs them as the sensor recorded them.
    """
    from omnisight.cli._files import check_camera_suffix, default_output, must_be_writable
    from omnisight.cli._lines_report import print_json, print_report
    from omnisight.formats import save
    from omnisight.images import collect_images
    from omnisight.images.output_paths import drawing_paths, refuse_overwrite
    from omnisight.pipeline.calibration.calibrate_lines import CalibrateLinesOptions
    from omnisight.pipeline.calibration.calibrate_lines import calibrate_lines as calibrate

    options = CalibrateLinesOptions(model, _parse_fixed(fix or []), mask=mask, lines=lines, apply_exif=apply_exif)
    paths = collect_images(images)
    # Check the outputs before the calibration, which takes a while.
    if output is None and not is_json():
        output = default_output("camera.json")
    if output is not None:
        must_be_writable(output)
        refuse_overwrite([output], [*paths, *([lines] if lines else []), *([mask] if mask else [])])
        check_camera_suffix(output)
    if draw is not None:
        drawing_paths(paths, draw)
    with progress() as report:
        calibration = calibrate(paths, options, progress=report)
    # Write the camera first, so that a failed drawing does not lose it.
    written = save(calibration.camera, output) if output is not None else None
    if is_json():
        print_json(calibration)
    else:
        print_report(calibration, written)
    if draw is not None:
        from omnisight.report.drawings.lines import draw_lines

        draw_lines(calibration, paths, draw, apply_exif=apply_exif)
        print(f"drawn     {draw}")


def _parse_fixed(texts: Sequence[str]) -> dict[str, float]:
    """Parse `name=value` options."""
    fixed: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            fixed[name.strip()] = float(value)
        except ValueError:
            raise ValueError(f"--fix must be a parameter and its value, such as xi=1, got {text!r}") from None
    return fixed
