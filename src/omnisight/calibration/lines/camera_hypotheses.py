"""Camera hypotheses for the line consensus: a parameter grid, and parabolic cameras from sampled circles."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.lines.line_conics import MIN_CIRCLES, fit_circle, parabolic_camera
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.plumb_line import fit_line_planes
from omnisight.models import CameraModel
from omnisight.models.unified import Unified

Array = NDArray[np.float64]

# Grid of the unified model: xi from a nearly perspective camera past the parabolic mirror to common fisheye lenses,
# the angle off-axis of the farthest pixel, and shifts of the centre in half image heights.
XI_GRID = (0.5, 0.8, 1.0, 1.4, 2.0)
MAX_THETA_GRID_DEG = (35, 50, 65, 80, 95, 110, 130)
CENTRE_SHIFT_GRID = ((0.0, 0.0), (-0.12, 0.0), (0.12, 0.0), (0.0, -0.12), (0.0, 0.12))
# Random triples of circles, drawn from the longest arcs, whose circles are the best determined.
TRIPLES, CIRCLE_POOL = 60, 30
# Pixels per arc that hypotheses are scored with: an arc constrains five parameters at most.
SCORING_PIXELS = 10
# Distance (px) at which the truncated cost of an arc saturates: such an arc is not a line for this camera.
OUTLIER_PX = 3.0
# Plausible principal points and focal lengths of wide-angle cameras, in half image heights.
MAX_CENTRE_SHIFT, FOCAL_RANGE = 0.4, (0.1, 8.0)


def rank_hypotheses(
    arcs: PixelChains, size: tuple[int, int], centre: Array, *, fixed: Mapping[str, float], seed: int = 0
) -> list[Unified]:
    """Generate camera hypotheses and return them in order of increasing truncated plumb-line cost.

    Hypotheses are a grid over xi, the field of view and the centre, and the parabolic cameras that circles determine:
    all long arcs together, and random triples (RANSAC: Fischler and Bolles 1981). General conics are not used because
    short arcs do not determine them.

    Parameters
    ----------
    arcs
        Detected arcs, images of lines and others.
    size
        (width, height) px.
    centre
        (2,) expected principal point.
    fixed
        Known parameters by name.
    seed
        Seed of the random triples.
    """
    samples = arcs.subsample(SCORING_PIXELS)
    weight = np.minimum(arcs.arc_lengths, 0.5 * min(size))
    rng = np.random.default_rng(seed)
    hypotheses = [*_grid_hypotheses(arcs, size, centre), *_parabolic_hypotheses(arcs, size, centre, rng)]
    cameras = [camera.with_values(fixed) for camera in hypotheses]
    costs = np.array([_score(camera, samples, weight) for camera in cameras])
    return [cameras[i] for i in np.argsort(costs, kind="stable")]


def truncated_cost(distances: Array, arcs: PixelChains, weight: Array, outlier_px: float) -> float:
    """Return the weighted sum of squared rms distances of the arcs, each truncated at `outlier_px` and scaled to 1."""
    return float((weight * np.minimum(arcs.rms_by_chain(distances) / outlier_px, 1.0) ** 2).sum())


def is_plausible(camera: CameraModel, size: tuple[int, int], centre: Array) -> bool:
    """Return whether the principal point and the focal length are those of a wide-angle camera."""
    values = camera.to_dict()
    half = 0.5 * min(size)
    shift = np.hypot(values["cx"] - centre[0], values["cy"] - centre[1])
    low, high = FOCAL_RANGE
    return bool(shift < MAX_CENTRE_SHIFT * half and low * half < values["fx"] < high * half)


def _score(camera: Unified, arcs: PixelChains, weight: Array) -> float:
    """Return the truncated cost of the arcs for a camera."""
    state = fit_line_planes(camera, arcs, refinement_steps=0)
    return truncated_cost(state.distances(arcs), arcs, weight, OUTLIER_PX)


def _grid_hypotheses(arcs: PixelChains, size: tuple[int, int], centre: Array) -> Iterator[Unified]:
    """Yield the cameras of the grid."""
    max_radius = float(np.linalg.norm(arcs.pixels - centre, axis=1).max())
    half = 0.5 * min(size)
    for xi in XI_GRID:
        for theta in np.radians(MAX_THETA_GRID_DEG):
            # The model's domain is cos(theta) > -min(xi, 1/xi); the projection diverges at its edge.
            if np.cos(theta) <= -min(xi, 1 / xi) + 0.05:
                continue
            focal = max_radius * (np.cos(theta) + xi) / np.sin(theta)
            for du, dv in CENTRE_SHIFT_GRID:
                yield Unified(focal, focal, centre[0] + du * half, centre[1] + dv * half, xi)


def _parabolic_hypotheses(
    arcs: PixelChains, size: tuple[int, int], centre: Array, rng: np.random.Generator
) -> Iterator[Unified]:
    """Yield the plausible parabolic cameras of the longest arcs and of random triples of them."""
    circles = [fit_circle(arcs.pixels[arcs.groups[i]]) for i in arcs.longest_first()[:CIRCLE_POOL]]
    if len(circles) < MIN_CIRCLES:
        return
    draws = TRIPLES if len(circles) > MIN_CIRCLES else 1
    triples = [rng.choice(len(circles), MIN_CIRCLES, replace=False) for _ in range(draws)]
    for sample in [np.arange(len(circles)), *triples]:
        camera = parabolic_camera([circles[i] for i in sample])
        if camera is not None and is_plausible(camera, size, centre):
            yield camera
