"""Geometry of line images (conics, circles) and plumb-line refinement."""

import mpmath
import numpy as np
import pytest

from arcs import HYPERBOLIC, PARABOLIC, calibrate_drawn, line_images
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines import (
    PixelChains,
    PlumbLineState,
    bearing_difference,
    fit_circle,
    fit_line_planes,
    line_conic,
    parabolic_camera,
    refine_plumb_lines,
)
from omnisight.calibration.lines.plumb_line import PlumbLineProblem
from omnisight.models import model_class
from omnisight.models.unified import Unified
from omnisight.optim.loss import Huber


@pytest.mark.parametrize("xi", [0.3, 0.85, 1.0, 1.4])
def test_the_image_of_a_line_lies_on_its_conic(xi):
    model = Unified(310.0, 305.0, 640.0, 500.0, xi, skew=0.7)
    arcs, normals = line_images(model, 4)
    for arc, normal in zip(arcs, normals, strict=True):
        conic = line_conic(model, normal)
        p = np.column_stack([arc, np.ones(len(arc))])
        value, slope = np.einsum("ni,ij,nj->n", p, conic, p), 2 * (p @ conic)[:, :2]
        assert np.abs(value / np.linalg.norm(slope, axis=1)).max() < 1e-8  # px


def test_the_conic_of_a_parabolic_mirror_is_the_circle_of_the_closed_form():
    normal = np.array([0.4, -0.7, 0.5])
    conic = line_conic(PARABOLIC, normal)
    conic = conic / conic[0, 0]
    centre = -conic[:2, 2]
    with mpmath.workdps(40):
        nx, ny, nz = (mpmath.mpf(n) for n in normal)
        expected = (652 + 300 * nx / nz, 498 + 300 * ny / nz)
        radius = 300 * mpmath.sqrt(nx**2 + ny**2 + nz**2) / nz
    assert abs(conic[0, 1]) < 1e-12
    assert conic[1, 1] == pytest.approx(1, abs=1e-12)
    assert centre == pytest.approx([float(c) for c in expected], abs=1e-9)
    assert np.sqrt(centre @ centre - conic[2, 2]) == pytest.approx(float(radius), abs=1e-9)


def test_three_circles_determine_the_parabolic_camera():
    arcs, _ = line_images(PARABOLIC, 3)
    found = parabolic_camera([fit_circle(arc) for arc in arcs])
    assert found.params == pytest.approx(PARABOLIC.params, abs=1e-6)


def test_two_circles_or_parallel_lines_determine_no_camera():
    arcs, _ = line_images(PARABOLIC, 2)
    assert parabolic_camera([fit_circle(arc) for arc in arcs]) is None
    across = np.stack([np.linspace(0, 100, 20), np.zeros(20)], -1)
    assert parabolic_camera([fit_circle(across + np.array([0, 30 * k])) for k in range(3)]) is None


def test_lines_through_the_centre_constrain_the_parabolic_camera():
    arcs, _ = line_images(PARABOLIC, 2)
    for direction in ((1.0, 0.3), (-0.2, 1.0)):
        arcs.append(np.array([652.0, 498.0]) + np.linspace(100, 400, 50)[:, None] * direction)
    found = parabolic_camera([fit_circle(arc) for arc in arcs])
    assert found.params == pytest.approx(PARABOLIC.params, abs=1e-5)


def test_a_short_arc_is_fitted_without_bias():
    # The algebraic fit of Kasa to 30 degrees of a circle of 200 px with 1 px of noise is 10 to 20 % too small.
    turn = np.linspace(0, np.radians(30), 60)
    true = np.stack([500 + 200 * np.cos(turn), 400 + 200 * np.sin(turn)], -1)
    curvature, stated = [], []
    for seed in range(200):
        circle = fit_circle(true + np.random.default_rng(seed).normal(size=true.shape))
        curvature.append(2 * abs(circle.coefficients[0]))
        stated.append(2 * np.sqrt(circle.covariance[0, 0]))
    deviation = np.std(curvature)
    assert np.mean(curvature) == pytest.approx(1 / 200, abs=3 * deviation / np.sqrt(200))
    assert np.mean(stated) == pytest.approx(deviation, rel=0.2)


def test_distances_from_a_circle_are_exact():
    turn = np.linspace(0, 2, 30)
    circle = fit_circle(np.stack([100 + 50 * np.cos(turn), 80 + 50 * np.sin(turn)], -1))
    points = np.array([[100.0, 90.0], [100, 140], [130, 120], [175, 80]])
    assert np.abs(circle.distance(points)) == pytest.approx([40, 10, 0, 25], abs=1e-6)


@pytest.mark.parametrize("name", ["unified", "mei", "ocam", "kannala_brandt", "double_sphere", "equidistant"])
def test_the_gradient_matches_finite_differences_of_the_cost(name):
    model = model_class(name).example()
    arcs, normals = line_images(model, 4, noise=0.4, radii=(20, 300))
    chains = PixelChains.from_arrays(arcs)
    bent = model.with_params(model.params * (1 + 2e-3 * np.cos(np.arange(model.params.size))))
    state = PlumbLineState(bent, normals)
    problem = PlumbLineProblem(chains, Huber(), FreeParameters.of(model))
    normal = problem.linearize(state)
    gradient = np.concatenate([normal.shared_gradient, normal.local_gradient.ravel()])
    # Steps of equal effect in pixels, whatever the unit of the parameter.
    size = np.concatenate([1 / np.sqrt(np.diagonal(normal.shared)), np.full(8, 1e-2)]) * 1e-2
    for i in range(len(gradient)):
        step = np.zeros(len(gradient))
        step[i] = size[i]
        slope = (problem.cost(problem.move(state, step)) - problem.cost(problem.move(state, -step))) / 2
        assert slope == pytest.approx(gradient[i] * size[i], abs=2e-3 * np.abs(gradient * size).max())


def test_distances_are_measured_in_pixels():
    (arc,), normals = line_images(HYPERBOLIC, 1)
    tangent = np.gradient(arc, axis=0)
    across = np.stack([-tangent[:, 1], tangent[:, 0]], -1) / np.linalg.norm(tangent, axis=1, keepdims=True)
    moved = PixelChains.from_arrays([arc + 1.5 * across])
    assert PlumbLineState(HYPERBOLIC, normals).distances(moved) == pytest.approx(np.full(len(arc), 1.5), abs=0.02)


@pytest.mark.parametrize("name", ["unified", "equidistant", "equisolid", "orthographic"])
def test_lines_alone_determine_a_model_with_a_fixed_profile(name):
    truth = model_class(name).example()
    truth = truth.with_params([truth.params[0], *truth.params[[0, 2, 3]], *truth.params[4:]])
    if "skew" in truth.param_names:
        truth = model_class(name).from_dict(truth.to_dict() | {"skew": 0.0})
    arcs, _ = line_images(truth, 8, radii=(30, 300))
    chains = PixelChains.from_arrays(arcs)
    off = truth.with_params(truth.params * np.array([1.04, 1.04, 1.01, 0.99, *[1.03] * (truth.params.size - 4)]))
    found = refine_plumb_lines(fit_line_planes(off, chains), chains, FreeParameters.of(off, square=True)).state
    assert found.distances(chains).max() < 1e-5
    assert found.model.params == pytest.approx(truth.params, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("name", ["ocam", "kannala_brandt", "mei"])
def test_a_model_with_a_free_profile_keeps_the_scale_of_the_unified_model(name):
    arcs, _ = line_images(HYPERBOLIC, 12, noise=0.1)
    found = calibrate_drawn(arcs, model=name)
    assert found.estimate.is_scale_fixed
    assert any("the scale of" in warning for warning in found.warnings)
    assert bearing_difference(found.camera.model, HYPERBOLIC, np.concatenate(arcs)) < 3 * found.bearing_sigma
    assert found.bearing_sigma < np.radians(1)


def test_a_model_closed_under_scaling_gets_a_fixed_scale():
    truth = model_class("fov")(430.0, 430.0, 640.0, 512.0, 0.92)
    arcs, _ = line_images(truth, 12, noise=0.1)
    assert calibrate_drawn(arcs, model="fov").estimate.is_scale_fixed
    assert not calibrate_drawn(arcs, model="equidistant").estimate.is_scale_fixed


def test_a_pinhole_is_rejected():
    arcs, _ = line_images(Unified(400.0, 400.0, 640.0, 512.0, 0.2), 8, radii=(20, 300))
    with pytest.raises(ValueError, match="lines do not determine the parameters of pinhole"):
        calibrate_drawn(arcs, model="pinhole")


def test_lines_without_distortion_determine_no_camera():
    arcs, _ = line_images(Unified(400.0, 400.0, 640.0, 512.0, 0.0), 12, noise=0.3, radii=(20, 300))
    with pytest.raises(ValueError, match="the lines do not determine the camera: the standard deviation"):
        calibrate_drawn(arcs)
