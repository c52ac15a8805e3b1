"""omnisight map."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json, warn
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions

GROUP = "Geometry"


def map(
    images: Path,
    /,
    *,
    camera: list[str] | None = None,
    rig: Path | None = None,
    output: Annotated[Path, Parameter(alias="-o")],
    options: Annotated[ReconstructOptions, Parameter(name="*")] = ReconstructOptions(),
) -> None:
    """Make a map in which images of any other camera can be localized: `omnisight localize`.

    The map is a reconstruction (`omnisight reconstruct`) with the descriptors of its points.

    Parameters
    ----------
    images
        Folder of images, a video clip, or a ROS bag.
    camera
        Calibration file, as of `omnisight reconstruct`.
    rig
        File of a rig, in place of the camera.
    output
        Folder of the map.
    """
    from omnisight.cli._localize_report import print_map, print_map_json
    from omnisight.cli._reconstruct_inputs import WORK, run_on_images
    from omnisight.pipeline.inputs.work_folder import WorkFolder
    from omnisight.pipeline.localization.visual_map import build_map, write_map
    from omnisight.report.viewer import write_viewer

    (made, result), folder = run_on_images(build_map, images, camera, rig, output, options)
    if made is not None:
        write_map(output, made)
        write_viewer(output / "viewer.html", made.reconstruction, folder, apply_exif=options.apply_exif)
    WorkFolder(output / WORK).remove()
    for warning in result.warnings:
        warn(warning)
    if is_json():
        print_map_json(made, result)
    if made is None:
        raise ValueError(f"{images}: {result.reason}")
    if not is_json():
        print_map(made, result, output)
