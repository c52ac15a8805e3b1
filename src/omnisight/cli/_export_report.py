"""Output of `omnisight export`."""

from collections.abc import Sequence
from pathlib import Path

from omnisight.cli._output import is_json, write_json
from omnisight.display import file_size
from omnisight.pipeline.views.export_map import MapExport

# A remap table reads single pixels: a view that is smaller than the image by more than this factor shows aliasing.
MAX_SCALE = 1.5


def print_files(format: str, title: str, convention: str, output: Path, files: Sequence[Path]) -> None:
    """Print the files of a reconstruction."""
    if is_json():
        write_json({"format": format, "files": [str(file) for file in files]})
        return
    print(f"format      {title}")
    print(f"convention  {convention}")
    print(f"written     {output}; files: {len(files)}, {file_size(sum(file.stat().st_size for file in files))}")


def print_map(export: MapExport) -> None:
    """Print the view, the convention of the remap table, and its use."""
    table = export.table
    rows, columns = table.covered.shape
    faces = ", six faces" if len(table.rotations) > 1 else ""
    print(f"view        {export.options.to}, {columns}x{rows}{faces}, {table.covered.mean():.0%} covered")
    print(f"images      {table.source.width}x{table.source.height} of the camera, {table.source.model.name}")
    print(f"format      {export.title}")
    print(f"convention  {export.convention}")
    if table.scale > MAX_SCALE:
        print(
            f"warning     a pixel of the view spans up to {table.scale:.1f} px of the image, which other programs do"
            " not average: render a larger view and reduce it, or use omnisight view"
        )
    for file in export.files:
        print(f"written     {file}, {file_size(file.stat().st_size)}")
    print(f"use         {export.usage}")


def print_map_json(export: MapExport) -> None:
    """Print the files and their use as one JSON object."""
    table = export.table
    rows, columns = table.covered.shape
    write_json(
        {
            "format": export.title,
            "convention": export.convention,
            "files": [str(file) for file in export.files],
            "usage": export.usage,
            "view": export.options.to,
            "size": [columns, rows],
            "image_size": list(table.source.size),
            "covered": float(table.covered.mean()),
            "scale": table.scale,
        }
    )
