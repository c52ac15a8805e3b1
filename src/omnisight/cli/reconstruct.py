"""omnisight reconstruct."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._progress import progress
from omnisight.pipeline.options import ReconstructOptions


def reconstruct(
    images: Path,
    /,
    *,
    camera: Path | None = None,
    output: Annotated[Path, Parameter(alias="-o")],
    options: Annotated[ReconstructOptions, Parameter(name="*")] = ReconstructOptions(),
    quiet: bool = False,
    json: bool = False,
) -> None:
    """Reconstruct the poses of images of any central camera, and the points that they show.

    Images without common points are in separate models: the largest is in the output folder, further ones in its
    sub-folders 1, 2 ... The unit of a model is arbitrary. `omnisight export` writes it for other programs.

    Parameters
    ----------
    images
        Folder of images.
    camera
        Calibration file of any format; none is needed for 2:1 equirectangular images.
    output
        Folder of the model: poses.csv (world_from_camera), reconstruction.npz, points.ply, viewer.html to look at, and
        COLMAP's text files where COLMAP has the camera.
    quiet
        Show no progress.
    json
        Print one JSON object and nothing else.
    """
    from omnisight.cli._reconstruct_report import model_folder, print_json, print_report
    from omnisight.pipeline.reconstruct import reconstruct as run
    from omnisight.reconstructions import write_reconstruction
    from omnisight.report import write_viewer

    with progress(quiet or json) as report:
        result = run(images, camera, options, report)
    for number, model in enumerate(result.models):
        folder = model_folder(output, number)
        write_reconstruction(folder, model)
        write_viewer(folder / "viewer.html", model, images if images.is_dir() else images.parent)
    if json:
        print_json(result)
    if not result:
        raise ValueError(f"{images}: {result.reason}")
    if not json:
        print_report(result, output)
