"""omnisight demo."""

import time
from pathlib import Path

from omnisight.cli._progress import progress


def demo(output: Path = Path("omnisight-demo"), *, map: bool = False, quiet: bool = False) -> None:
    """Render, calibrate and unroll a fisheye and a mirror camera, in half a minute and without a real camera.

    The images are rendered, so the results are compared with the true cameras and poses.

    Parameters
    ----------
    output
        Folder for images, cameras and views; created if needed.
    map
        Instead, reconstruct 40 images of a walk through a room, and write the model and its viewer.
    quiet
        Show no progress.
    """
    if map:
        _demo_map(output / "map", quiet)
        return
    start = time.perf_counter()
    from omnisight.pipeline.demo import IMAGE_COUNT
    from omnisight.pipeline.demo import demo as run_demo

    with progress(quiet) as report:
        results = run_demo(output, progress=report)
    for result in results:
        print(f"{result.name:<8}  board detected in {result.detected} of {IMAGE_COUNT} images")
        print(f"          {result.calibration!r}")
        print(f"          bearing error {result.mean_error_deg:.3f}° on average, {result.max_error_deg:.3f}° at most")
        print(f"written   {result.folder}/: images/, truth.json, camera.json, {', '.join(result.views)}")
    fisheye, mirror = output / "fisheye", output / "mirror"
    print(f"\n{time.perf_counter() - start:.0f} s. Look at {mirror / 'cylinder.jpg'}, then try:\n")
    print(f"  omnisight calibrate {fisheye}/images --pattern 8x5 --square 40mm -o camera.json")
    print(f"  omnisight view {fisheye}/room.jpg --camera {fisheye}/camera.json --yaw 45 -o right.jpg")
    camera = f"--camera {mirror}/camera.json --up back --flip"
    print(f"  omnisight view {mirror}/room.jpg {camera} --to cylinder -o around.jpg")


def _demo_map(output: Path, quiet: bool) -> None:
    """Reconstruct rendered images, and print the accuracy and the viewer."""
    from omnisight.cli._reconstruct_report import print_report
    from omnisight.pipeline.demo_map import demo_map
    from omnisight.reconstructions import write_reconstruction
    from omnisight.report import write_viewer

    with progress(quiet) as report:
        demonstration = demo_map(output, progress=report)
    write_reconstruction(output, demonstration.result.models[0])
    write_viewer(output / "viewer.html", demonstration.result.models[0], demonstration.images)
    print_report(demonstration.result, output)
    error = f"{1000 * demonstration.median_error_m:.2f} mm (median) after a similarity transform"
    print(f"positions   error {error}, on a path of {demonstration.path_m:.1f} m")
    print(f"\nOpen the viewer in a browser, or export the model:\n\n  omnisight export {output} --to splat -o splat/")
