"""Remap tables of views for other programs: `omnisight export` of a camera."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.images import write_bytes
from omnisight.images.output_paths import refuse_overwrite
from omnisight.map_formats import RemapTable, get_map_format
from omnisight.pipeline.inputs.central_camera import CameraSource, central_camera, fit_camera
from omnisight.pipeline.views.view_options import ViewOptions
from omnisight.pipeline.views.view_target import view_target


@dataclass(frozen=True)
class MapExport(Displayed):
    """A remap table that was written for another program.

    Attributes
    ----------
    title, convention
        The name and the convention of the format.
    table
        The source pixel of each pixel of the view.
    options
        The options with the defaults for the camera.
    files
        The files that were written.
    usage
        The command or the code with which the program applies them to an image.
    """

    title: str
    convention: str
    table: RemapTable
    options: ViewOptions
    files: tuple[Path, ...]
    usage: str


def export_map(
    camera: CameraSource,
    output: str | PathLike[str],
    format: str,
    options: ViewOptions | None = None,
    *,
    image_size: tuple[int, int] | None = None,
) -> MapExport:
    """Write the remap table of a view, with which another program renders it.

    Parameters
    ----------
    camera
        The camera of the images, or its calibration file of any format.
    output
        The file, with or without its extension; "ffmpeg" and "glsl" write two files that start with it.
    format
        One of `omnisight.map_formats.map_format_names()`: "opencv-map", "ffmpeg", "stmap", "glsl" or "v360".
    options
        The view, as in `view`.
    image_size
        (width, height) of the images, px, if they were resized after the calibration.

    Returns
    -------
    export
        The table, the files, and how they are used.

    Raises
    ------
    ValueError
        If the program cannot show the view, the camera does not, the size does not fit, or a file is the camera's.
    OSError
        If a file cannot be written.
    """
    options, chosen = options or ViewOptions(), get_map_format(format)
    inputs = [Path(camera)] if isinstance(camera, str | PathLike) else []
    if not isinstance(camera, Camera):
        camera = central_camera(camera, name=options.name, distance=options.distance)
    if image_size is not None:
        camera = fit_camera(camera, image_size, "the images", scale=True)
    options = options.for_camera(camera)
    target, rotations = view_target(options)
    table = RemapTable.of(camera, target, rotations, options.interpolation or "bicubic")
    files, usage = chosen.convert(table, Path(output))
    refuse_overwrite([file for file, _ in files], inputs)
    for file, data in files:
        write_bytes(file, data)
    return MapExport(chosen.TITLE, chosen.CONVENTION, table, options, tuple(file for file, _ in files), usage)
