"""omnisight stereo."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.two_views.two_view_options import StereoOptions

GROUP = "Geometry"


def stereo(
    left: Path,
    right: Path,
    /,
    *,
    rig: Path,
    options: Annotated[StereoOptions, Parameter(name="*")] = StereoOptions(),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    steps: float = 1000.0,
    ply: Path | None = None,
    preview: Path | None = None,
    rectified: Path | None = None,
) -> None:
    """Compute distances from two simultaneous images of a rig, whose cameras may be of any central model.

    Distances are along the bearings of the left camera from its centre, in the pixels of the left image and in the
    unit of the rig. Pixels without a distance are 0 in a 16-bit image, NaN in an array, and absent in a point cloud.

    Parameters
    ----------
    left
        Image of the left camera, or of any other camera of the rig.
    right
        Image of the right camera, taken at the same time.
    rig
        File of the rig: omnisight's JSON or a Kalibr camchain.
    output
        Distances to write: a 16-bit .png or .tif, a float32 .npy, or an .npz with distance and sigma.
    steps
        Steps of a 16-bit image per unit of the rig; 65535 steps are the largest distance.
    ply
        Coloured point cloud to write, in the frame of the left camera.
    preview
        Drawing of the distances to write.
    rectified
        Drawing of the rectified images to write, side by side, with lines along rows.
    """
    from omnisight.cli._files import must_be_writable, must_be_writable_image
    from omnisight.cli._stereo_report import print_json, print_report, print_warnings
    from omnisight.images import write_image
    from omnisight.images.output_paths import refuse_overwrite
    from omnisight.pipeline.two_views.stereo import stereo as run
    from omnisight.pipeline.two_views.stereo_files import check_distance_suffix, write_distances, write_ply
    from omnisight.report.drawings.stereo import draw_distances, draw_rectified

    if not steps > 0:
        raise ValueError(f"--steps must be positive, got {steps:g}")
    files = [path for path in (output, ply, preview, rectified) if path is not None]
    for path in files:
        (must_be_writable_image if path in (preview, rectified) else must_be_writable)(path)
    for k, path in enumerate(files):
        if path.resolve() in {other.resolve() for other in files[:k]}:
            raise ValueError(f"{path}: is specified for two outputs, and one would replace the other: use two files")
    if output is not None:
        check_distance_suffix(output)
    inputs = (left, right, rig, options.mask_left, options.mask_right)
    refuse_overwrite(files, [path for path in inputs if path is not None])
    result = run(left, right, rig, options)
    too_far = 0
    if result and output is not None:
        too_far = write_distances(output, result.distance, result.sigma, steps)
    if result and ply is not None:
        write_ply(ply, *result.points())
    if result and preview is not None:
        write_image(preview, draw_distances(result))
    if result and rectified is not None:
        write_image(rectified, draw_rectified(result))
    if is_json():
        print_json(result, steps)
    if not result:
        raise ValueError(f"{left}, {right}: {result.reason}")
    print_warnings(result, too_far, steps)
    if not is_json():
        print_report(result, files, output, steps)
