"""Going from one camera model to another: several starts where their costs have several valleys."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle, refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import has_pose_outlier, reresect, resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.models import CameraModel
from omnisight.models._fit import SKETCH
from omnisight.models._fit import refine as fit_from
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# What a lens has next to nothing of: a start that took it from noise would be a start of its own.
STILL = ("skew", "p1", "p2", "s1", "s2", "s3", "s4")
DECENTRED = set(STILL[1:])
# What bends a profile beside its first terms: terms that nearly make up for each other.
HIGHER = ("k2", "k3", "k4", "k5", "k6"), ("k3", "k4", "k5", "k6"), ("k3", "k6")
# What models with another parameter nearly make up for, so that their cost has a valley about several of its values.
TRADED = (-0.3, 0.2, 0.8, 1.4, 4.0)
# Where fewer of these are near: how far beside that of the first start.
FEW, BESIDE = 3, (-0.08, -0.04, 0.04, 0.08)
MIDDLING = (0.6, 0.72)
# Pairs that are enough to fit a start to.
PAIRS = 600
# That are enough to tell a valley from another.
CORNERS = 1000
# px: a fit to a camera this far from it (rms) is none.
ALIKE = 4.0
# px: cameras whose focal lengths and centres differ by less have ended in one valley.
SAME = 1.0
# An end from which half the corners are so many times as far as from the sharpest, and px more, has left them.
BLURRED, EXACT = 2.0, 1e-3
# Steps at a time that each start is refined by on some of the corners, and how many of them, in valleys of their own,
# are then refined on all: where parts are traded for each other, and where parts are not centred.
TRADED_EFFORT, DECENTRED_EFFORT = (12, 3), (40, 5)
# Starts drawn about an end that may be held at a kink.
DRAWS = 8
# Share of the cost that steps must gain. Wrong corners may be nearly all of it: little tells valleys apart.
TOLERANCE = 1e-8
# Angles from the axis, and around it, at which a camera is sampled: a little past the corners, or a fit may fold there.
CONE, PAST = 16, 1.05


def multistart_refit(
    state: State, cls: type[CameraModel], views: Observations, *, fixed: Sequence[str] = ()
) -> State | None:
    """Give the state with another camera model, fitted to its own; None where it cannot be.

    A model in which parameters make up for each other has valleys of nearly the same cost. It is refined from a start
    in each, then from some about the lowest end where that may be held, and the lowest end of all is given. `fixed`
    parameters stay as they are, or were first fitted.
    """
    sketch = views.thinned(CORNERS)
    first = state if type(state.model) is cls else fitted(state, cls, sketch)
    if first is None:
        return None
    freedom, names, centred = FreeParameters.of(first.model, fixed=fixed), set(first.model.param_names), None
    if "xi" in names and FreeParameters.of(first.model).count > 5:
        starts, effort = [first, *_traded(first, state, sketch)], TRADED_EFFORT
    elif DECENTRED & names:
        centred = refine(first, sketch, freedom=FreeParameters.of(first.model, fixed=(*STILL, *fixed))).state
        starts, effort = [first, centred, *_plainer(first, state, sketch)], DECENTRED_EFFORT
    else:
        return first
    starts = [replace(start, model=holding(start.model, fixed, first.model)) for start in starts]
    ends = _floors(starts, sketch, Bundle(views, freedom, ResidualWeights.of(state, views)), *effort)
    if centred is not None:
        other = _decentred_the_other_way(lowest(ends, views), centred, fixed)
        ends.append(refine(other, views, freedom=freedom, tolerance=TOLERANCE).state)
    best = lowest(ends, views)
    # Where a rim or a fold runs among corners, costs have kinks at which steps end.
    if not best.model.near_folds and not np.isnan(best.residuals(views)).any():
        return best
    drawn = _drawn(best, freedom, views)
    return lowest([best, *(refine(start, views, freedom=freedom, tolerance=TOLERANCE).state for start in drawn)], views)


def _floors(starts: Sequence[State], sketch: Observations, whole: Bundle, iterations: int, valleys: int) -> list[State]:
    """Refine starts by so many steps at a time on some of the corners, and the lowest valleys to the end on all."""
    views, freedom = whole.views, whole.freedom
    ends = [
        refine(start, sketch, freedom=freedom, iterations=iterations, tolerance=TOLERANCE).state for start in starts
    ]
    # A rich model may have left the corners that the sketch has not, and not come back to them.
    costs = [whole.cost(start) for start in starts]
    kept = [(starts[i], ends[i], costs[i]) for i in _in_valleys_of_their_own(ends, sketch)[:valleys]]
    ends = [start if whole.cost(end) > cost + whole.scale else end for start, end, cost in kept]
    # A board that was resect wrongly on the way costs more than valleys differ by.
    ends = [reresect(end, views) if has_pose_outlier(end, views) else end for end in ends]
    # Wrong corners of the sketch may have led all of them has_pose_outlier.
    if min(costs) < min(map(whole.cost, ends)):
        ends.append(starts[int(np.argmin(costs))])
    return [refine(end, views, freedom=freedom, tolerance=TOLERANCE).state for end in ends]


def holding(model: CameraModel, names: Sequence[str], like: CameraModel) -> CameraModel:
    """Give the camera with the parameters of those names as another has them."""
    return model.with_values({name: value for name, value in like.to_dict().items() if name in names})


def lowest(ends: Sequence[State], views: Observations) -> State:
    """Give the state of the least cost."""
    return ends[_by_cost(ends, views)[0]]


def _by_cost(ends: Sequence[State], views: Observations) -> list[int]:
    """Give the places of the states, the one of the least cost first; corners count as at the sharpest."""
    middling = [float(np.median(end.lengths(views))) for end in ends]
    sharpest = ends[int(np.argmin(middling))]
    cost = Bundle(views, FreeParameters.of(sharpest.model), ResidualWeights.of(sharpest, views)).cost  # walls count
    # Where good corners cost next to nothing, wrong ones may cost more than leaving all the good ones saves.
    left = [median > BLURRED * min(middling) + EXACT for median in middling]
    return sorted(range(len(ends)), key=[*zip(left, map(cost, ends), strict=True)].__getitem__)


def _in_valleys_of_their_own(ends: Sequence[State], views: Observations) -> list[int]:
    """Give the places of those of the states that end in a valley of their own, lowest first."""
    kept = list[int]()
    for i in _by_cost(ends, views):
        shape = ends[i].model.params[:4]
        if all(np.abs(shape - ends[other].model.params[:4]).max() > SAME for other in kept):
            kept.append(i)
    return kept


def _plainer(start: State, state: State, views: Observations) -> Iterator[State]:
    """Give starts without decentring and without the higher terms, which the lower ones nearly make up for."""
    names = start.model.param_names
    for higher in dict.fromkeys(tuple(name for name in several if name in names) for several in HIGHER):
        still = *STILL, *higher
        if (plain := fitted(state, type(start.model), views, fixed=still)) is not None:
            yield refine(plain, views, freedom=FreeParameters.of(plain.model, fixed=still)).state


def _drawn(end: State, freedom: FreeParameters, views: Observations) -> Iterator[State]:
    """Give starts drawn from how sure a camera is of itself, boards resect anew."""
    bundle = Bundle(views, freedom, ResidualWeights.of(end, views))
    half = bundle.spread.sigma * freedom.directions @ bundle.linearize(end).half_covariance()
    for draw in np.random.default_rng(0).normal(size=(DRAWS, half.shape[1])):
        yield resect(end.model.with_params(np.clip(end.model.params + half @ draw, *end.model.bounds)), views)


def _decentred_the_other_way(end: State, centred: State, fixed: Sequence[str]) -> State:
    """Give a start on the other side of a camera without decentring from where one with it has ended.

    What its profile lacks, a frame that is tilted against the lens makes up for in part: this way, or the other way.
    """
    values, middle = end.model.to_dict(), centred.model.to_dict()
    moved = {name: 2 * middle[name] - values[name] for name in ("cx", "cy", *STILL[1:]) if name in values}
    return replace(centred, model=end.model.with_values({n: v for n, v in moved.items() if n not in fixed}))


def fitted(
    state: State, cls: type[CameraModel], views: Observations, *, fixed: tuple[str, ...] = STILL
) -> State | None:
    """Give the state with another camera model, fitted to its own; None where it cannot be."""
    points, pixels = pairs(state, views)
    every = -(-len(points) // PAIRS)
    try:
        return replace(state, model=cls.fit(points[::every], pixels[::every], fixed=fixed))
    except (ValueError, np.linalg.LinAlgError):
        return None


def _traded(start: State, state: State, views: Observations) -> Iterator[State]:
    """Give starts with other distances of the second viewpoint, as far as the other parameters make up for them."""
    points, pixels = pairs(state, views)
    every = -(-len(points) // SKETCH)
    points, pixels = points[::every], pixels[::every]
    values, known = start.model.to_dict(), state.model.to_dict()
    # The state's own camera, where this model is that one and more.
    own = {name: known.get(name, 0.0) for name in values}
    if set(known) < set(values):
        yield from _near([own], STILL, start, points, pixels)
    # The double sphere's alpha as well: what is past its rim tells a fit nothing.
    alphas = {values.get("alpha", 0.0), *MIDDLING}

    def away(xi: float) -> Iterator[State]:
        # On the axis all such models magnify by f/(1 + xi).
        scale = (1 + xi) / (1 + values["xi"])
        moved = values | {"xi": xi, "fx": values["fx"] * scale, "fy": values["fy"] * scale}
        begun = [moved | {"alpha": alpha} for alpha in alphas] if "alpha" in values else [moved]
        return _near(begun, (*STILL, "xi"), start, points, pixels)

    far = [found for xi in TRADED for found in away(xi)]
    yield from far
    if len(far) < FEW:  # the widest lenses leave little room for it
        for by in BESIDE:
            yield from away(values["xi"] + by)


def _near(
    begun: list[dict[str, float]], still: tuple[str, ...], start: State, points: Array, pixels: Array
) -> Iterator[State]:
    """Give the start with the best fit that begins from one of several cameras, if it is one."""
    fits = [
        fit_from(start.model.from_dict(values), points, pixels, still, iterations=20, tolerance=1e-6)
        for values in begun
    ]
    model, cost = min(fits, key=lambda found: found[1])
    if cost < 0.5 * len(points) * ALIKE**2:
        yield replace(start, model=model)


def pairs(state: State, views: Observations, *, inwards: bool = False, past: float = PAST) -> tuple[Array, Array]:
    """Give directions (M, 3), the corners' and all others between them, and their pixels in the state's camera.

    Up to so many times the corners' angle; `inwards` those within the corners too, which the state's camera only
    guesses.

    What another camera is fitted to: a rich one fitted to the corners themselves would start from their noise, and
    bend as it likes where there are none.
    """
    points, _ = state.points(views)
    angles = angle_from_axis(points)
    nearest = 0.0 if inwards else angles.min(initial=np.pi) / past
    farthest = min(past * angles.max(initial=0.0), np.pi)
    theta = nearest + (np.arange(CONE) + 0.5)[:, None] / CONE * (farthest - nearest)
    phi = np.linspace(0, 2 * np.pi, CONE, endpoint=False)
    points = np.concatenate([points, polar(*np.broadcast_arrays(theta, phi)).reshape(-1, 3)])
    pixels, valid = state.model.project_numpy(points)
    return points[valid], pixels[valid]
