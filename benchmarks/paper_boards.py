"""Recognition and estimation of sheets that bend differently in each image: `python -m benchmarks paper_boards`.

Four cameras are calibrated from simulated images of a sheet that is bent to another cylinder in each image, by a height
of 0 to 5 % of its width. The lengths within the sheet do not change. The table states how often the verdict names the
cause, the error of the camera (px rms over the calibrated field of view, after the best rotation, in an image 1000 px
wide) and its ratio to the stated uncertainty.
"""

import argparse
import warnings
import zlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from benchmarks.convergence_scenes import Array
from benchmarks.model_choice import CAMERAS, NOISE_PX, Trial, scene
from benchmarks.verdict import Run, judged, over
from benchmarks.verdict_scenes import Case, GroundTruth
from omnisight.pipeline.calibration.calibrate import calibrate
from omnisight.quality.evidence import Level
from omnisight.targets.observations import Observations

# Height of the edges over the middle of the sheet, relative to its width.
HEIGHTS = (0.0, 0.002, 0.01, 0.02, 0.05)
TILT_DEG = 25.0


def run(name: str, seed: int, height: float) -> Run:
    """Calibrate from images of a sheet bent by up to this height and compare the camera with the truth."""
    truth, observations = bent_scene(name, seed, height)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return judged(Case(f"{name}/{height:g}", seed), NOISE_PX, truth, calibrate(observations))


def bent_scene(name: str, seed: int, height: float) -> tuple[GroundTruth, Observations]:
    """Simulate the corners of a sheet with a bend of its own in each image; deterministic."""
    rng = np.random.default_rng(zlib.crc32(f"{name}/{seed}/{height}".encode()))
    return scene(Trial(name, TILT_DEG, seed), lambda points: bent(points, height * rng.uniform(-1, 1), rng))


def bent(points: Array, height: float, rng: np.random.Generator) -> Array:
    """Return points (N, 3) of a flat sheet, centred on the origin, on a cylinder of a random direction.

    The edges are higher than the middle by `height` times the width.
    """
    width, phi = float(np.ptp(points[:, 0])), rng.uniform(0, np.pi)
    curvature = 8 * height / width
    across = np.array([np.cos(phi), np.sin(phi), 0.0])
    arc = points @ across
    if not curvature:
        return points
    moved = (np.sin(curvature * arc) / curvature - arc)[:, None] * across
    return points + moved + ((1 - np.cos(curvature * arc)) / curvature)[:, None] * (0.0, 0.0, 1.0)


def table(runs: Sequence[Run]) -> str:
    """Return the rate of recognition and the errors by height."""
    lines = [
        "| bend | sets | recognized | good, usable, do not use | error, px: median, worst | true/stated: median, 95 % |"
    ]
    lines += ["|---" * 6 + "|"]
    for height in dict.fromkeys(r.case.kind.split("/")[1] for r in runs):
        part = [r for r in runs if r.case.kind.split("/")[1] == height]
        named = np.mean(["board bend" in r.noted for r in part])
        levels = ", ".join(str(sum(r.level == level for r in part)) for level in Level)
        errors, ratios = [r.cone.rms for r in part], np.quantile([over(r.cone) for r in part], (0.5, 0.95))
        lines.append(
            f"| {100 * float(height):g} % | {len(part)} | {100 * named:.0f} % | {levels} | {np.median(errors):.2f},"
            f" {np.max(errors):.2f} | {ratios[0]:.2f}, {ratios[1]:.2f} |"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Calibrate the sets and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks paper_boards", description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="number of sets of each camera and height")
    parser.add_argument("--heights", type=float, nargs="*", default=HEIGHTS, help="relative to the width")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    chosen = parser.parse_args(arguments)
    sets = [(name, seed, height) for height in chosen.heights for seed in range(chosen.seeds) for name in CAMERAS]
    runs = list[Run]()
    with ProcessPoolExecutor(chosen.workers) as pool:
        for done in pool.map(run, *zip(*sets, strict=True)):
            runs.append(done)
            print(done, flush=True)
    print(table(runs))


if __name__ == "__main__":
    main()
