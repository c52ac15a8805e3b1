"""Initial camera: a global search over fields of view and projections, without any guess from the user."""

from collections.abc import Iterator

import numpy as np

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.multistart import convert, low_discrepancy
from omnisight.calibration.resection import MAX_COMPARED_PX, reresect, resect, resect_linear_each
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.models import CameraModel, Projector, initial_models
from omnisight.targets.observations import Observations

# Prior of the off-axis angle (radians) of the farthest corner, uniform: from a long lens to the widest fisheye.
MIN_REACH_RAD, MAX_REACH_RAD = np.radians((12.0, 150.0))
# Sampled cameras, and the survivors of the rounds: linear resection; refinement of focal length and centre; of all.
SAMPLES, SURVIVORS = 48, (8, 4, 2)
# Samples whose magnifications differ by less (ratio, natural logarithm) lead to the same minimum.
SAME_MAGNIFICATION = 0.45
# Off-axis angle (radians) at which magnifications are compared: every model can show it.
COMPARED_RAD = 0.3
# Views of the rounds, and corners of the first two. The poses in all other views follow from the camera.
VIEWS, CORNERS = (6, 10, 40), 400


def estimate_initial_camera(observations: Observations) -> State:
    """Estimate a camera and board poses near the global optimum from images of planar boards.

    Cameras are sampled from a prior on the field of view and from the shapes that the models of the initial search
    state; each poses the boards linearly. As in `multistart`, the best half or less is refined by more parameters on
    more views, round by round, until the lowest robust cost decides.

    Parameters
    ----------
    observations
        Corners with boards in their plane z = 0, and the image size.

    Raises
    ------
    ValueError
        If no camera explains the corners.
    """
    if len(observations) > VIEWS[-1]:
        return _resect_all(estimate_initial_camera(_subset(observations, VIEWS[-1])), observations)
    first, second = (_subset(observations, views).thinned(CORNERS) for views in VIEWS[:2])
    states = resect_linear_each(list(_sample_cameras(first)), first)
    states = [_resect_all(state, second) for state in _distinct_magnifications(states, first)[: SURVIVORS[0]]]
    states = [_refine(state, second, 8, 1e-3, shape=False) for state in states]
    states = [_refine(state, second, 15, 1e-4) for state in _by_error(states, second)[: SURVIVORS[1]]]
    states = [_refine(reresect(s, second), second, 15, 1e-4) for s in _by_error(states, second)[: SURVIVORS[2]]]
    if not states:
        raise ValueError("no camera explains these corners: are they corners of one flat board, in order?")
    best = _resect_all(_by_error(states, second)[0], observations)
    best = _refine(reresect(_refine(best, observations, 25, 1e-5), observations), observations, 25, 1e-5)
    # Another model of the initial search may follow this lens more closely, now that the poses are known.
    others = [convert(best, cls, observations) for cls in initial_models() if cls is not type(best.model)]
    ends = [best, *(_refine(other, observations, 25, 1e-5) for other in others if other is not None)]
    return _by_error(ends, observations)[0]


def _sample_cameras(observations: Observations) -> Iterator[CameraModel]:
    """Sample cameras of the initial search: their shape, and the off-axis angle of the farthest corner."""
    centre = (np.array(observations.size, float) - 1) / 2
    radius = float(np.linalg.norm(observations.pixels - centre, axis=1).max())
    shapes = [(cls, shape) for cls in initial_models() for shape in cls.INITIAL_SHAPES]
    for u, v in low_discrepancy(SAMPLES, 2):
        cls, shape = shapes[int(u * len(shapes))]
        reach = MIN_REACH_RAD + v * (MAX_REACH_RAD - MIN_REACH_RAD)
        unit = {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0} | shape
        if (extent := _radius(cls.from_dict(unit), reach)) > 0:
            focal = {"fx": radius / extent, "fy": radius / extent, "cx": float(centre[0]), "cy": float(centre[1])}
            yield cls.from_dict(unit | focal)


def _radius(model: Projector, theta: float) -> float:
    """Return the distance (px) of the image at an off-axis angle (radians) from that of the axis; NaN if not seen."""
    pixels, _ = model.project_numpy(np.array([[0.0, 0.0, 1.0], [np.sin(theta), 0.0, np.cos(theta)]]))
    return float(np.linalg.norm(pixels[1] - pixels[0]))


def _distinct_magnifications(states: list[State], observations: Observations) -> list[State]:
    """Return the states by error without those of nearly the magnification of a better one."""
    kept = list[tuple[float, State]]()
    for state in _by_error(states, observations):
        magnification = np.log(_radius(state.model, COMPARED_RAD))
        if all(abs(magnification - other) > SAME_MAGNIFICATION for other, _ in kept):
            kept.append((magnification, state))
    return [state for _, state in kept]


def _resect_all(state: State, observations: Observations) -> State:
    """Return the camera of a state with poses of all views."""
    assert isinstance(state.model, CameraModel)
    return resect(state.model, observations)


def _refine(state: State, observations: Observations, steps: int, tolerance: float, *, shape: bool = True) -> State:
    """Refine with constant residual weights; without `shape` only focal length and centre of the camera are free."""
    model = state.model
    held = () if shape else [name for name in model.param_names if name not in ("fx", "fy", "cx", "cy")]
    free, weights = FreeParameters.of(model, fixed=held), ResidualWeights.estimate(state, observations)
    return refine(
        state, observations, free_parameters=free, weights=weights, iterations=steps, tolerance=tolerance
    ).state


def _subset(observations: Observations, count: int) -> Observations:
    """Return that many views, evenly spaced, or all if there are fewer."""
    if len(observations) <= count:
        return observations
    return observations.subset(np.linspace(0, len(observations) - 1, count).round().astype(np.intp))


def _by_error(states: list[State], observations: Observations) -> list[State]:
    return sorted(states, key=lambda state: _error(state, observations))


def _error(state: State, observations: Observations) -> float:
    """Return the mean residual length (px), outliers limited."""
    return float(np.minimum(state.lengths(observations), MAX_COMPARED_PX).mean())
