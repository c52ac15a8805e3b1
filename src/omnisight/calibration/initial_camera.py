"""Finding a camera to start from, with no guess of focal length or field of view and no pinhole plane."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.multistart import STILL, fitted
from omnisight.calibration.resection import reresect, resect, resect_linear, resolve_flip
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.models import model_class
from omnisight.targets.observations import Observations

# Ideal projections, and the angle from the axis that the farthest corner may be at; below, they are all alike.
FAMILIES = ("equidistant", "equisolid", "stereographic")
REACH_DEG = (50, 65, 80, 95, 110, 130, 150)
NARROW_DEG = {"equidistant": (16, 28), "pinhole": (28, 42, 58)}
# Starts whose focal lengths differ by less than this share have come from one place.
APART = 0.45
# Models that together bend to every lens and mirror with few parameters.
SCOUTS = ("kannala_brandt", "unified")
SETTLED, SCOUTED = 6, 2
# Images that are enough to tell a good start from a bad one, and to find the camera; the others are resect from it.
SKETCH, CORNERS, ENOUGH = 10, 400, 40


def estimate_initial_camera(views: Observations, size: tuple[int, int]) -> State:
    """Find a camera and board poses near the best, for images of plane boards.

    Every ideal projection is tried with every field of view: each poses some of the boards from bearings. The few that
    explain the corners best, each of a focal length of its own, are refined, first as they are, then as models that
    bend to any lens. The best by robust cost is kept.

    Parameters
    ----------
    views
        The corners; boards in their plane z = 0.
    size
        (width, height) of the images, px.

    Raises
    ------
    ValueError
        If no start poses the boards.
    """
    if len(views) > ENOUGH:
        return resect(estimate_initial_camera(_some(views, ENOUGH), size).model, views)
    sketch = _some(views, SKETCH).thinned(CORNERS)
    begun = _unlike(_ideal_starts(sketch, size), sketch)
    settled = [_settled(resolve_flip(start, sketch), sketch, 8, 1e-3) for start in begun[:SETTLED]]
    scouts = list[State]()
    names: tuple[str, ...] = SCOUTS
    for start in sorted(settled, key=lambda state: _score(state, sketch))[:SCOUTED]:
        scouts += [scout for name in names if (scout := _scout(start, name, sketch)) is not None]
        if scouts:  # the other bends less well to this lens
            names = (min(scouts, key=lambda state: _score(state, sketch)).model.name,)
    if not scouts:
        raise ValueError("no camera explains these corners: are they corners of one flat board, in order?")
    best = min(scouts, key=lambda state: _score(state, sketch))
    best = _settled(reresect(_settled(resect(best.model, views), views, 25, 1e-5), views), views, 25, 1e-5)
    # The other may follow this lens more closely, now that the boards are in their places.
    (other,) = (name for name in SCOUTS if name != best.model.name)
    ends = [best]
    if (again := fitted(best, model_class(other), views)) is not None:
        ends.append(_settled(again, views, 25, 1e-5))
    return min(ends, key=lambda end: _score(end, views))


def _scout(start: State, name: str, views: Observations) -> State | None:
    """Refine the start as a model that bends to more lenses, with all boards resect anew on the way."""
    lengths = start.lengths(views)
    good = lengths <= max(4 * float(np.median(lengths)), 1e-3)
    try:
        model = model_class(name).fit(start.points(views)[0][good], views.pixels[good], fixed=STILL)
    except (ValueError, np.linalg.LinAlgError):
        return None
    rough = _settled(replace(start, model=model), views, 15, 1e-4)
    return _settled(reresect(rough, views), views, 15, 1e-4)


def _ideal_starts(views: Observations, size: tuple[int, int]) -> Iterator[State]:
    centre = (np.array(size, float) - 1) / 2
    reach = np.linalg.norm(views.pixels - centre, axis=1).max()
    narrow = [(name, degrees) for name, angles in NARROW_DEG.items() for degrees in angles]
    for name, degrees in [*narrow, *itertools.product(FAMILIES, REACH_DEG)]:
        plain = model_class(name).from_dict({"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0})
        theta = np.radians(degrees)
        radius, _ = plain.project_numpy(np.array([[np.sin(theta), 0.0, np.cos(theta)]]))
        focal = reach / radius[0, 0]
        camera = {"fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1]}
        yield resect_linear(type(plain).from_dict(camera), views)


def _unlike(starts: Iterable[State], views: Observations) -> list[State]:
    """Give those of the starts, best first, that have no better one with nearly the same focal length."""
    kept = list[State]()
    for start in sorted(starts, key=lambda start: _score(start, views)):
        focal = start.model.params[0]
        if all(abs(np.log(focal / better.model.params[0])) > APART for better in kept):
            kept.append(start)
    return kept


def _settled(state: State, views: Observations, iterations: int, tolerance: float) -> State:
    """Refine with the corners counting as they do at the state."""
    spread = ResidualWeights.of(state, views)
    return refine(state, views, spread=spread, iterations=iterations, tolerance=tolerance).state


def _some(views: Observations, count: int) -> Observations:
    """Give that many of the views, or all if there are fewer."""
    if len(views) <= count:
        return views
    return views.subset(np.linspace(0, len(views) - 1, count).round().astype(np.intp))


def _score(state: State, views: Observations) -> float:
    return float(np.minimum(state.lengths(views), 50.0).mean())
