"""Multistart search: starts sampled from the priors of a model's parameters, successive halving, refinement.

Models whose parameters nearly compensate each other have several local minima. Starts are drawn from the priors that
the parameters of the model state (`Parameter`), from a low-discrepancy sequence: every run draws the same. All
are refined by a few steps on a few corners; the better half is refined by more steps on more corners, and so on; the
survivors in distinct local minima are refined on all corners, and the one of the lowest robust cost is kept. Jamieson
and Talwalkar, Non-stochastic best arm identification and hyperparameter optimization (successive halving), AISTATS
2016.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import MAX_ITERATIONS, Bundle, refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import has_pose_outlier, reresect, resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.models import CameraModel, Projector, model_class
from omnisight.models._camera_model import VariantFit
from omnisight.models._fit import refine as refine_on_pairs
from omnisight.optim.tolerances import COARSE_TOLERANCE, COMPARISON_TOLERANCE
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Starts drawn from the priors: a whole level (2^4 - 1) of the low-discrepancy sequence.
SAMPLES = 15
# The first primes, one for each drawn parameter of a model.
HALTON_BASES = (2, 3, 5, 7, 11, 13, 17, 19)
# (corners, Levenberg-Marquardt steps) of the rounds, after each of which half of the starts remain.
ROUNDS = ((300, 10), (600, 12), (1000, 40))
# Distinct local minima that are refined on all corners.
SURVIVORS = 3
# Bearing-pixel pairs of the initial camera that a model, and a drawn start, are fitted to.
FIT_PAIRS, SAMPLE_PAIRS = 600, 250
# Steps of the fit of a drawn start: it only has to reach the valley of its sample.
SAMPLE_STEPS = 20
# Rms difference (px) from the initial camera above which a drawn start is rejected.
MAX_START_RMS_PX = 4.0
# Cameras whose focal lengths and principal points differ by less (px) are in the same local minimum.
SAME_MINIMUM_PX = 1.0
# A state whose median residual exceeds the lowest by this factor, and px, fits the inliers worse, whatever its cost.
MAX_MEDIAN_RATIO, MEDIAN_MARGIN_PX = 2.0, 1e-3
# Starts drawn from the posterior of an optimum at the edge of its domain, where steps end at a kink of the cost, and
# the steps after which only the lowest ones are refined further.
POSTERIOR_SAMPLES, POSTERIOR_STEPS = 8, 10
# Angles from the axis, and around it, at which the initial camera is sampled, and how far past the corners: a model
# fitted to less could fold right outside them.
GRID, MARGIN = 16, 1.05
# Corners that begin farther from the axis (radians) leave the image centre unobserved, as a mirror does; the second
# fit then covers the cone from the axis on, or this factor past the corners.
BLIND_RAD, EXTRAPOLATION = np.radians(20), 1.3


class Start(NamedTuple):
    """An initial state, and the parameters held at their sample in the first round, while the poses adapt."""

    state: State
    held: tuple[str, ...] = ()


def model_starts(
    name: str, initial: State, observations: Observations, *, fixed: Sequence[str] = ()
) -> list[tuple[str, State]]:
    """Find the best start of every variant of a camera model, given an initial camera.

    Parameters
    ----------
    name
        The camera model.
    initial
        An initial camera of any model, with board poses.
    observations
        Board points and pixels.
    fixed
        Names of parameters that keep the value of the initial camera, or of the first fit.

    Returns
    -------
    list of (label, State)
        One per variant; empty if the model cannot represent the initial camera.
    """
    cls, found, simpler = model_class(name), list[tuple[str, State]](), [initial]
    for label, fit in cls.variants(len(observations.pixels)).items():
        starts = list(_sample_starts(cls, fit, initial, observations, fixed))
        if not starts:
            continue
        first = starts[0].state.model
        starts += [Start(start) for state in simpler if (start := _nested(state, first)) is not None]
        reference = initial.model if isinstance(initial.model, cls) else first
        starts = [start._replace(state=_with_fixed(start.state, fixed, reference)) for start in starts]
        weights = ResidualWeights.estimate(initial, observations)
        best = starts[0].state if len(starts) == 1 else _search(starts, observations, fixed, weights)
        found.append((label, best))
        simpler = [initial, best]
    return found


def _search(
    starts: Sequence[Start], observations: Observations, fixed: Sequence[str], weights: ResidualWeights
) -> State:
    """Return the state of the lowest robust cost that successive halving reaches from the starts."""
    free = FreeParameters.of(starts[0].state.model, fixed=fixed)
    finalists = _halve(starts, observations, fixed, weights)
    best = lowest_cost([_refine(state, observations, free) for state in finalists], observations)
    if not best.model.near_folds and not np.isnan(best.residuals(observations)).any():
        return best
    samples = [_refine(s, observations, free, POSTERIOR_STEPS) for s in _sample_posterior(best, free, observations)]
    lowest = _by_cost(samples, observations)[:SURVIVORS]
    return lowest_cost([best, *(_refine(state, observations, free) for state in lowest)], observations)


def _halve(
    starts: Sequence[Start], observations: Observations, fixed: Sequence[str], weights: ResidualWeights
) -> list[State]:
    """Return the states in distinct local minima that survive the rounds of successive halving."""
    cost = Bundle(observations, FreeParameters.of(starts[0].state.model, fixed=fixed), weights).cost
    best_start = min((start.state for start in starts), key=cost)
    states, held = [start.state for start in starts], [start.held for start in starts]
    for corners, steps in ROUNDS:
        subset = observations.thinned(corners)
        free = [FreeParameters.of(s.model, fixed=(*fixed, *names)) for s, names in zip(states, held, strict=True)]
        refined = [_refine(s, subset, f, steps) for s, f in zip(states, free, strict=True)]
        states = _distinct_minima(refined, subset)[: max(-(-len(states) // 2), SURVIVORS)]
        held = [()] * len(states)
        if len(states) <= SURVIVORS:
            break
    states = [reresect(s, observations) if has_pose_outlier(s, observations) else s for s in states[:SURVIVORS]]
    # Outliers among the corners of a subset can lead all survivors astray.
    return [*states, best_start] if cost(best_start) < min(map(cost, states)) else states


def _refine(state: State, observations: Observations, free: FreeParameters, steps: int = MAX_ITERATIONS) -> State:
    return refine(state, observations, free_parameters=free, iterations=steps, tolerance=COMPARISON_TOLERANCE).state


def lowest_cost(states: Sequence[State], observations: Observations) -> State:
    """Return the state of the lowest robust cost."""
    return _by_cost(states, observations)[0]


def _by_cost(states: Sequence[State], observations: Observations) -> list[State]:
    """Sort states by robust cost, with the residual weights of the one with the lowest median residual."""
    medians = [float(np.median(state.lengths(observations))) for state in states]
    sharpest = states[int(np.argmin(medians))]
    weights = ResidualWeights.estimate(sharpest, observations)
    cost = Bundle(observations, FreeParameters.of(sharpest.model), weights).cost  # free: the barrier counts
    limit = MAX_MEDIAN_RATIO * min(medians) + MEDIAN_MARGIN_PX
    keys = [(median > limit, cost(state)) for median, state in zip(medians, states, strict=True)]
    return [states[i] for i in sorted(range(len(states)), key=keys.__getitem__)]


def _distinct_minima(states: Sequence[State], observations: Observations) -> list[State]:
    """Return the states by cost without those in the local minimum of a better one."""
    kept = list[State]()
    for state in _by_cost(states, observations):
        camera = state.model.params[:4]
        if all(np.abs(camera - other.model.params[:4]).max() > SAME_MINIMUM_PX for other in kept):
            kept.append(state)
    return kept


def _sample_posterior(state: State, free: FreeParameters, observations: Observations) -> Iterator[State]:
    """Draw cameras from the Gaussian posterior of an optimum and pose all boards anew."""
    bundle = Bundle(observations, free, ResidualWeights.estimate(state, observations))
    model, root = state.model, bundle.weights.sigma * free.directions @ bundle.linearize(state).half_covariance()
    assert isinstance(model, CameraModel)
    for sample in np.random.default_rng(0).normal(size=(POSTERIOR_SAMPLES, root.shape[1])):
        yield resect(model.with_params(np.clip(model.params + root @ sample, *model.bounds)), observations)


def _sample_starts(
    cls: type[CameraModel], fit: VariantFit, initial: State, observations: Observations, fixed: Sequence[str]
) -> Iterator[Start]:
    """Yield starts of a model: fitted to the initial camera, as its truncated series, and at samples of its priors."""
    parameters = cls.example().parameters
    zero = tuple(p.name for p in parameters if p.start_zero)
    constant = (*(p.name for p in parameters if not p.free), *zero)
    bearings, pixels = _thinned(*sample_camera(initial, observations), FIT_PAIRS)
    try:
        known = type(initial.model) is cls and fit == cls.fit  # a variant is another model: refit it
        first = initial.central_model if known else fit(bearings, pixels, fixed=constant)
    except (ValueError, np.linalg.LinAlgError):
        return
    yield Start(replace(initial, model=first))
    if zero:
        yield Start(replace(initial, model=first), zero)
    if cls.needs_axis and angle_from_axis(initial.points(observations)[0]).min(initial=np.pi) > BLIND_RAD:
        for from_axis, margin in ((True, MARGIN), (False, EXTRAPOLATION)):
            samples = sample_camera(initial, observations, from_axis=from_axis, margin=margin)
            model = fit(*_thinned(*samples, FIT_PAIRS), fixed=constant)
            yield Start(replace(initial, model=model))
    series = [p.name for p in parameters if p.truncated_start]
    for terms in range(1, len(series)):
        held = (*zero, *series[terms:])
        yield Start(replace(initial, model=fit(bearings, pixels, fixed=(*constant, *held))), held)
    bearings, pixels = _thinned(bearings, pixels, SAMPLE_PAIRS)
    for sample, held in _draw(first, fixed):
        start = (sample, bearings, pixels, (*constant, *held))
        model, cost = refine_on_pairs(*start, iterations=SAMPLE_STEPS, tolerance=COARSE_TOLERANCE)
        if cost < 0.5 * len(pixels) * MAX_START_RMS_PX**2:
            yield Start(replace(initial, model=model), held)


def _draw(model: CameraModel, fixed: Sequence[str]) -> Iterator[tuple[CameraModel, tuple[str, ...]]]:
    """Draw cameras from the priors of the parameters of a model, with the magnification of the model on its axis.

    Yields each with the names of the parameters drawn about the value of the model: they are held at first.
    """
    drawn = [(i, p) for i, p in enumerate(model.parameters) if p.name not in fixed and (p.start_scale or p.start_range)]
    held = tuple(p.name for _, p in drawn if p.start_scale)
    if not drawn:
        return
    low, high = model.bounds
    for point in low_discrepancy(SAMPLES, len(drawn)):
        params = model.params.copy()
        for (i, p), u in zip(drawn, point, strict=True):
            quantile = params[i] + p.start_scale * np.tan(np.pi * (u - 0.5))  # Cauchy: most are near, some far
            params[i] = quantile if p.start_range is None else np.interp(u, (0, 1), p.start_range)
        sample = model.with_params(np.clip(params, low, high))
        scale = _axis_magnification(model) / _axis_magnification(sample)
        yield sample.with_values({n: v * scale for n, v in sample.to_dict().items() if n in ("fx", "fy")}), held


def low_discrepancy(count: int, dimensions: int) -> Array:
    """Return the first points (count, dimensions) of the Halton sequence after the origin; up to eight dimensions."""
    assert dimensions <= len(HALTON_BASES)
    points = np.zeros((count, dimensions))
    for column, base in enumerate(HALTON_BASES[:dimensions]):
        index, place = np.arange(1, count + 1), 1.0
        while index.any():  # the digits of the index, mirrored at the point
            place /= base
            points[:, column] += place * (index % base)
            index //= base
    return points


def _axis_magnification(model: CameraModel) -> float:
    """Return the distance (px) between the images of the axis and of a bearing 1 mrad beside it."""
    pixels, _ = model.project_numpy(np.array([[0.0, 0.0, 1.0], [1e-3, 0.0, 1.0]]))
    return float(pixels[1, 0] - pixels[0, 0])


def _nested(simpler: State, model: Projector) -> State | None:
    """Return a camera as a richer model whose other parameters are 0; None if that is another camera."""
    known, names = simpler.model.to_dict(), model.param_names
    if not set(known) < set(names):
        return None
    richer = type(model).from_dict({name: known.get(name, 0.0) for name in names})
    bearings = polar(np.linspace(0.1, 1.0, GRID), np.linspace(0, 2 * np.pi, GRID))
    same = (m.project_numpy(bearings)[0] for m in (richer, simpler.model))
    return replace(simpler, model=richer) if np.allclose(*same, rtol=0, atol=1e-6, equal_nan=True) else None


def _with_fixed(state: State, names: Sequence[str], reference: Projector) -> State:
    """Return the state with the parameters of those names as in the reference."""
    values = reference.to_dict()
    return replace(state, model=state.model.with_values({name: values[name] for name in names if name in values}))


def convert(state: State, cls: type[CameraModel], observations: Observations) -> State | None:
    """Return the state with its camera fitted by another model; None if that cannot represent it."""
    if type(state.model) is cls:
        return state
    constant = [p.name for p in cls.example().parameters if p.start_zero or not p.free]
    try:
        model = cls.fit(*_thinned(*sample_camera(state, observations), FIT_PAIRS), fixed=constant)
    except (ValueError, np.linalg.LinAlgError):
        return None
    return replace(state, model=model)


def sample_camera(
    state: State, observations: Observations, *, from_axis: bool = False, margin: float = MARGIN
) -> tuple[Array, Array]:
    """Sample a camera at the corners and on a grid over the cone they cover; a fit to it is free of corner noise.

    Parameters
    ----------
    state
        Camera and poses.
    observations
        The corners.
    from_axis
        Extend the cone to the axis also where no corner lies near it.
    margin
        Factor by which the cone exceeds the angles of the corners.

    Returns
    -------
    bearings, pixels
        (M, 3) directions and (M, 2) their pixels in the camera.
    """
    points, _ = state.points(observations)
    angles = angle_from_axis(points)
    nearest = 0.0 if from_axis else angles.min(initial=np.pi) / margin
    farthest = min(margin * angles.max(initial=0.0), np.pi)
    theta = nearest + (np.arange(GRID) + 0.5)[:, None] / GRID * (farthest - nearest)
    phi = np.linspace(0, 2 * np.pi, GRID, endpoint=False)
    bearings = np.concatenate([points, polar(*np.broadcast_arrays(theta, phi)).reshape(-1, 3)])
    pixels, valid = state.model.project_numpy(bearings)
    return bearings[valid], pixels[valid]


def _thinned(bearings: Array, pixels: Array, count: int) -> tuple[Array, Array]:
    """Return about that many pairs, evenly spaced, and the outermost one: it bounds the domain of a spline."""
    every = -(-len(bearings) // count)
    rows = np.union1d(np.arange(0, len(bearings), every), angle_from_axis(bearings).argmax())
    return bearings[rows], pixels[rows]
