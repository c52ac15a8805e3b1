"""omnisight export."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json, write_json
from omnisight.cli._progress import progress
from omnisight.cli._text_options import parse_size, text_parameter
from omnisight.cli._view_options import ExportedViewOptions
from omnisight.pipeline.batch.batch_options import BatchOptions

GROUP = "Views"


def export(
    source: Path,
    /,
    *,
    to: str,
    output: Annotated[str, Parameter(alias="-o")],
    images: str | None = None,
    image_size: Annotated[tuple[int, int] | None, text_parameter(parse_size)] = None,
    view: Annotated[ExportedViewOptions, Parameter(name="*")] = ExportedViewOptions(),
    batch: Annotated[BatchOptions, Parameter(name="*")] = BatchOptions(),
) -> None:
    """Write a view of a camera, or a reconstruction, for another program.

    Of a camera file, the remap table of a view: OpenCV, FFmpeg, Nuke, Fusion, Blender, OpenGL. The options from --view
    to --distance are those of `omnisight view`. Of a reconstruction: COLMAP, nerfstudio, Gaussian splatting, Blender.

    Parameters
    ----------
    source
        A calibration file of any format, or a folder that `omnisight reconstruct` wrote.
    to
        The format. Of a view: opencv-map, ffmpeg, stmap, glsl or v360. Of a reconstruction: colmap, colmap_binary, glb,
        native, nerfstudio, ply, poses_csv; splat, which turns the images into perspective views; or viewer, an HTML
        page.
    output
        The file of the remap table, with or without its extension; or the folder of the reconstruction.
    images
        The folder of the images, for splat and viewer. For splat with --workers, --cluster or a URL they are processed
        by workers.
    image_size
        WIDTHxHEIGHT of the images, if they were resized after the calibration.
    """
    from omnisight.cli._batch_report import check_batch, print_batch, print_batch_json
    from omnisight.extensions import unknown_name
    from omnisight.map_formats import format_of_program, map_format_names
    from omnisight.reconstructions import reconstruction_format_names

    views, models = map_format_names(), (*reconstruction_format_names(), "viewer")
    if to not in (*views, *models):
        if reads := format_of_program(to):
            raise ValueError(f"--to {to}: this program reads {reads}; use --to {reads}")
        raise ValueError(unknown_name("format", to, (*views, *models)))
    if to in models:
        if source.is_file() and source.suffix != ".npz":
            raise ValueError(
                f"{source}: is a file, and {to} is a format of reconstructions: specify the folder of one, or a format"
                f" of views: {', '.join(views)}"
            )
        width = view.size[0] if view.size else None
        if batch.apply_to(images or "", output):
            if to != "splat" or images is None:
                raise ValueError("--workers, --cluster and URLs apply to --to splat with --images")
            from omnisight.pipeline.batch.batch import Batch
            from omnisight.pipeline.export_batch import export_batch

            with progress() as report:
                result = export_batch(source, images, Batch(output, batch, report), width)
            (print_batch_json if is_json() else print_batch)(result, output)
            check_batch(result)
            return
        _export_reconstruction(source, to, Path(output), Path(images) if images else None, width)
        return
    if source.is_dir():
        raise ValueError(
            f"{source}: is a folder, and {to} is a format of views: specify a camera file, or a format of"
            f" reconstructions: {', '.join(models)}"
        )
    from omnisight.pipeline.export_map import export_map
    from omnisight.pipeline.view_options import ViewOptions

    result = export_map(source, Path(output), to, ViewOptions(**vars(view)), image_size=image_size)
    from omnisight.cli._export_report import print_map, print_map_json

    (print_map_json if is_json() else print_map)(result)


def _export_reconstruction(model: Path, to: str, output: Path, images: Path | None, size: int | None) -> None:
    """Write a reconstruction and print the files."""
    from omnisight.cli._export_report import print_files
    from omnisight.pipeline.export import export as run
    from omnisight.reconstructions import ExportOptions, get_reconstruction_format

    if to == "viewer":
        files, title, convention = _write_viewer(model, output, images), "HTML viewer", "open it in a browser"
    else:
        chosen = get_reconstruction_format(to)
        title, convention = chosen.TITLE, chosen.CONVENTION
        files = run(model, output, ExportOptions(to, images, size))
    if is_json():
        write_json({"format": to, "files": [str(file) for file in files]})
        return
    print_files(title, convention, output, files)


def _write_viewer(model: Path, output: Path, images: Path | None) -> tuple[Path, ...]:
    """Write viewer.html in the output folder."""
    from omnisight.reconstructions import read_reconstruction
    from omnisight.report.viewer import write_viewer

    if images is not None and not images.is_dir():
        raise ValueError(f"{images}: no such folder; specify the folder that was reconstructed with --images")
    reconstruction = read_reconstruction(model)
    output.mkdir(parents=True, exist_ok=True)
    write_viewer(output / "viewer.html", reconstruction, images)
    return (output / "viewer.html",)
