"""omnisight birdseye."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.pipeline.birdseye.birdseye_options import BirdseyeOptions
from omnisight.video_options import VideoOptions

GROUP = "Views"


def birdseye(
    images: list[Path],
    /,
    *,
    rig: Path | None = None,
    camera: list[str] | None = None,
    output: Annotated[Path, Parameter(alias="-o")],
    options: Annotated[BirdseyeOptions, Parameter(name="*")] = BirdseyeOptions(),
    video: Annotated[VideoOptions, Parameter(name="*")] = VideoOptions(),
    save_rig: Path | None = None,
) -> None:
    """Show the ground around a vehicle from above, from simultaneous images or clips of its cameras.

    Forward is up. The ground is known from the rig (its frame is on the ground: x right, y down, z forward), from the
    height of the rig, or from markings on the ground, to which the poses of the cameras are then calibrated.

    Parameters
    ----------
    images
        One image, folder or clip for each camera, with its name in the path: front.png, left_017.jpg, back/0001.png,
        back/, right.mp4.
    rig
        File of the rig, or of its only camera.
    camera
        Calibration file of a camera, NAME=FILE, in place of a rig; once per camera. The poses of the cameras follow
        from marks on the ground (--ground).
    output
        Image to write; for clips and folders a video (.mp4) or a folder of images.
    save_rig
        File of the rig in the ground frame to write; later runs need no markings.
    """
    from omnisight.cli._birdseye_report import print_json, print_report
    from omnisight.pipeline.birdseye.birdseye_files import write_birdseye
    from omnisight.pipeline.inputs.named_files import named_files

    if (rig is None) == (not camera):
        raise ValueError("specify either the rig (--rig rig.json) or its cameras (--camera front=front.json ...)")
    body = rig or named_files(camera or [])
    with progress() as report:
        written = write_birdseye(images, body, output, options, video=video, save_rig=save_rig, progress=report)
    if is_json():
        print_json(written)
    else:
        print_report(written)
