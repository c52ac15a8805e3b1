"""omnisight export."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

GROUP = "Geometry"


def export(
    model: Path,
    /,
    *,
    to: str,
    output: Annotated[Path, Parameter(alias="-o")],
    images: Path | None = None,
    size: int | None = None,
    json: bool = False,
) -> None:
    """Write a reconstruction for another program: COLMAP, nerfstudio, Gaussian splatting, Blender ...

    Parameters
    ----------
    model
        A folder that `omnisight reconstruct` wrote.
    to
        The format to write: colmap, colmap_binary, glb, native, nerfstudio, ply, poses_csv; splat, which turns the
        images into perspective views; or viewer, an HTML page.
    output
        The folder of the files.
    images
        The folder of the images, for splat and viewer.
    size
        The width of a view of 90 degrees for splat, px. By default the resolution of the image is kept.
    json
        Print one JSON object and nothing else.
    """
    from json import dumps

    from omnisight.pipeline.export import export as run
    from omnisight.reconstructions import ExportOptions, get_reconstruction_format

    if to == "viewer":
        files, title, convention = _write_viewer(model, output, images), "HTML viewer", "open it in a browser"
    else:
        chosen = get_reconstruction_format(to)
        title, convention = chosen.TITLE, chosen.CONVENTION
        files = run(model, output, ExportOptions(to, images, size))
    if json:
        print(dumps({"format": to, "files": [str(file) for file in files]}))
        return
    print(f"format      {title}")
    print(f"convention  {convention}")
    print(f"written     {output}; files: {len(files)}, {sum(file.stat().st_size for file in files) / 1e6:.3g} MB")


def _write_viewer(model: Path, output: Path, images: Path | None) -> tuple[Path, ...]:
    """Write viewer.html in the output folder."""
    from omnisight.reconstructions import read_reconstruction
    from omnisight.report import write_viewer

    if images is not None and not images.is_dir():
        raise ValueError(f"{images}: no such folder; specify the folder that was reconstructed with --images")
    reconstruction = read_reconstruction(model)
    output.mkdir(parents=True, exist_ok=True)
    write_viewer(output / "viewer.html", reconstruction, images)
    return (output / "viewer.html",)
