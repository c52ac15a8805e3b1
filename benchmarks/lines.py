"""Accuracy of the calibration from lines against noise and the number of lines.

`python -m benchmarks.lines [trials]` prints the first tables of docs/guide/lines.md. With `rendered` instead of the
number it evaluates rendered images, with `real` it compares lines with boards on real images, and with `shapes` it
measures the scale error for real cameras.
"""

import sys

import numpy as np

from benchmarks import lines_real, lines_rendered
from omnisight.calibration.lines import LineObservations, PixelChains, bearing_difference, bearing_sigma
from omnisight.models.unified import Unified
from omnisight.pipeline.calibration.calibrate_lines import CalibrateLinesOptions, calibrate_lines

SIZE = (1280, 1024)
MIRRORS = {
    "parabolic mirror, xi = 1 known": (Unified(300.0, 300.0, 652.0, 498.0, 1.0), {"xi": 1.0}),
    "parabolic mirror, xi estimated": (Unified(300.0, 300.0, 652.0, 498.0, 1.0), {}),
    "hyperbolic mirror, xi = 0.85 estimated": (Unified(300.0, 300.0, 652.0, 498.0, 0.85), {}),
}
NOISES = (0.0, 0.5, 1.0, 2.0, 3.0)
COUNTS = (3, 5, 7, 10)
PIXELS = 100


def line_images(model: Unified, count: int, noise: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Project lines in general position: 40 to 120 degrees of great circles, between 100 and 480 px from the centre."""
    arcs: list[np.ndarray] = []
    while len(arcs) < count:
        normal = rng.normal(size=3)
        across = np.linalg.svd(normal[None])[2][1:]
        start = rng.uniform(0, 2 * np.pi)
        turn = np.linspace(start, start + np.radians(rng.uniform(40, 120)), PIXELS)[:, None]
        pixels, valid = model.project_numpy(np.cos(turn) * across[0] + np.sin(turn) * across[1])
        away = np.linalg.norm(pixels - (model.cx, model.cy), axis=1)
        if valid.all() and away.max() < 480 and away.min() > 100:
            arcs.append(pixels + noise * rng.normal(size=pixels.shape))
    return arcs


def errors(truth: Unified, known: dict[str, float], count: int, noise: float, seed: int) -> list[float]:
    """Return errors of xi, focal length (%), centre (px) and bearings (degrees, rms), and the stated bearing error."""
    arcs = line_images(truth, count, noise, np.random.default_rng(seed))
    try:
        observations = LineObservations(PixelChains.from_arrays(arcs), SIZE, all_inliers=True)
        found = calibrate_lines(observations, CalibrateLinesOptions(fixed=known))
    except ValueError:  # no camera was estimated
        return [np.inf] * 5
    model = found.camera.model
    values = model.to_dict()
    return [
        abs(values["xi"] - truth.xi),
        100 * abs(values["fx"] / truth.fx - 1),
        float(np.hypot(values["cx"] - truth.cx, values["cy"] - truth.cy)),
        float(np.degrees(bearing_difference(model, truth, np.concatenate(arcs)))),
        # The camera follows the unified model exactly, so the scale uncertainty does not apply.
        float(np.degrees(bearing_sigma(model, found.uncertainty.covariance, np.concatenate(arcs)))),
    ]


def main(trials: int) -> None:
    for name, (truth, known) in MIRRORS.items():
        print(f"\n{name}: median errors over {trials} trials, {PIXELS} pixels per line\n")
        print("| noise px | lines | xi | focal % | centre px | bearing deg | stated deg |")
        print("|---|---|---|---|---|---|---|")
        for noise in NOISES:
            for count in COUNTS:
                seeds = range(trials if noise else 1)
                median = np.median([errors(truth, known, count, noise, seed) for seed in seeds], axis=0)
                xi, focal, centre, bearing, stated = median
                print(f"| {noise:g} | {count} | {xi:.3f} | {focal:.2f} | {centre:.2f} | {bearing:.2f} | {stated:.2f} |")


if __name__ == "__main__":
    what, *rest = sys.argv[1:] or ["6"]
    if what == "real":
        lines_real.report(rest)
    elif what == "rendered":
        lines_rendered.report(rest)
    elif what == "shapes":
        lines_real.report_shapes(rest)
    else:
        main(int(what))
