"""omnisight doctor."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json, write_json
from omnisight.pipeline.odometry.doctor_options import DoctorOptions

GROUP = "Geometry"

if TYPE_CHECKING:
    from omnisight.pipeline.odometry.doctor import Diagnosis


def doctor(
    images: Path | None = None,
    /,
    *,
    camera: str | None = None,
    write_mask: Path | None = None,
    options: Annotated[DoctorOptions, Parameter(name="*")] = DoctorOptions(),
) -> None:
    """Check a recording of a moving camera before it is used or, without images, the installation.

    One line per check with what was measured, and advice. The exit status is 2 if a check has failed: odometry would
    fail too, or the installation is broken.

    Parameters
    ----------
    images
        Video clip, ROS bag, or folder of images in the order of their names.
    camera
        Calibration file of any format; none is needed for 2:1 equirectangular images.
    write_mask
        Write an image that is black where all images look the same, for `odometry --mask`.
    """
    from omnisight.cli._files import must_be_writable_image, refuse_inputs
    from omnisight.cli._progress import progress
    from omnisight.images.output_paths import check_output_folder
    from omnisight.pipeline.inputs.image_set import image_folders
    from omnisight.pipeline.odometry.doctor import doctor as run

    if write_mask is not None:
        must_be_writable_image(write_mask)
        refuse_inputs(write_mask, images, camera, options.mask)
        if images is not None and images.is_dir():
            check_output_folder(write_mask.parent, image_folders(images))
    with progress() as report:
        diagnosis = run(images, camera, options, report)
    written = write_mask if write_mask is not None and _write_mask(write_mask, diagnosis) else None
    (_print_json if is_json() else _print_report)(diagnosis, written)
    if not diagnosis:
        sys.exit(2)


def _write_mask(path: Path, diagnosis: "Diagnosis") -> bool:
    """Write the pixels to use; return whether static regions are known."""
    import numpy as np

    from omnisight.images import write_image

    if diagnosis.static_region is None:
        return False
    write_image(path, np.where(diagnosis.static_region, 0, 255).astype(np.uint8))
    return True


def _print_report(diagnosis: "Diagnosis", written: Path | None) -> None:
    """Print one line per check, and the advice below it."""
    width = max(len(finding.name) for finding in diagnosis.findings) + 2
    for finding in diagnosis.findings:
        print(f"{finding.name:<{width}}{finding.level!s:<9}{finding.figure}")
        if finding.advice:
            print(f"{'':<{width + 9}}-> {finding.advice}")
    if written is not None:
        print(f"{'written':<{width}}{'':<9}{written}")


def _print_json(diagnosis: "Diagnosis", written: Path | None) -> None:
    """Print the findings as one JSON object."""
    findings = [
        {"name": finding.name, "level": str(finding.level), "figure": finding.figure, "advice": finding.advice}
        for finding in diagnosis.findings
    ]
    data = {"level": str(diagnosis.level), "findings": findings, "mask": None if written is None else str(written)}
    write_json(data)
