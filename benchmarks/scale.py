"""Time and memory of reconstructions of 100 to 10,000 images: what they cost, and where the mapper stops scaling.

`python -m benchmarks scale` prints the tables of docs/guide/reconstruct.md. The images are 360 images along a drive
through a large town, see `benchmarks.scale_images`; their pairs are selected by retrieval. Each reconstruction runs in
a process of its own. The exponent of a stage is that of a power law between a row and the one before.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.own_process import run_module
from benchmarks.scale_images import IMAGES_OF_DRIVE, render

COUNTS = (100, 300, 1000, 3000, 10_000)
STAGES = ("keypoints", "selecting pairs", "matching", "mapping", "covariances")


class Cost(NamedTuple):
    """What a number of images takes: stages, seconds; the time, seconds, and the peak memory, MB."""

    images: int
    stages: dict[str, float]
    seconds: float
    megabytes: float

    def exponents(self, before: "Cost") -> list[str]:
        """Return the exponents of the stages, of the time and of the memory."""
        pairs = [(self.stages.get(name, 0.0), before.stages.get(name, 0.0)) for name in STAGES]
        pairs += [(self.seconds, before.seconds), (self.megabytes, before.megabytes)]
        step = np.log(self.images / before.images)
        return [f"{np.log(now / then) / step:.2f}" if now and then else "" for now, then in pairs]


def run(count: int, width: int, per_visit: int) -> tuple[Cost, list[str]]:
    """Reconstruct the first images; return the cost, and the numbers and errors of the result."""
    render(count, width, per_visit)
    rows = run_module("benchmarks.scale_reconstruction", [str(count), str(width), str(per_visit)])
    stages = {" ".join(row[2:]): float(row[1]) for row in rows if row[0] == "stage"}
    registered, correct, points, observations, *values = next(row[1:] for row in rows if row[0] == "result")
    position, rotation, seconds, megabytes = map(float, values)
    numbers = [f"{registered} of {count}", correct, points, observations]
    return Cost(count, stages, seconds, megabytes), [*numbers, f"{100 * position:.4f} %", f"{rotation:.4f}°"]


def main(arguments: Sequence[str]) -> None:
    """Print a row for each number of images, and the exponents."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks scale", description=__doc__)
    parser.add_argument("--counts", nargs="+", type=int, default=COUNTS, help="numbers of images")
    parser.add_argument("--width", type=int, default=320, help="width of the images, px")
    parser.add_argument(
        "--per-visit", type=int, default=IMAGES_OF_DRIVE, help="images of new streets, before they are visited again"
    )
    options = parser.parse_args(arguments)
    results = ["registered", "correct", "points", "observations", "position", "rotation"]
    costs = [*(f"{name} s" for name in STAGES), "time s", "memory MB"]
    print("| images | " + " | ".join([*results, *costs]) + " |\n" + "|---" * (1 + len(results) + len(costs)) + "|")
    before = None
    for count in options.counts:
        cost, numbers = run(count, options.width, options.per_visit)
        values = [*(cost.stages.get(name, 0.0) for name in STAGES), cost.seconds, cost.megabytes]
        print(f"| {count} | " + " | ".join([*numbers, *(f"{value:.0f}" for value in values)]) + " |", flush=True)
        if before is not None:
            empty = [""] * len(results)
            print("| exponent | " + " | ".join([*empty, *cost.exponents(before)]) + " |", flush=True)
        before = cost


if __name__ == "__main__":
    main(sys.argv[1:])
