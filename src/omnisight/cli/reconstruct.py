"""omnisight reconstruct."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json, warn
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions

GROUP = "Geometry"


def reconstruct(
    images: Path,
    /,
    *,
    camera: list[str] | None = None,
    rig: Path | None = None,
    output: Annotated[Path, Parameter(alias="-o")],
    options: Annotated[ReconstructOptions, Parameter(name="*")] = ReconstructOptions(),
) -> None:
    """Reconstruct the poses of images of any cameras or a rig, and the points that they show.

    Images without common points are in separate models: the largest is in the output folder, further ones in its
    sub-folders 1, 2 ... The unit of a model is the metre if a rig, a known distance or known positions determine it,
    and otherwise arbitrary. After an interruption, the same command continues where it stopped. `omnisight export`
    writes the model for other programs.

    Parameters
    ----------
    images
        Folder of images, a video clip, or a ROS bag.
    camera
        Calibration file of any format; none is needed for 2:1 equirectangular images. Without it, or with auto, focal
        length and one distortion term are estimated from the images. Repeat it for several cameras, with their names:
        front=front.json, where the images are in front/ or named front_1.jpg. A non-central camera needs --scale or
        --positions.
    rig
        File of a rig, in place of the camera. Its cameras' images of the same name or number were taken together.
    output
        Folder of the model: poses.csv (world_from_camera), reconstruction.npz, points.ply, viewer.html to look at, and
        COLMAP's text files where COLMAP has the camera.
    """
    from omnisight.cli._reconstruct_inputs import WORK, run_on_images
    from omnisight.cli._reconstruct_report import model_folder, print_json, print_report, remove_models
    from omnisight.pipeline.inputs.work_folder import WorkFolder
    from omnisight.pipeline.reconstruction.reconstruct import reconstruct as run
    from omnisight.reconstructions import write_reconstruction
    from omnisight.report.viewer import write_viewer

    result, folder = run_on_images(run, images, camera, rig, output, options)
    for number, model in enumerate(result.models):
        write_reconstruction(model_folder(output, number), model)
        write_viewer(model_folder(output, number) / "viewer.html", model, folder, apply_exif=options.apply_exif)
    if result:
        remove_models(output, first=len(result.models))
    WorkFolder(output / WORK).remove()
    for warning in result.warnings:
        warn(warning)
    if is_json():
        print_json(result)
    if not result:
        raise ValueError(f"{images}: {result.reason}")
    if not is_json():
        print_report(result, output)
