"""Calibrating from lines: how its errors grow with noise, and fall with the number of lines.

`python -m benchmarks.lines [trials]` prints the first tables of docs/guide/lines.md; with `rendered` in place of the
number how true calibrations of rendered images are, with `real` how lines compare with boards on real images, with
`shapes` what real cameras take from the scale.
"""

import sys

import numpy as np

from benchmarks import lines_real, lines_rendered
from omnisight.calibration.lines import Chains, apart, bearing_deviation, calibrate_lines
from omnisight.models.unified import Unified

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
    """See lines in general position: 40 to 120 degrees of great circles, between 100 and 480 px from the centre."""
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
    """Give errors of xi, focal length (%), centre (px) and bearings (degrees, rms), and what is stated of these."""
    arcs = line_images(truth, count, noise, np.random.default_rng(seed))
    try:
        found = calibrate_lines(Chains.of(arcs), SIZE, known=known, trusted=True)
    except ValueError:  # no camera found: as wrong as can be
        return [np.inf] * 5
    model = found.camera.model
    values = model.to_dict()
    return [
        abs(values["xi"] - truth.xi),
        100 * abs(values["fx"] / truth.fx - 1),
        float(np.hypot(values["cx"] - truth.cx, values["cy"] - truth.cy)),
        float(np.degrees(apart(model, truth, np.concatenate(arcs)))),
        # The camera is of this shape exactly: nothing is to be said of others.
        float(np.degrees(bearing_deviation(model, found.uncertainty.covariance, np.concatenate(arcs)))),
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
