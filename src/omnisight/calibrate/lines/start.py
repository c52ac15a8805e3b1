"""Finding a camera to start from, with nothing known but pixels of lines, some of which may be no lines."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.lines.chains import Chains
from omnisight.calibrate.lines.circles import Circle, fit_circle, parabolic_camera
from omnisight.calibrate.lines.plumb import lines_of
from omnisight.models import CameraModel
from omnisight.models.unified import Unified

Array = NDArray[np.float64]

# The unified model from nearly a pinhole to past the parabola, where the lenses are.
XIS = (0.5, 0.8, 1.0, 1.4, 2.0)
# The angle from the axis at which the farthest pixel may lie.
REACH_DEG = (35, 50, 65, 80, 95, 110, 130)
# Where the centre may lie, as shares of the picture's half height from where it is expected.
SHIFTS = ((0.0, 0.0), (-0.12, 0.0), (0.12, 0.0), (0.0, -0.12), (0.0, 0.12))
TRIPLES = 60
# Chains with arcs so plain that their circle tells of the camera.
CURVED = 30
PIXELS = 10
# Past this distance (px) a chain is no line of the camera at all.
MISS = 3.0


def starts(
    chains: Chains, size: tuple[int, int], centre: Array, *, known: Mapping[str, float], seed: int = 0
) -> list[Unified]:
    """Give cameras that may explain many of the chains, the likeliest first.

    Tried are all cameras of a grid over xi, the field of view and the centre, and the parabolic cameras that circles
    determine: of all chains together, and of triples drawn at random (Fischler and Bolles, RANSAC, 1981). The algebra
    of the general case is not used: it needs conics, which short arcs do not determine.

    Parameters
    ----------
    chains
        Images of lines, and others.
    size
        (width, height) px.
    centre
        (2,) where the principal point is expected: the middle of what the mirror or lens shows.
    known
        Parameters that are known, by name.
    seed
        Of the random triples.
    """
    few = chains.thinned(PIXELS)
    weight = np.minimum(chains.spans, 0.5 * min(size))
    guessed = [*_grid(chains, size, centre), *_parabolic(chains, size, centre, np.random.default_rng(seed))]
    tried = [camera.with_values(known) for camera in guessed]
    scores = np.array([_score(camera, few, weight) for camera in tried])
    return [tried[i] for i in np.argsort(scores, kind="stable")]


def chain_rms(distances: Array, chains: Chains) -> Array:
    """Give the root mean square distance (L,) of each chain's pixels from its line, px."""
    return np.sqrt(chains.sums(distances**2) / np.maximum(chains.counts, 1))


def _score(camera: Unified, chains: Chains, weight: Array) -> float:
    """Give what the camera leaves unexplained: the squared distances, bounded, of chains weighted by their length."""
    state = lines_of(camera, chains, steps=0)
    rms = chain_rms(state.distances(chains), chains)
    return float((weight * np.minimum(rms / MISS, 1.0) ** 2).sum())


def _grid(chains: Chains, size: tuple[int, int], centre: Array) -> Iterator[Unified]:
    reach = float(np.linalg.norm(chains.pixels - centre, axis=1).max())
    half = 0.5 * min(size)
    for xi in XIS:
        for theta in np.radians(REACH_DEG):
            # cos(theta) + 1/xi, or + xi, is positive inside the domain, with some room at its rim.
            if np.cos(theta) <= -min(xi, 1 / xi) + 0.05:
                continue
            focal = reach * (np.cos(theta) + xi) / np.sin(theta)
            for du, dv in SHIFTS:
                yield Unified(focal, focal, centre[0] + du * half, centre[1] + dv * half, xi)


def _parabolic(chains: Chains, size: tuple[int, int], centre: Array, rng: np.random.Generator) -> Iterator[Unified]:
    """Give the parabolic cameras that circles determine, all of the longest or three of them."""
    longest = np.argsort(-chains.spans, kind="stable")[:CURVED]
    circles: list[Circle] = [fit_circle(chains.pixels[chains.groups[i]]) for i in longest]
    if len(circles) < 3:
        return
    triples = [rng.choice(len(circles), 3, replace=False) for _ in range(TRIPLES if len(circles) > 3 else 1)]
    for chosen in [np.arange(len(circles)), *triples]:
        camera = parabolic_camera([circles[i] for i in chosen])
        if camera is not None and plausible(camera, size, centre):
            yield camera


def plausible(camera: CameraModel, size: tuple[int, int], centre: Array) -> bool:
    """Say whether a centre lies near where it is expected, and a focal length is one of a wide lens or mirror."""
    values = camera.to_dict()
    half = 0.5 * min(size)
    aside = np.hypot(values["cx"] - centre[0], values["cy"] - centre[1])
    return bool(aside < 0.4 * half and 0.1 * half < values["fx"] < 8 * half)
