"""Continuity of the cost where corners leave the domain of a camera."""

import dataclasses

import numpy as np
import pytest

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.domain_edge import project_clamped
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.models import model_class
from omnisight.targets.observations import Observations

FOLDING = {
    "kannala_brandt": {"fx": 300.0, "fy": 300.0, "cx": 640.0, "cy": 480.0, "k1": -0.1, "k2": 0.0, "k3": 0.0, "k4": 0.0},
    "radial_tangential": {"fx": 500.0, "fy": 505.0, "cx": 640.0, "cy": 480.0, "k1": -0.3, "k2": 0.02, "p1": 0.002},
    "fisheye624": {"fx": 300.0, "fy": 300.0, "cx": 640.0, "cy": 480.0, "k1": -0.1, "p1": 0.02, "s1": 0.01},
    "thin_prism_fisheye": {"fx": 300.0, "fy": 300.0, "cx": 640.0, "cy": 480.0, "k1": -0.1, "p2": 0.01},
}
SIZE = (1280, 960)
SQUARE = np.array([[x, y, 0.0] for y in range(3) for x in range(4)], float)


def board_across_the_edge(name, depth=2.0):
    """Return a state with a board on both sides of the edge of the domain, its noisy corners, and the bundle."""
    model = model_class(name).example()
    model = type(model).from_dict(dict.fromkeys(model.param_names, 0.0) | FOLDING[name])
    # The board faces the camera, its centre at the edge of the domain.
    forward = np.array([np.sin(model.rim), 0.0, np.cos(model.rim)])
    right = np.array([np.cos(model.rim), 0.0, -np.sin(model.rim)])
    rotation = np.stack([right, [0.0, 1.0, 0.0], forward], -1)
    state = State(model, rotation[None], (depth * forward - rotation @ [1.5, 1.0, 0.0])[None])
    points = SQUARE @ rotation.T + state.translations[0]
    pixels, valid = model.project_numpy(points)
    pixels[~valid] = project_clamped(model, points[~valid])
    assert 0 < valid.sum() < len(valid)
    observations = Observations.from_arrays(
        [SQUARE], [pixels + np.random.default_rng(0).normal(0, 20, pixels.shape)], size=SIZE
    )
    return (
        state,
        observations,
        Bundle(
            observations, FreeParameters.of(model), ResidualWeights(np.tile(np.eye(2), (len(points), 1, 1)), 1.0, 5.0)
        ),
    )


@pytest.mark.parametrize("name", FOLDING)
def test_cost_is_continuous_where_corners_leave_the_domain(name):
    state, observations, bundle = board_across_the_edge(name)
    direction = np.zeros(bundle.free_parameters.count + 6)
    direction[-3:] = state.rotations[0, :, 0]

    def visible(along):
        return int(np.isfinite(bundle.move(state, along * direction).residuals(observations)).all(1).sum())

    def cost(along):
        return bundle.cost(bundle.move(state, along * direction))

    positions = np.linspace(-2, 2, 81)
    counts = [visible(along) for along in positions]
    changes = np.flatnonzero(np.diff(counts))
    assert len(changes) >= 4
    for low, high in zip(positions[changes], positions[changes + 1], strict=True):
        count = visible(low)
        while high - low > 1e-7:  # bisect to where a corner leaves
            middle = (low + high) / 2
            low, high = (middle, high) if visible(middle) == count else (low, middle)
        # A constant cost outside the domain would make a jump of 5 * 100 per corner.
        assert abs(cost(high) - cost(low)) < 0.1


def cost_gradients(state, bundle):
    """Return the scaled gradient of the cost by finite differences and from the normal equations."""
    normal = bundle.linearize(state)
    analytic = np.concatenate([normal.shared_gradient, normal.local_gradient.ravel()])
    unit = 1 / np.sqrt(np.maximum(np.concatenate([np.diag(normal.shared), np.diag(normal.local[0])]), 1e-12))
    steps = np.diag(1e-4 * unit)
    differences = [bundle.cost(bundle.move(state, step)) - bundle.cost(bundle.move(state, -step)) for step in steps]
    return np.array(differences) / 2e-4, analytic * unit


@pytest.mark.parametrize(("name", "min_cosine"), [*zip(FOLDING, (0.999999, 0.999, 0.999999, 0.95), strict=True)])
def test_gradient_of_the_normal_equations_matches_finite_differences(name, min_cosine):
    # With decentring the edge is no circle, and the derivatives at constant angle are approximate.
    state, _, bundle = board_across_the_edge(name)
    measured, analytic = cost_gradients(state, bundle)
    assert measured @ analytic / (np.linalg.norm(measured) * np.linalg.norm(analytic)) > min_cosine


def test_gradient_matches_for_clamped_corners_of_low_weight():
    """A residual above the limit for outliers counts as long as its weighted length is below."""
    state, observations, bundle = board_across_the_edge("kannala_brandt")
    far = dataclasses.replace(observations, pixels=observations.pixels + np.array([2 * observations.pixel_span, 0.0]))
    low_weight = ResidualWeights(0.2 * bundle.weights.whitening, 1.0, 5.0)
    measured, analytic = cost_gradients(state, Bundle(far, bundle.free_parameters, low_weight))
    assert measured @ analytic / (np.linalg.norm(measured) * np.linalg.norm(analytic)) > 0.999


def test_radius_of_the_domain_is_continuous_in_the_decentring():
    cls = model_class("fisheye624")
    plain = dict.fromkeys(cls.example().param_names, 0.0) | FOLDING["fisheye624"]
    discs = np.array([cls.from_dict(plain | {"p1": p1}).one_to_one_radius for p1 in np.linspace(0, 0.3, 601)])
    assert np.abs(np.diff(discs)).max() < 0.01
    assert discs[-1] < 0.6 * discs[0]
