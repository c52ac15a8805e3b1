"""omnisight demo."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress


def demo(output: Annotated[Path, Parameter(alias="-o")] = Path("omnisight-demo"), *, map: bool = False) -> None:
    """Render, calibrate and unroll a fisheye and a mirror camera, in half a minute and without a real camera.

    The images are rendered, so the results are compared with the true cameras and poses.

    Parameters
    ----------
    output
        Folder for images, cameras and views; created if needed.
    map
        Instead, reconstruct 40 images of a walk through a room, and write the model and its viewer.
    """
    if map:
        _demo_map(output / "map")
        return
    from omnisight.cli._demo_report import print_json, print_report
    from omnisight.pipeline.demos.demo import demo as run

    with progress() as report:
        results = run(output, progress=report)
    if is_json():
        print_json(results)
    else:
        print_report(results, output)


def _demo_map(output: Path) -> None:
    """Reconstruct rendered images, and print the accuracy and the viewer."""
    from omnisight.cli._demo_report import print_map_json, print_map_report
    from omnisight.pipeline.demos.demo_map import demo_map
    from omnisight.reconstructions import write_reconstruction
    from omnisight.report.viewer import write_viewer

    with progress() as report:
        demonstration = demo_map(output, progress=report)
    write_reconstruction(output, demonstration.result.models[0])
    write_viewer(output / "viewer.html", demonstration.result.models[0], demonstration.images)
    (print_map_json if is_json() else print_map_report)(demonstration, output)
