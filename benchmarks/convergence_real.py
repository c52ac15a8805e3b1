"""Real corners: does every model that `auto` tries stay where it is when it is started again from elsewhere?"""

from collections.abc import Iterator

import numpy as np

from benchmarks.solvers_corners import corner_sets
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.multistart import model_starts
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import auto_models
from omnisight.targets.observations import Observations

RESTARTS = 4


def restarts(found: State, views: Observations, size: tuple[int, int], rng: np.random.Generator) -> Iterator[State]:
    """Yield states away from the optimum: a perturbed one, and a camera calibrated on half of the images."""
    for _ in range(RESTARTS):
        params = found.model.params.copy()
        names = found.model.param_names
        stretch = 1 + rng.uniform(-0.1, 0.1)
        for i, name in enumerate(names):
            if name in ("fx", "fy"):
                params[i] *= stretch
            elif name in ("cx", "cy"):
                params[i] += rng.uniform(-0.03, 0.03) * size[0]
            elif name[0] == "a" and name[1:].isdigit():
                params[i] *= stretch ** (1 - int(name[1:]))
        shaken = so3.exp(rng.normal(0, np.radians(3), (len(views), 3))) @ found.rotations
        moved = found.translations * (1 + rng.normal(0, 0.05, (len(views), 1)))
        yield State(found.model.with_params(params), shaken, moved)
    half = np.arange(len(views))[:: 2 if len(views) > 7 else 1]
    start = resect(estimate_initial_camera(views.subset(half)).model, views)
    yield from (state for name, state in model_starts(found.model.name, start, views))


def table() -> str:
    """Calibrate every set as every model and from every restart, and say how many of the restarts are better."""
    lines = ["| set | model | rms, px | restarts | better by, of the good corners' cost |", "|---|---|---|---|---|"]
    for name, views, size in ((corners.name, corners.views, corners.size) for corners in corner_sets()):
        rng = np.random.default_rng(0)
        start = estimate_initial_camera(views)
        models = auto_models(float(angle_from_axis(start.points(views)[0]).max()))
        for key, begun in (found for model in models for found in model_starts(model, start, views)):
            found = Candidate.fit(key, begun, views, FreeParameters.of(begun.model), loss="huber")
            weights = ResidualWeights.estimate(found.state, views)
            good = ~weights.outliers(found.state, views)
            unit = float((0.5 * found.state.lengths(views)[good] ** 2).sum())
            others = list[float]()
            for state in restarts(found.state, views, size, rng):
                if state.model.params.shape == begun.model.params.shape:
                    other = Candidate.fit(key, state, views, FreeParameters.of(state.model), loss="huber").state
                    others.append(_cost(other, views, weights.threshold))
            better = (_cost(found.state, views, weights.threshold) - min(others)) / unit
            equal = sum(o <= _cost(found.state, views, weights.threshold) + 1e-3 * unit for o in others)
            lines.append(f"| {name} | {key} | {found.rms:.4f} | {equal}/{len(others)} reach it | {better:.2g} |")
            print(lines[-1], flush=True)
    return "\n" + "\n".join(lines)


def _cost(state: State, views: Observations, threshold: float) -> float:
    lengths = state.lengths(views)
    inside = np.minimum(lengths, threshold)
    return float((inside * (lengths - 0.5 * inside)).sum())
