"""What `omnisight export` writes: a view of a camera, a reconstruction, or its viewer."""

from pathlib import Path
from typing import Literal

from omnisight.extensions import unknown_name
from omnisight.map_formats import format_of_program, map_format_names
from omnisight.reconstructions import reconstruction_format_names


def export_kind(source: Path, format: str) -> Literal["view", "reconstruction", "viewer"]:
    """Return what is written in a format.

    Raises
    ------
    ValueError
        If there is no such format, or it is not one of the source: a camera file, or the folder of a reconstruction.
    """
    views, models = map_format_names(), (*reconstruction_format_names(), "viewer")
    if format not in (*views, *models):
        if reads := format_of_program(format):
            raise ValueError(f"--to {format}: this program reads {reads}; use --to {reads}")
        raise ValueError(unknown_name("format", format, (*views, *models)))
    if format in views:
        if source.is_dir():
            raise ValueError(
                f"{source}: is a folder, and {format} is a format of views: specify a camera file, or a format of"
                f" reconstructions: {', '.join(models)}"
            )
        return "view"
    if source.is_file() and source.suffix != ".npz":
        raise ValueError(
            f"{source}: is a file, and {format} is a format of reconstructions: specify the folder of one, or a format"
            f" of views: {', '.join(views)}"
        )
    return "viewer" if format == "viewer" else "reconstruction"
