"""What corners past the rim of a camera's domain cost: nothing that jumps."""

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
SQUARE = np.array([[x, y, 0.0] for y in range(3) for x in range(4)], float)


def across_the_rim(name, depth=2.0):
    """Give a camera, and a board whose corners lie on both sides of its rim, seen some px from where it puts them."""
    model = model_class(name).example()
    model = type(model).from_dict(dict.fromkeys(model.param_names, 0.0) | FOLDING[name])
    # A board that faces the camera sideways, its middle on the rim.
    forward = np.array([np.sin(model.rim), 0.0, np.cos(model.rim)])
    right = np.array([np.cos(model.rim), 0.0, -np.sin(model.rim)])
    rotation = np.stack([right, [0.0, 1.0, 0.0], forward], -1)
    state = State(model, rotation[None], (depth * forward - rotation @ [1.5, 1.0, 0.0])[None])
    points = SQUARE @ rotation.T + state.translations[0]
    pixels, valid = model.project_numpy(points)
    pixels[~valid] = project_clamped(model, points[~valid])
    assert 0 < valid.sum() < len(valid)
    views = Observations.of([(SQUARE, pixels + np.random.default_rng(0).normal(0, 20, pixels.shape))])
    return (
        state,
        views,
        Bundle(views, FreeParameters.of(model), ResidualWeights(np.tile(np.eye(2), (len(points), 1, 1)), 1.0, 5.0)),
    )


@pytest.mark.parametrize("name", FOLDING)
def test_no_cost_jumps_where_a_corner_leaves_the_domain(name):
    state, views, bundle = across_the_rim(name)
    costs, seen = list[float](), set[int]()
    for along in np.linspace(-2, 2, 4001):
        step = np.zeros(bundle.freedom.count + 6)
        step[-3:] = along * state.rotations[0, :, 0]
        moved = bundle.move(state, step)
        costs.append(bundle.cost(moved))
        seen.add(int(np.isfinite(moved.residuals(views)).all(1).sum()))
    assert len(seen) > 4
    # A corner that cost the same wherever it is lost would make a jump of 5 * 100.
    assert np.abs(np.diff(costs)).max() < 20


def slopes(state, bundle):
    """Give what the cost rises by along each of its unknowns, measured and as the normal equations say."""
    normal = bundle.linearize(state)
    told = np.concatenate([normal.shared_gradient, normal.local_gradient.ravel()])
    unit = 1 / np.sqrt(np.maximum(np.concatenate([np.diag(normal.shared), np.diag(normal.local[0])]), 1e-12))
    steps = np.diag(1e-4 * unit)
    rises = [bundle.cost(bundle.move(state, step)) - bundle.cost(bundle.move(state, -step)) for step in steps]
    return np.array(rises) / 2e-4, told * unit


@pytest.mark.parametrize(("name", "alike"), [*zip(FOLDING, (0.999999, 0.999, 0.999999, 0.95), strict=True)])
def test_the_cost_falls_as_the_normal_equations_say(name, alike):
    # Where the plane folds and not as a circle, the rim moves a little otherwise than the images of its bearings.
    state, _, bundle = across_the_rim(name)
    measured, told = slopes(state, bundle)
    assert measured @ told / (np.linalg.norm(measured) * np.linalg.norm(told)) > alike


def test_a_corner_held_at_the_rim_costs_the_same_wherever_it_is_only_past_its_weight():
    """Off by more than wrong corners are, but less sure of its place than others: it still pulls."""
    state, views, bundle = across_the_rim("kannala_brandt")
    far = dataclasses.replace(views, pixels=views.pixels + np.array([2 * views.pixel_span, 0.0]))
    less = ResidualWeights(0.2 * bundle.spread.roots, 1.0, 5.0)
    measured, told = slopes(state, Bundle(far, bundle.freedom, less))
    assert measured @ told / (np.linalg.norm(measured) * np.linalg.norm(told)) > 0.999


def test_the_domain_ends_a_little_earlier_for_a_little_more_decentring():
    cls = model_class("fisheye624")
    plain = dict.fromkeys(cls.example().param_names, 0.0) | FOLDING["fisheye624"]
    discs = np.array([cls.from_dict(plain | {"p1": p1}).disc for p1 in np.linspace(0, 0.3, 601)])
    assert np.abs(np.diff(discs)).max() < 0.01
    assert discs[-1] < 0.6 * discs[0]
