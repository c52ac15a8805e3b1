"""Simulated images of straight lines in cameras of known parameters."""

import numpy as np

from omnisight.calibration.lines import LineObservations, PixelChains
from omnisight.models.unified import Unified
from omnisight.pipeline.calibration.calibrate_lines import CalibrateLinesOptions, calibrate_lines

SIZE = (1280, 1024)
PARABOLIC = Unified(300.0, 300.0, 652.0, 498.0, 1.0)
HYPERBOLIC = Unified(330.0, 330.0, 640.0, 512.0, 0.85)


def line_images(model, count, noise=0.0, seed=0, pixels=80, radii=(100, 480)):
    """Return noisy pixels along images of straight lines, each 40 to 110 degrees long, and the plane normals."""
    rng = np.random.default_rng(seed)
    arcs, normals = [], []
    while len(arcs) < count:
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        across = np.linalg.svd(n[None])[2][1:]
        start = rng.uniform(0, 2 * np.pi)
        turn = np.linspace(start, start + np.radians(rng.uniform(40, 110)), pixels)[:, None]
        seen, valid = model.project_numpy(np.cos(turn) * across[0] + np.sin(turn) * across[1])
        away = np.linalg.norm(seen - (model.cx, model.cy), axis=1)
        if valid.all() and away.max() < radii[1] and away.min() > radii[0]:
            arcs.append(seen + noise * rng.normal(size=seen.shape))
            normals.append(n)
    return arcs, np.array(normals)


def calibrate_drawn(arcs, border_centre=None, size=SIZE, **options):
    """Calibrate from arcs (n, 2) that are all images of lines."""
    observations = LineObservations(PixelChains.from_arrays(arcs), size, border_centre, all_inliers=True)
    return calibrate_lines(observations, CalibrateLinesOptions(**options))


def calibrate_arcs(chains, size=SIZE, border_centre=None):
    """Calibrate from arcs some of which are not images of lines."""
    return calibrate_lines(LineObservations(chains, size, border_centre))
