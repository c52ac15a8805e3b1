"""omnisight export."""

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.cli._text_options import parse_size, text_parameter
from omnisight.cli._view_options import ExportedViewOptions
from omnisight.pipeline.batch.batch_options import BatchOptions

if TYPE_CHECKING:
    from omnisight.reconstructions import ExportOptions

GROUP = "Views"
# Options that do not apply to views, and those that apply to formats of reconstructions; `to` is --view.
OF_IMAGES = "images", "apply_exif"
OF_MODELS = {"splat": (*OF_IMAGES, "size"), "viewer": OF_IMAGES}
# Of the files that an exported folder holds.
FILE_SUFFIXES = ".glb", ".ply", ".csv", ".json", ".npz", ".html", ".txt", ".bin"


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
    from omnisight.images.output_paths import check_output_folder
    from omnisight.pipeline.views.export_kind import export_kind
    from omnisight.reconstructions import ExportOptions

    kind = export_kind(source, to)
    is_batch = batch.apply_to(images or "", output)
    if is_batch and (to != "splat" or images is None):
        raise ValueError(
            "--workers, --cluster and URLs apply to --to splat with --images: leave them out, or specify both"
        )
    specified = [field.name for field in fields(view) if getattr(view, field.name) != field.default]
    specified += ["images"] * (images is not None) + ["image_size"] * (image_size is not None)
    _refuse_unused(to, specified, is_view=kind == "view")
    if kind == "view":
        _export_view(source, to, Path(output), view, image_size)
    elif is_batch and images is not None:
        _export_batch(source, images, output, batch, view)
    else:
        folder = Path(images) if images else None
        check_output_folder(Path(output), [folder] if folder and to == "splat" else [])
        if Path(output).suffix.lower() in FILE_SUFFIXES and not Path(output).is_dir():
            raise ValueError(f"{output}: is the name of a file, and the output is a folder: name one, such as export/")
        if kind == "viewer":
            _export_viewer(source, Path(output), folder, view.apply_exif)
        else:
            _export_reconstruction(source, Path(output), ExportOptions(to, folder, _width(view), view.apply_exif))


def _refuse_unused(to: str, specified: list[str], *, is_view: bool) -> None:
    """Raise ValueError if specified options do not apply to a format."""
    unused = [name for name in specified if (name in OF_IMAGES if is_view else name not in OF_MODELS.get(to, ()))]
    if unused:
        options = ", ".join(f"--{'view' if name == 'to' else name.replace('_', '-')}" for name in unused)
        verb, pronoun = ("does", "it") if len(unused) == 1 else ("do", "them")
        raise ValueError(f"{options} {verb} not apply to --to {to}: leave {pronoun} out")


def _export_view(
    camera: Path, to: str, output: Path, view: ExportedViewOptions, image_size: tuple[int, int] | None
) -> None:
    """Write the remap table of a view, and print its use."""
    from omnisight.cli._export_report import print_map, print_map_json
    from omnisight.pipeline.views.export_map import export_map

    result = export_map(camera, output, to, view, image_size=image_size)
    (print_map_json if is_json() else print_map)(result)


def _export_batch(model: Path, images: str, output: str, batch: BatchOptions, view: ExportedViewOptions) -> None:
    """Write the views of a reconstruction by workers, and print the result."""
    from omnisight.cli._batch_report import check_batch, print_batch, print_batch_json
    from omnisight.pipeline.batch.batch import Batch
    from omnisight.pipeline.views.export_batch import export_batch

    with progress() as report:
        run = Batch(output, batch, report)
        result = export_batch(model, images, run, _width(view), apply_exif=view.apply_exif)
    (print_batch_json if is_json() else print_batch)(result, output)
    check_batch(result)


def _width(view: ExportedViewOptions) -> int | None:
    """Return the width of a view of 90 degrees; None without."""
    return view.size[0] if view.size else None


def _export_viewer(model: Path, output: Path, images: Path | None, apply_exif: bool) -> None:
    """Write the viewer of a reconstruction, and print the file."""
    from omnisight.cli._export_report import print_files
    from omnisight.report.viewer import export_viewer

    written = export_viewer(model, output, images, apply_exif=apply_exif)
    print_files("viewer", "HTML viewer", "open it in a browser", output, [written])


def _export_reconstruction(model: Path, output: Path, options: "ExportOptions") -> None:
    """Write a reconstruction, and print the files."""
    from omnisight.cli._export_report import print_files
    from omnisight.pipeline.views.export import export as run
    from omnisight.reconstructions import get_reconstruction_format

    chosen = get_reconstruction_format(options.format)
    print_files(options.format, chosen.TITLE, chosen.CONVENTION, output, run(model, output, options))
