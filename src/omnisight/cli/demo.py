"""omnisight demo."""

import time
from pathlib import Path

from omnisight.cli._progress import progress


def demo(output: Path = Path("omnisight-demo"), *, quiet: bool = False) -> None:
    """Render, calibrate and unroll a fisheye and a mirror camera, in half a minute and without a real camera.

    The images are rendered, so the calibration is compared with the true camera.

    Parameters
    ----------
    output
        Folder for images, cameras and views; created if needed.
    quiet
        Show no progress.
    """
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
