"""Camera models to begin a calibration from, of a state that is known roughly."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.multistart import holding, lowest, multistart_refit, pairs
from omnisight.calibration.state import State
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import model_class
from omnisight.models.ocam import Ocam
from omnisight.models.spline import Spline
from omnisight.targets.observations import Observations

OCAM_DEGREES = (3, 4, 5, 6)
# Spans of the spline's profile; corners from which on its correction has 5x5 cells, not 3x3.
SPANS, MANY = 10, 800
# Share of the cost that steps must gain where polynomials are compared.
ROUGHLY = 1e-5
# Angle from the axis (radians) within which a polynomial is any, if no corner lies there.
UNSEEN = np.radians(20)
# Times the corners' angle that a polynomial is fitted over so that it does not fold just past them.
FURTHER = 1.3


def model_starts(name: str, start: State, views: Observations, *, fixed: Sequence[str] = ()) -> list[tuple[str, State]]:
    """Give the camera model of that name fitted to the start's directions; the polynomial in each of its degrees."""
    if name == "spline":
        return [(name, spline_start(start, views))]
    if name != "ocam":
        state = multistart_refit(start, model_class(name), views, fixed=fixed)
        return [] if state is None else [(name, state)]
    # What no corner shows of the middle leaves several valleys.
    several = float(angle_from_axis(start.points(views)[0]).min(initial=np.pi)) > UNSEEN
    shown = [pairs(start, views)]
    if several:
        shown += [pairs(start, views, inwards=True), pairs(start, views, past=FURTHER)]
    states = list[State]()
    for degree, *models in zip(
        OCAM_DEGREES, *(Ocam.starts_of_degrees(*seen, OCAM_DEGREES) for seen in shown), strict=True
    ):
        fresh = [dataclasses.replace(start, model=holding(model, fixed, start.model)) for model in models]
        states.append(_polynomial_start(degree, fresh, states[-1] if states else None, views, fixed))
    return [(f"ocam degree {degree}", state) for degree, state in zip(OCAM_DEGREES, states, strict=True)]


def _polynomial_start(
    degree: int,
    fresh: Sequence[State],
    lower: State | None,
    views: Observations,
    fixed: Sequence[str],
) -> State:
    """Give the lowest end of polynomials fitted to a start and of what one degree less found."""
    starts = list(fresh)
    if lower is not None:
        starts.append(dataclasses.replace(lower, model=Ocam.from_dict(lower.model.to_dict() | {f"a{degree}": 0.0})))
    # Only their floors tell valleys apart.
    freedom = FreeParameters.of(starts[0].model, fixed=fixed)
    ends = [refine(start, views, freedom=freedom, iterations=100, tolerance=ROUGHLY).state for start in starts]
    return lowest(ends, views)


def spline_start(start: State, views: Observations) -> State:
    """Give a spline fitted to the start's directions, as fine as so many corners can tell."""
    points, pixels = pairs(start, views)
    model = Spline.start_of(points, pixels, SPANS, 3 if len(views.pixels) < MANY else 5)
    return dataclasses.replace(start, model=model)
