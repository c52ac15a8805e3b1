"""omnisight localize."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.pipeline.localization.localize_options import LocalizeOptions

GROUP = "Geometry"


def localize(
    images: list[str],
    /,
    *,
    map: Path,
    camera: Path | None = None,
    options: Annotated[LocalizeOptions, Parameter(name="*")] = LocalizeOptions(),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
) -> None:
    """Estimate the poses of images in a map that was made from other images, also of another camera.

    Parameters
    ----------
    images
        Images of one camera: folders or files.
    map
        Folder that `omnisight map` wrote.
    camera
        Calibration file of any format; none is needed for 2:1 equirectangular images.
    output
        Table of the poses (world_from_camera) to write, .csv; images without a pose are left out.
    """
    from omnisight.cli._files import must_be_writable, refuse_inputs
    from omnisight.cli._localize_report import print_json, print_report, print_warnings
    from omnisight.pipeline.localization.localize import localize as run
    from omnisight.pipeline.localization.visual_map import read_map
    from omnisight.reconstructions.poses_csv import write_poses

    if output is not None:
        must_be_writable(output)
        refuse_inputs(output, *images, map / "poses.csv", camera, options.mask)
        if output.suffix.lower() not in ("", ".csv"):
            raise ValueError(f"{output}: the poses are written as .csv; name it {output.stem}.csv")
    known = read_map(map)
    with progress() as report:
        found = run(images, known, camera, options, report)
    if output is not None and any(found.values()):
        write_poses(output, {name: image.cam_from_world for name, image in found.items() if image.cam_from_world})
    if is_json():
        print_json(found, known)
    else:
        print_report(found, known, output if any(found.values()) else None)
    print_warnings(found)
    if not any(found.values()):
        raise ValueError(f"{' '.join(images)}: no image was localized in {map}")
