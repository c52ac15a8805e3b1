"""omnisight odometry."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.odometry.odometry_options import OdometryOptions

if TYPE_CHECKING:
    from omnisight.pipeline.odometry.odometry_result import OdometryResult

GROUP = "Geometry"


def odometry(
    images: Path,
    /,
    *,
    camera: str | None = None,
    rig: Path | None = None,
    output: Annotated[Path, Parameter(alias="-o")],
    live: bool = False,
    page: bool = False,
    options: Annotated[OdometryOptions, Parameter(name="*")] = OdometryOptions(),
) -> None:
    """Compute the trajectory of a moving camera or rig from a clip, a ROS bag, a folder of images, or a live camera.

    The world is the frame of the camera at the first image. Poses are written as soon as they are known, so that an
    interrupted run keeps them. At the end, places that were seen before close loops, and the file is replaced by the
    corrected trajectory. Images whose pose is not known are reported with the reason.

    Parameters
    ----------
    images
        Video clip; folder of images in the order of their names, for a rig with a folder for each camera; or ROS bag: a
        .bag file of ROS 1, or the folder, .mcap or .db3 file of ROS 2.
    camera
        Calibration file of any format; none is needed for 2:1 equirectangular images.
    rig
        File of a rig, in place of the camera. Its cameras' images of the same name or number were taken together.
    output
        Trajectory to write, world_from_camera (world_from_rig): TUM's format, timestamp tx ty tz qx qy qz qw, or
        KITTI's.
    live
        Follow a connected camera whose number is IMAGES, such as --live 0, until Ctrl-C. It is opened once the code is
        loaded. Frames that arrive while an earlier one is processed are dropped. A clip is played at its rate.
    page
        With --live, show the path, the tracks on the image, and figures in a page for the browser, on this computer
        only.
    """
    from omnisight.cli._files import must_be_writable
    from omnisight.cli._odometry_report import print_json, print_report, print_warnings
    from omnisight.cli._progress import progress
    from omnisight.compilation import compile_in_parallel
    from omnisight.pipeline.odometry.odometry import odometry as run
    from omnisight.visual_odometry.first_run import parts

    if page and not live:
        raise ValueError("--page shows a connected camera: specify --live")
    must_be_writable(output)
    with _keeping_poses(output), compile_in_parallel(parts):
        if live:
            result = _run_live(images, camera, rig, output, options, page)
        else:
            with progress() as report:
                result = run(images, camera, rig, options, output, report)
    if is_json():
        print_json(result)
    if not result:
        raise ValueError(f"{images}: {result.reason}")
    if not is_json():
        print_report(result, output)
    print_warnings(result)


def _run_live(
    source: Path, camera: str | None, rig: Path | None, output: Path, options: OdometryOptions, has_page: bool
) -> "OdometryResult":
    """Follow a connected camera."""
    from omnisight.cli._odometry_live import live_view
    from omnisight.pipeline.odometry.odometry import live_odometry

    if camera is None or rig is not None:
        raise ValueError("--live is for one calibrated camera: specify its file with --camera")
    with live_view(str(source), has_page=has_page) as (watch, progress):
        return live_odometry(str(source), camera, options, output, watch, progress)


@contextmanager
def _keeping_poses(output: Path) -> Generator[None]:
    """State after Ctrl-C where the poses so far are, if there are any."""
    before = output.stat().st_mtime_ns if output.is_file() else None
    try:
        yield
    except KeyboardInterrupt:
        if output.is_file() and output.stat().st_mtime_ns != before:
            print(f"{output} holds the poses so far", file=sys.stderr)
        raise
