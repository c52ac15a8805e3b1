"""A camera whose image nearly folds over inside the corners is kept from doing so, by next to nothing."""

import dataclasses

import numpy as np
import pytest

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.log_barrier import log_barrier
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.models import model_class
from omnisight.targets.observations import Observations

# growth + (1 - growth)/at^2 (x - at)^2, as coefficients from x^1 up, in what each model counts.
AT, IN_R2 = 0.9, {"k1": (1, 1 / 3), "k2": (2, 1 / 5)}
COUNTED = {
    "kannala_brandt": IN_R2,
    "fisheye624": IN_R2,
    "thin_prism_fisheye": IN_R2,
    "radial_tangential": IN_R2,
    "rational": IN_R2,
    "mei": IN_R2,
    "radial_polynomial": {"k2": (1, 1 / 2), "k3": (2, 1 / 3)},
}


def nearly_folded(name, growth):
    """Give a camera whose image grows by so little somewhere, and the angle (radians) where that is."""
    focal = {"fx": 300.0, "fy": 300.0, "cx": 640.0, "cy": 480.0}
    if name == "ocam":  # of the angle: growth + (1 - growth)/at^4 (r^2 - at^2)^2
        at, steep = 300.0, (1 - growth) / 300.0**4
        model = model_class(name)(640.0, 480.0, 1.0, 0.0, 0.0, (250.0, 250 * 2 * steep * at**2, 0.0, -250 * steep / 3))
        return model, float(np.arctan2(at, np.polynomial.polynomial.polyval(at, model.polynomial)))
    steep = (1 - growth) / AT**2
    power = {1: -2 * steep * AT, 2: steep}
    shape = {key: power[i] * share for key, (i, share) in COUNTED[name].items()}
    values = dict.fromkeys(model_class(name).example().param_names, 0.0) | focal | shape
    model = model_class(name).from_dict(values | ({"xi": 0.8} if name == "mei" else {}))
    theta = np.linspace(1e-3, 0.999 * model.rim, 4001)
    radius = model.project_numpy(np.stack([np.sin(theta), 0 * theta, np.cos(theta)], -1))[0][:, 0] - 640.0
    plane = {"radial_tangential": np.tan(theta), "rational": np.tan(theta)}.get(name, theta)
    if name == "mei":
        plane = np.sin(theta) / (np.cos(theta) + 0.8)
    slope = np.gradient(radius, plane)
    inner = slice(100, 3500)
    return model, float(theta[inner][np.argmin(slope[inner])])


@pytest.mark.parametrize("name", [*COUNTED, "ocam"])
def test_where_an_image_nearly_folds_over_is_found(name):
    model, angle = nearly_folded(name, 0.02)
    (dip,) = model.near_folds
    assert dip.growth == pytest.approx(0.02, rel=1e-6)
    assert dip.angle == pytest.approx(angle, abs=2e-3)
    assert nearly_folded(name, 0.2)[0].near_folds == []


@pytest.mark.parametrize("name", [*COUNTED, "ocam"])
def test_the_wall_rises_as_its_gradient_says_and_has_no_top(name):
    model, _ = nearly_folded(name, 0.02)
    assert model.rim - model.near_folds[0].angle > 0.1
    state, views = seen_by(model)
    flat = log_barrier(state, views, 1.0)
    assert flat is not None
    for i in np.flatnonzero(flat.gradient):
        step = np.zeros(model.params.size)
        step[i] = 1e-7 / abs(flat.gradient[i])
        rise = [log_barrier(moved(state, sign * step), views, 1.0).cost for sign in (-1, 1)]
        assert (rise[1] - rise[0]) / (2 * step[i]) == pytest.approx(flat.gradient[i], rel=1e-3)
    steeper = [
        log_barrier(seen_by(nearly_folded(name, growth)[0])[0], views, 1.0).cost for growth in (1e-3, 1e-6, 1e-9)
    ]
    assert flat.cost < steeper[0] < steeper[1] < steeper[2]


def test_a_wall_is_part_of_the_cost_and_of_its_normal_equations():
    state, views = seen_by(nearly_folded("kannala_brandt", 1e-4)[0])
    bundle = Bundle(
        views, FreeParameters.of(state.model), ResidualWeights(np.tile(np.eye(2), (len(views.pixels), 1, 1)), 2.0, 10.0)
    )
    # Corners where the camera puts them: the log_barrier is all there is.
    before = log_barrier(state, views, 4.0)
    assert bundle.cost(state) == pytest.approx(before.cost, rel=1e-6)
    np.testing.assert_allclose(bundle.linearize(state).shared_gradient, before.gradient, rtol=1e-6, atol=1e-9)


def test_what_no_corner_lies_past_costs_nothing():
    state, views = seen_by(nearly_folded("kannala_brandt", 1e-4)[0], reach=0.3)
    assert log_barrier(state, views, 1.0).cost == 0.0


def seen_by(model, reach=None):
    """Give a state with one board ahead, whose corners reach beyond the dip, and the corners it sees."""
    dips = model.near_folds
    reach = (dips[0].angle + model.rim) / 2 if reach is None else reach
    theta = np.linspace(0.05, min(reach, 1.4), 8)
    x, y = np.meshgrid(np.tan(theta), (-0.01, 0.0, 0.01))
    corners = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    state = State(model, np.eye(3)[None], np.array([[0.0, 0.0, 1.0]]))
    return state, Observations.of([(corners, model.project_numpy(corners + state.translations)[0])])


def moved(state, step):
    return dataclasses.replace(state, model=state.model.with_params(state.model.params + step))
