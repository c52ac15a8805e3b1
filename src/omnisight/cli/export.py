"""omnisight export."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


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
        The format to write: colmap, colmap_binary, glb, native, nerfstudio, ply, poses_csv, or splat, which cuts the
        images into perspective views.
    output
        The folder of the files.
    images
        The folder of the images, for splat.
    size
        The width of a view of 90 degrees for splat, px. By default the resolution of the image is kept.
    json
        Print one JSON object and nothing else.
    """
    from json import dumps

    from omnisight.pipeline.export import export as run
    from omnisight.reconstructions import ExportOptions, get_reconstruction_format

    files = run(model, output, ExportOptions(to, images, size))
    if json:
        print(dumps({"format": to, "files": [str(file) for file in files]}))
        return
    chosen = get_reconstruction_format(to)
    print(f"format      {chosen.TITLE}")
    print(f"convention  {chosen.CONVENTION}")
    print(f"written     {output}; files: {len(files)}, {sum(file.stat().st_size for file in files) / 1e6:.3g} MB")
