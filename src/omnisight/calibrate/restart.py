"""Going from one camera model to another: several starts where their costs have several valleys."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.refine import Bundle, refine
from omnisight.calibrate.spread import Spread
from omnisight.calibrate.state import State
from omnisight.calibrate.views import BoardViews
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.models import CameraModel, model_class
from omnisight.models._fit import SKETCH
from omnisight.models._fit import refine as fit_from

Array = NDArray[np.float64]

# What a lens has next to nothing of: a start that took it from noise would be a start of its own.
STILL = ("skew", "p1", "p2", "s1", "s2", "s3", "s4")
DECENTRED = set(STILL[1:])
# Models that bend to most lenses in ways of their own: what one of them finds, a richer model may miss from another.
SOURCES = ("kannala_brandt", "eucm", "division")
# What models with another parameter nearly make up for, so that their cost has a valley about several of its values.
TRADED = (-0.3, 0.2, 0.8, 1.4)
MIDDLING = (0.6, 0.72)
# Pairs that are enough to fit a start to.
PAIRS = 600
# That are enough to tell a valley from another.
CORNERS = 1000
# px: a fit to a camera this far from it (rms) is none.
ALIKE = 2.0
# Steps that each start is refined by, and how many of them are then refined further; more where parts are not centred.
ROUNDS, LONG_ROUNDS = ((12, 2), (100, 1)), ((40, 3), (100, 1))
# Angles from the axis, and around it, at which a camera is sampled: a little past the corners, or a fit may fold there.
CONE, PAST = 16, 1.05


def restart(state: State, cls: type[CameraModel], views: BoardViews) -> State | None:
    """Give the state with another camera model, fitted to its own; None where it cannot be.

    A model in which parameters make up for each other has valleys of nearly the same cost. It is refined from a start
    in each, and the one that ends lowest is given as it was: what a calibration holds fixed must not have moved.
    """
    sketch = views.thinned(CORNERS)
    starts = list(_starts(state, cls, sketch))
    if len(starts) < 2:
        return starts[0] if starts else None
    ends = starts
    for iterations, kept in ROUNDS if "xi" in starts[0].model.param_names else LONG_ROUNDS:
        seen = sketch if kept > 1 else views
        ends = [refine(end, seen, iterations=iterations).state for end in ends]
        sharpest = min(ends, key=lambda end: float(np.median(end.lengths(seen))))
        problem = Bundle(seen, Freedom.none(sharpest.model), Spread.of(sharpest, seen))
        order = np.argsort([problem.cost(end) for end in ends], kind="stable")[:kept]
        starts, ends = [starts[i] for i in order], [ends[i] for i in order]
    return starts[0]


def _starts(state: State, cls: type[CameraModel], views: BoardViews) -> Iterator[State]:
    """Give starts of the model, each in a valley that may be another."""
    first = fitted(state, cls, views)
    if first is None:
        return
    yield first
    names = set(first.model.param_names)
    if "xi" in names and Freedom.of(first.model).count > 5:
        yield from _traded(first, state, views)
    elif DECENTRED & names:
        yield _centred(first, views)
        for name in SOURCES:
            source = fitted(state, model_class(name), views)
            source = None if source is None else fitted(refine(source, views).state, cls, views)
            if source is not None:
                yield source
                yield _centred(source, views)


def fitted(state: State, cls: type[CameraModel], views: BoardViews) -> State | None:
    """Give the state with another camera model, fitted to its own; None where it cannot be."""
    points, pixels = pairs(state, views)
    every = -(-len(points) // PAIRS)
    try:
        return replace(state, model=cls.fit(points[::every], pixels[::every], fixed=STILL))
    except (ValueError, np.linalg.LinAlgError):
        return None


def _centred(start: State, views: BoardViews) -> State:
    """Refine it as a lens whose parts are centred."""
    return refine(start, views, freedom=Freedom.of(start.model, fixed=STILL)).state


def _traded(start: State, state: State, views: BoardViews) -> Iterator[State]:
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
    for xi in TRADED:
        # On the axis all such models magnify by f/(1 + xi).
        scale = (1 + xi) / (1 + values["xi"])
        moved = values | {"xi": xi, "fx": values["fx"] * scale, "fy": values["fy"] * scale}
        begun = [moved | {"alpha": alpha} for alpha in alphas] if "alpha" in values else [moved]
        yield from _near(begun, (*STILL, "xi"), start, points, pixels)


def _near(
    begun: list[dict[str, float]], still: tuple[str, ...], start: State, points: Array, pixels: Array
) -> Iterator[State]:
    """Give the start with the best fit that begins from one of several cameras, if it is one."""
    fits = [fit_from(start.model.from_dict(values), points, pixels, still, iterations=20) for values in begun]
    model, cost = min(fits, key=lambda found: found[1])
    if cost < 0.5 * len(points) * ALIKE**2:
        yield replace(start, model=model)


def pairs(state: State, views: BoardViews, *, inwards: bool = False) -> tuple[Array, Array]:
    """Give directions (M, 3), the corners' and all others between them, and their pixels in the state's camera.

    `inwards` those within the corners too, which the state's camera only guesses.

    What another camera is fitted to: a rich one fitted to the corners themselves would start from their noise, and
    bend as it likes where there are none.
    """
    points, _ = state.points(views)
    angles = angle_from_axis(points)
    nearest = 0.0 if inwards else angles.min(initial=np.pi) / PAST
    farthest = min(PAST * angles.max(initial=0.0), np.pi)
    theta = nearest + (np.arange(CONE) + 0.5)[:, None] / CONE * (farthest - nearest)
    phi = np.linspace(0, 2 * np.pi, CONE, endpoint=False)
    points = np.concatenate([points, polar(*np.broadcast_arrays(theta, phi)).reshape(-1, 3)])
    pixels, valid = state.model.project_numpy(points)
    return points[valid], pixels[valid]
