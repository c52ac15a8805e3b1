"""The logarithmic barrier of cameras whose image nearly folds inside the corners."""

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

# growth + (1 - growth)/at^2 (x - at)^2 as coefficients of each model: (power of x, factor).
SIZE = (2560, 1920)
AT, IN_R2 = 0.9, {"k1": (1, 1 / 3), "k2": (2, 1 / 5)}
COEFFICIENTS = {
    "kannala_brandt": IN_R2,
    "fisheye624": IN_R2,
    "thin_prism_fisheye": IN_R2,
    "radial_tangential": IN_R2,
    "rational": IN_R2,
    "mei": IN_R2,
    "radial_polynomial": {"k2": (1, 1 / 2), "k3": (2, 1 / 3)},
}


def nearly_folding_camera(name, growth):
    """Return a camera whose least relative growth is that of the argument, and the off-axis angle (radians) of it."""
    focal = {"fx": 300.0, "fy": 300.0, "cx": 640.0, "cy": 480.0}
    if name == "ocam":  # of the angle: growth + (1 - growth)/at^4 (r^2 - at^2)^2
        at, steep = 300.0, (1 - growth) / 300.0**4
        model = model_class(name)(640.0, 480.0, 1.0, 0.0, 0.0, (250.0, 250 * 2 * steep * at**2, 0.0, -250 * steep / 3))
        return model, float(np.arctan2(at, np.polynomial.polynomial.polyval(at, model.polynomial)))
    steep = (1 - growth) / AT**2
    power = {1: -2 * steep * AT, 2: steep}
    shape = {key: power[i] * share for key, (i, share) in COEFFICIENTS[name].items()}
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


@pytest.mark.parametrize("name", [*COEFFICIENTS, "ocam"])
def test_near_folds_have_the_expected_angle_and_growth(name):
    model, angle = nearly_folding_camera(name, 0.02)
    (fold,) = model.near_folds
    assert fold.growth == pytest.approx(0.02, rel=1e-6)
    assert fold.angle == pytest.approx(angle, abs=2e-3)
    assert nearly_folding_camera(name, 0.2)[0].near_folds == []


@pytest.mark.parametrize("name", [*COEFFICIENTS, "ocam"])
def test_barrier_gradient_matches_finite_differences_and_cost_diverges_at_the_fold(name):
    model, _ = nearly_folding_camera(name, 0.02)
    assert model.rim - model.near_folds[0].angle > 0.1
    state, observations = state_and_corners(model)
    barrier = log_barrier(state, observations, 1.0)
    assert barrier is not None
    assert barrier.gradient.any()
    for i in np.flatnonzero(barrier.gradient):
        step = np.zeros(model.params.size)
        step[i] = 1e-7 / abs(barrier.gradient[i])
        costs = [log_barrier(moved(state, sign * step), observations, 1.0).cost for sign in (-1, 1)]
        assert (costs[1] - costs[0]) / (2 * step[i]) == pytest.approx(barrier.gradient[i], rel=1e-3)
    closer = [
        log_barrier(state_and_corners(nearly_folding_camera(name, growth)[0])[0], observations, 1.0).cost
        for growth in (1e-3, 1e-6, 1e-9)
    ]
    assert barrier.cost < closer[0] < closer[1] < closer[2]


def test_bundle_cost_and_normal_equations_include_the_barrier():
    state, observations = state_and_corners(nearly_folding_camera("kannala_brandt", 1e-4)[0])
    bundle = Bundle(
        observations,
        FreeParameters.of(state.model),
        ResidualWeights(np.tile(np.eye(2), (len(observations.pixels), 1, 1)), 2.0, 10.0),
    )
    # The residuals are zero, so that the barrier is the whole cost.
    barrier = log_barrier(state, observations, 4.0)
    assert bundle.cost(state) == pytest.approx(barrier.cost, rel=1e-6)
    np.testing.assert_allclose(bundle.linearize(state).shared_gradient, barrier.gradient, rtol=1e-6, atol=1e-9)


def test_barrier_is_zero_without_corners_beyond_the_fold():
    state, observations = state_and_corners(nearly_folding_camera("kannala_brandt", 1e-4)[0], reach=0.3)
    assert log_barrier(state, observations, 1.0).cost == 0.0


def state_and_corners(model, reach=None):
    """Return a state with one board whose corners reach beyond the near fold, and the corners without noise."""
    folds = model.near_folds
    reach = (folds[0].angle + model.rim) / 2 if reach is None else reach
    theta = np.linspace(0.05, min(reach, 1.4), 8)
    x, y = np.meshgrid(np.tan(theta), (-0.01, 0.0, 0.01))
    corners = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    state = State(model, np.eye(3)[None], np.array([[0.0, 0.0, 1.0]]))
    pixels = model.project_numpy(corners + state.translations)[0]
    # Beyond the fold some lie outside the image.
    return state, dataclasses.replace(Observations.from_arrays([corners], [pixels], size=(0, 0)), size=SIZE)


def moved(state, step):
    return dataclasses.replace(state, model=state.model.with_params(state.model.params + step))
