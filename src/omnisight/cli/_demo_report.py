"""Report of `omnisight demo`."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from omnisight.cli._output import elapsed, write_json
from omnisight.cli._reconstruct_report import print_report as print_reconstruction
from omnisight.cli._reconstruct_report import summary
from omnisight.pipeline.demos.demo import IMAGE_COUNT, DemoResult
from omnisight.pipeline.demos.demo_map import DemoMap


def print_report(results: Sequence[DemoResult], output: Path) -> None:
    """Print the calibrations, their errors, and what to try next."""
    for result in results:
        print(f"{result.name:<8}  board detected in {result.detected} of {IMAGE_COUNT} images")
        print(f"          {result.calibration!r}")
        print(f"          bearing error {result.mean_error_deg:.3f}° on average, {result.max_error_deg:.3f}° at most")
        print(f"written   {result.folder}/: images/, truth.json, camera.json, {', '.join(result.views)}")
    fisheye, mirror = output / "fisheye", output / "mirror"
    print(f"\n{elapsed():.0f} s. Look at {mirror / 'cylinder.jpg'}, then try:\n")
    print(f"  omnisight calibrate {fisheye}/images --pattern 8x5 --square 40mm -o camera.json")
    print(f"  omnisight view {fisheye}/room.jpg --camera {fisheye}/camera.json --yaw 45 -o right.jpg")
    camera = f"--camera {mirror}/camera.json --up back --flip"
    print(f"  omnisight view {mirror}/room.jpg {camera} --to cylinder -o around.jpg")


def print_json(results: Sequence[DemoResult]) -> None:
    """Print the files, the cameras and their errors as one JSON object."""
    cameras = {
        result.name: {
            "model": result.calibration.camera.model.name,
            "size": list(result.calibration.camera.size),
            "detected": result.detected,
            "images": IMAGE_COUNT,
            "rms": result.calibration.rms,
            "verdict": str(result.calibration.verdict),
            "mean_error_deg": result.mean_error_deg,
            "max_error_deg": result.max_error_deg,
        }
        for result in results
    }
    files = [result.folder / name for result in results for name in ("truth.json", "camera.json", *result.views)]
    data = {"files": [str(file) for file in files], "cameras": cameras, "seconds": round(elapsed(), 3)}
    write_json(data)


def print_map_report(demonstration: DemoMap, output: Path) -> None:
    """Print the reconstruction, its error, and what to try next."""
    print_reconstruction(demonstration.result, output)
    error = f"{1000 * demonstration.median_error_m:.2f} mm (median) after a similarity transform"
    print(f"positions   error {error}, on a path of {demonstration.path_m:.1f} m")
    command = shlex.join(["omnisight", "export", str(output), "--to", "splat", "--images", str(demonstration.images)])
    print(f"\nOpen the viewer in a browser, or export the model:\n\n  {command} -o splat/")


def print_map_json(demonstration: DemoMap, output: Path) -> None:
    """Print the reconstruction and its error as one JSON object."""
    data = {
        "output": str(output),
        "viewer": str(output / "viewer.html"),
        "median_error_m": demonstration.median_error_m,
        "path_m": demonstration.path_m,
        "reconstruction": summary(demonstration.result),
        "seconds": round(elapsed(), 3),
    }
    write_json(data)
